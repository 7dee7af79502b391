"""Contact of two polytopes: corners of the overlap of two faces, or the crossing of two edges."""

from typing import Any

import jax.numpy as jnp

from icjax.geometry._box import Box
from icjax.geometry._manifold import APART, Manifold
from icjax.geometry._prism import Prism
from icjax.geometry._shape import Placed
from icjax.geometry._touching import BELOW, CROSSING, EDGES, touching
from icjax.typing import Real


def polytope_contact(solid: Box | Prism, other: Placed) -> Manifold:
    """Of a solid at the origin with another one.

    The search for what touches has no derivatives; points and gaps are those of the features found.
    """
    shape: Any = other.shape
    first, second = solid.polytope(), shape.polytope().moved(other.pose)
    found = touching(first, second)
    normal, facing = jnp.concatenate([first.normals, second.normals])[found.faces]
    p, next_p, q, next_q = jnp.concatenate([first.vertices, second.vertices])[found.ends]
    of_second = found.faces[0] >= first.normals.shape[0]
    by_edges = found.source[0] == EDGES

    point, gap = _of_faces(found.source, normal, facing, p, next_p, q, next_q)
    point = jnp.where(of_second, point, point - gap[:, None] * normal[None])
    normal = jnp.where(of_second, normal, -normal)
    crossing, apart, across = _of_edges(by_edges, found.sign, p[0], next_p[0], q[0], next_q[0])
    point = jnp.where(by_edges, crossing[None], point)
    normal = jnp.broadcast_to(jnp.where(by_edges, -across, normal)[None], point.shape)
    gap = jnp.where(by_edges, apart, gap)
    return Manifold(point, normal, jnp.where(found.active, gap, APART), found.active)


def _of_faces(source: Real, normal: Real, facing: Real, p: Real, next_p: Real, q: Real, next_q: Real):
    """Points on the incident face and their heights over the reference face, of which p are corners.

    A corner q; an edge from q where it passes over the side of the reference face from p; or what is over the corner p.
    """
    outward, along = jnp.cross(next_p - p, normal[None]), next_q - q
    before, change = jnp.sum(outward * (p - q), axis=1), jnp.sum(outward * along, axis=1)
    place = jnp.where(source == CROSSING, before / _divisor(change), 0.0)
    point = q + place[:, None] * along
    below = source == BELOW
    height = jnp.where(below, (q - p) @ facing / _divisor(jnp.dot(facing, normal)), (point - p) @ normal)
    return jnp.where(below[:, None], p + height[:, None] * normal[None], point), height


def _of_edges(by_edges: Real, sign: Real, p: Real, next_p: Real, q: Real, next_q: Real):
    """Point of the first edge closest to the second one, its distance, and the normal, away from the first solid."""
    u, v = next_p - p, next_q - q
    across = sign * jnp.cross(u, v)
    square = jnp.where(by_edges, jnp.sum(across**2), 1.0)
    place = sign * jnp.dot(jnp.cross(q - p, v), across) / square
    normal = across / jnp.sqrt(square)
    return p + place * u, jnp.dot(q - p, normal), normal


def _divisor(x: Real) -> Real:
    return jnp.where(x == 0.0, 1.0, x)
