"""Contact of a capsule with a polytope or another capsule: two balls of the capsule."""

from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from icjax.compiling import as_one_kernel, as_primitive
from icjax.geometry._manifold import APART, Manifold
from icjax.geometry._polytope import prism_topology
from icjax.geometry._round import Capsule
from icjax.geometry._shape import Placed, Shape
from icjax.geometry._touching import INDEX, ROUNDING, argmax, cross, loop_tables
from icjax.typing import Real

LOWER, UPPER, VERTEX, EDGE, SIDE = range(5)
"""What tells a place on the axis of the capsule: one of its ends; the vertex or edge of the other solid closest there;
the side of one of its faces, where the axis crosses it."""


class Places(NamedTuple):
    """Two places on the axis.

    **Fields**: `kind` of each; `ends` `[2, 2]`, of each the edge or side, by its vertices; the `face` of the sides;
    `distinct`, whether they are two.
    """

    kind: Real
    ends: Real
    face: Real
    distinct: Real


def capsule_contact(capsule: Capsule, other: Placed) -> Manifold:
    """Of a capsule at the origin with a box, prism or capsule.

    A ball about any point of the axis is part of the capsule, and its distance from the other solid is exact. One point
    is where the axis is closest; the other one is at the far end of the part over the closest face, or beside the other
    capsule.
    """
    solid: Any = other.shape
    half = capsule.half_length
    if isinstance(solid, Capsule):
        heights = solid.half_length * jnp.asarray([-1.0, 1.0], half.dtype)
        vertices = other.pose.position[None] + heights[:, None] * other.pose.rotation[None, :, 2]
        normals, corners = jnp.zeros((1, 3), half.dtype), 0
    else:
        polytope = solid.polytope().moved(other.pose)
        vertices, normals, corners = polytope.vertices, polytope.normals, polytope.corners
    back = other.pose.inverse()
    line = back.position, back.rotation[:, 2]
    found = _search(corners)(half, vertices, normals, solid, line)
    height, _ = _heights(found.kind, half, vertices[found.ends], normals[found.face])
    centre = height[:, None] * jnp.asarray([[0.0, 0.0, 1.0]], half.dtype)
    normal = jax.vmap(other.normal)(centre)
    gap = _distances(solid, line, height) - capsule.radius
    active = jnp.stack([jnp.ones_like(found.distinct), found.distinct])
    return Manifold(centre - capsule.radius * normal, normal, jnp.where(active, gap, APART), active)


def _heights(kind: Real, half: Real, ends: Real, normal: Real):
    """Of places on the axis, by edges `[place, 2, 3]`; and the closest points' places on the edges, zero to one."""
    p, v = ends[:, 0], ends[:, 1] - ends[:, 0]
    square = jnp.where(kind == EDGE, jnp.sum(v[:, :2] ** 2, axis=1), 1.0)
    parallel = square == 0.0
    along = jnp.where(parallel, -1.0, -jnp.sum(p[:, :2] * v[:, :2], axis=1) / jnp.where(parallel, 1.0, square))
    outward = cross(v, normal[None])
    rise = jnp.where((kind == SIDE) & (outward[:, 2] != 0.0), outward[:, 2], 1.0)
    cases = [-half, half, p[:, 2], p[:, 2] + along * v[:, 2], jnp.sum(outward * p, axis=1) / rise]
    cases = [jnp.broadcast_to(case, p[:, 2].shape) for case in cases]
    return jnp.select([kind == case for case in range(5)], cases), along


def _distances(solid: Shape, line: tuple[Real, Real], height: Real) -> Real:
    """Of points of the axis from the other solid, in whose frame the axis starts at a point, in a direction."""
    start, along = line
    return jax.vmap(solid.signed_distance)(start[None] + height[:, None] * along[None])


@lru_cache
def _search(corners: int):
    return as_primitive(as_one_kernel(partial(_found, corners)))


def _found(corners, half, vertices, normals, solid, line) -> Places:
    edges = prism_topology(corners).edges if corners else np.array([[0, 1]])
    alone = np.arange(len(vertices))
    ends = np.concatenate([np.zeros((2, 2), int), edges, np.stack([alone, alone], axis=1)])
    kinds = np.repeat([LOWER, UPPER, EDGE, VERTEX], [1, 1, len(edges), len(alone)])
    height, along = _heights(jnp.asarray(kinds, INDEX), half, vertices[ends], normals[0])
    between = (kinds == VERTEX) | (along > 0.0) & (along < 1.0)
    exists = (kinds <= UPPER) | between & (jnp.abs(height) < half)
    nearest = argmax(jnp.where(exists, -_distances(solid, line, height), -jnp.inf))

    hair = ROUNDING * jnp.finfo(half.dtype).eps * (jnp.max(jnp.abs(vertices)) + half)
    if corners:
        kind, reach, face = _over_the_face(corners, half, vertices, normals, height[nearest])
    else:
        kind, reach, face = _beside(half, vertices)
    kind = jnp.concatenate([kind, jnp.asarray(kinds, INDEX)[nearest][None]])
    reach = jnp.concatenate([reach, jnp.asarray(ends, INDEX)[nearest][None]])
    height, _ = _heights(kind, half, vertices[reach], normals[face])
    # All points over a face that the axis is parallel to are closest; of these, the ends.
    one = argmax(jnp.asarray([1.0, 1.0, 0.0], half.dtype) * hair - _distances(solid, line, height))
    away = jnp.abs(height[:2] - height[one])
    two = argmax(away)
    chosen = jnp.stack([one, two])
    return Places(kind[chosen], reach[chosen], face, jnp.max(away) > jnp.sqrt(jnp.finfo(half.dtype).eps) * half)


def _over_the_face(corners, half, vertices, normals, height):
    """Ends of the part of the axis between the sides of the face closest to it at a height."""
    loops = [jnp.asarray(table) for table in loop_tables(prism_topology(corners))]
    face = argmax(normals[:, 2] * height - jnp.sum(normals * vertices[loops[0][:, 0]], axis=1))
    start, stop = (table[face] for table in loops)
    outward = cross(vertices[stop] - vertices[start], normals[face][None])
    middle, end = -jnp.sum(outward * vertices[start], axis=1), half * outward[:, 2]
    # A side beyond which, or along which, the whole axis lies ends nothing: the axis then lies along that edge.
    crossed = jnp.abs(middle) < jnp.abs(end)
    place = -middle / jnp.where(crossed, end, 1.0)
    lowest, highest = jnp.where(crossed & (end < 0.0), place, -1.0), jnp.where(crossed & (end > 0.0), place, 1.0)
    i, j = argmax(lowest), argmax(-highest)
    kind = jnp.stack([jnp.where(lowest[i] > -1.0, SIDE, LOWER), jnp.where(highest[j] < 1.0, SIDE, UPPER)])
    return kind.astype(INDEX), jnp.stack([jnp.stack([start[k], stop[k]]) for k in (i, j)]), face


def _beside(half, ends):
    """Ends of the part of the axis beside another one."""
    order = jnp.stack([argmax(-ends[:, 2]), argmax(ends[:, 2])])
    height = ends[order, 2]
    kind = jnp.where(height <= -half, LOWER, jnp.where(height >= half, UPPER, VERTEX))
    return kind.astype(INDEX), jnp.stack([order, order], axis=1), jnp.zeros((), INDEX)
