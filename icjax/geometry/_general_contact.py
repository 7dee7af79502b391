"""Contact of any two solids by the curves and points of one in the distance of the other."""

from functools import lru_cache, partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from icjax.compiling import as_primitive
from icjax.geometry._curves import (
    SAMPLES,
    Curves,
    Places,
    curves_of,
    places_on,
    refined,
    rounded,
    sought,
)
from icjax.geometry._ellipsoid import Ellipsoid
from icjax.geometry._heightfield import Heightfield
from icjax.geometry._manifold import APART, Manifold
from icjax.geometry._mesh import Mesh
from icjax.geometry._plane import Plane
from icjax.geometry._shape import Placed, Shape, length_and_direction
from icjax.geometry._touching import FLAT, INDEX, argmax
from icjax.spatial import Pose
from icjax.typing import Float, Real

AROUND = 6
"""Points beside the deepest one, each as far as possible in one of so many directions."""


CLOSE = 0.01
"""Points closer to each other than such a part of the smaller solid are one."""


class Chosen(NamedTuple):
    """**Fields**: of each point the solid it is `of` (0, 1), its `curve`, the place `t` on it, whether it is `free` to
    move along it, and whether it is `distinct` from those before.
    """

    of: Real
    curve: Real
    t: Real
    free: Real
    distinct: Real


def general_contact(first: Shape, second: Placed) -> Manifold:
    """Of a solid at the origin with another one.

    Looked at are the corners, edges, rims and axes of each solid in the distance of the other one. Of them come the
    deepest point and, around it, those that are farthest out among the ones that are not higher than at a slope of
    `FLAT`. The search has no derivatives; points and gaps are those of what was found.
    """
    solids, pose = (first, second.shape), second.pose
    there = Placed(first, Pose(jnp.eye(3, dtype=pose.position.dtype), jnp.zeros_like(pose.position)))
    curves = (curves_of(first, second), curves_of(second.shape, Placed(first, pose.inverse())).moved(pose))
    (a, ball_a), (b, ball_b) = rounded(first), rounded(second.shape)
    others = (Placed(b, pose), Placed(a, there.pose))
    balls = (ball_b, ball_a)
    kinds = tuple(type(solid) for solid in solids)
    found = _search(kinds, tuple(each.base.shape[0] for each in curves))(curves, others, balls)

    parts = []
    for side, (each, other, ball) in enumerate(zip(curves, others, balls, strict=True)):
        if not each.base.shape[0]:
            continue
        own = found.of == side
        mine = _rows(each, jnp.where(own, found.curve, 0))
        t = refined()(mine, found.t, found.free & own, other)
        centre = mine.at(t)
        normal, gap = jax.vmap(other.normal)(centre), _gaps(mine, centre, other, ball)
        point = centre - mine.ball[:, None] * normal
        if side:
            normal, point = -normal, point - gap[:, None] * normal
        parts.append((point, normal, gap))
    if len(parts) == 2:
        of_first = found.of == 0
        points, normals, gaps = zip(*parts, strict=True)
        point, normal = (jnp.where(of_first[:, None], *two) for two in (points, normals))
        gap = jnp.where(of_first, *gaps)
    else:
        ((point, normal, gap),) = parts
    return Manifold(point, normal, jnp.where(found.distinct, gap, APART), found.distinct)


def touches(kind: type[Shape]) -> bool:
    """Whether a solid of this kind has curves or points to touch something with."""
    return not issubclass(kind, Plane)


def convex(kind: type[Shape]) -> bool:
    """Whether all solids of a kind are."""
    return not issubclass(kind, Mesh | Heightfield)


def _rows(table: Any, numbers: Any):
    return jax.tree.map(lambda row: row[numbers], table)


def _gaps(curves: Curves, centre: Real, other: Placed, ball: Real) -> Float[Real, " curve"]:
    return jax.vmap(other.signed_distance)(centre) - ball - curves.ball


@lru_cache
def _search(kinds: tuple[type[Shape], ...], counts: tuple[int, ...]):
    places = tuple(
        places_on(kind, count, convex(other)) for kind, count, other in zip(kinds, counts, kinds[::-1], strict=True)
    )
    one = all(convex(kind) for kind in kinds) and any(issubclass(kind, Ellipsoid) for kind in kinds)
    return as_primitive(partial(_chosen, places, 0 if one else AROUND))


def _chosen(places, around, curves, others, balls) -> Chosen:
    sides = [
        _candidates(side, each, mine, other, ball)
        for side, (each, mine, other, ball) in enumerate(zip(places, curves, others, balls, strict=True))
        if mine.base.shape[0]
    ]
    rows = jax.tree.map(lambda *parts: jnp.concatenate(parts), *sides)
    x, gap, found = rows
    deepest = argmax(-gap)
    normal = _normal(others, x[deepest], found.of[deepest])
    first, second = _tangents(normal)
    turns = 2.0 * np.pi * np.arange(around) / max(around, 1)
    out = np.cos(turns)[:, None] * first[None] + np.sin(turns)[:, None] * second[None]
    reach = FLAT * jnp.sum(out[None] * (x - x[deepest][None])[:, None], axis=2) - gap[:, None]
    chosen = jnp.concatenate([deepest[None], argmax(reach)]) if around else deepest[None]
    place = x[chosen]
    hair = CLOSE * jnp.min(jnp.stack([_extent(side[0]) for side in sides]))
    same = jnp.sum((place[:, None] - place[None]) ** 2, axis=2) <= jnp.where(jnp.isfinite(hair), hair, 0.0) ** 2
    repeated = jnp.any(same & np.tril(np.ones((around + 1, around + 1), bool), -1), axis=1)
    return _rows(found, chosen)._replace(distinct=~repeated)


def _extent(x):
    size = jnp.max(jnp.abs(x - x[:1]))
    return jnp.where(size > 0.0, size, jnp.inf)


def _candidates(side: int, places: Places, curves: Curves, other: Placed, ball: Real):
    """Points, gaps and what they are, of one solid."""
    dtype = curves.base.dtype
    fixed = _rows(curves, places.fixed.astype(np.uint32))
    t = jnp.asarray(places.at, dtype)
    x = fixed.at(t)
    parts = [(x, _gaps(fixed, x, other, ball), _told(side, places.fixed, t, t < -jnp.inf))]
    if len(places.curve):
        count = len(places.curve) - places.rims
        low, high = jnp.zeros(count, dtype), jnp.ones(count, dtype)
        if places.rims:
            best = argmax(-parts[0][1][-places.rims * SAMPLES :].reshape(places.rims, SAMPLES).T)
            angle = 2.0 * np.pi / SAMPLES * best.astype(dtype)
            low = jnp.concatenate([low, angle - 2.0 * np.pi / SAMPLES])
            high = jnp.concatenate([high, angle + 2.0 * np.pi / SAMPLES])
        mine = _rows(curves, places.curve.astype(np.uint32))
        wanted = jnp.asarray(places.slope, dtype)
        t, free = sought(mine, low, high, wanted, other)
        x = mine.at(t)
        told = _told(side, places.curve, t, free)
        parts.append((x, _gaps(mine, x, other, ball), told))
    return jax.tree.map(lambda *rows: jnp.concatenate(rows), *parts)


def _told(side: int, curve: np.ndarray, t: Real, free: Real) -> Chosen:
    of, number = jnp.full(t.shape, side, INDEX), jnp.asarray(curve, INDEX)
    return Chosen(of, number, t, free, jnp.ones(t.shape, bool))


def _normal(others, x, of):
    normals = [other.normal(x) for other in others]
    return jnp.where(of == 0, normals[0], -normals[1])


def _tangents(normal):
    axis = jnp.where(jnp.abs(normal[0]) < 0.6, jnp.asarray([1.0, 0.0, 0.0]), jnp.asarray([0.0, 1.0, 0.0]))
    first = length_and_direction(jnp.cross(normal, axis.astype(normal.dtype)))[1]
    return first, jnp.cross(normal, first)
