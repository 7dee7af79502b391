"""Which features of two polytopes touch: a search without derivatives."""

from functools import lru_cache, partial
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jax import lax

from icjax.compiling import as_one_kernel, as_primitive
from icjax.geometry._polytope import Polytope, Topology, prism_topology
from icjax.typing import Real

CORNER, CROSSING, BELOW, EDGES = range(4)
"""Sources of a point: a corner of the incident face; its edge over a side of the reference face; what of it is over a
corner of the reference face; two edges."""

FLAT = 0.02
"""rad; edges whose common normal is so close to that of a face count as faces that touch. On edges alone a body that
lies flat would rock, for one pair of them is found at a time."""

ROUNDING = 64.0
"""Rounding errors of sums of a few products, in units of the last place."""

INDEX = jnp.uint32  # JAX would check of signed indices whether they count from the end


class Touching(NamedTuple):
    """Features that touch; vertices and faces of the second solid are numbered after those of the first.

    **Fields**: `faces` the reference face and the incident one; `source` of each point; `ends` `[4, slot]`, the side of
    the reference face (or edge of the first solid) and the edge of the incident face (or of the second solid) that the
    point is found with, by their vertices; `sign` of the product of two edges that points away from the first solid;
    `active`, whether there is a point.
    """

    faces: Real
    source: Real
    ends: Real
    sign: Real
    active: Real


def touching(first: Polytope, second: Polytope) -> Touching:
    """Features of two polytopes in one frame."""
    search = _search(first.corners, second.corners)
    return search(first.vertices, first.normals, second.vertices, second.normals)


@lru_cache
def _search(first: int, second: int):
    return as_primitive(as_one_kernel(partial(_found, prism_topology(first), prism_topology(second))))


def _found(A: Topology, B: Topology, a, a_normals, b, b_normals) -> Touching:
    eps = jnp.finfo(a.dtype).eps
    size = jnp.max(jnp.abs(a - a[:1])) + jnp.max(jnp.abs(b - b[:1]))
    vertices, normals = jnp.concatenate([a, b]), jnp.concatenate([a_normals, b_normals])
    of_second = np.repeat([False, True], [len(a_normals), len(b_normals)])
    own = of_second[:, None] == np.repeat([False, True], [len(a), len(b)])[None]
    height = dots(normals, vertices)
    apart = jnp.min(jnp.where(own, jnp.inf, height), axis=1) - jnp.max(jnp.where(own, height, -jnp.inf), axis=1)
    edges = _edges(A, B, a, a_normals, b, b_normals)
    along = dots(normals, edges.across[None])[:, 0] * np.where(of_second, -1, 1)
    by_edges = edges.apart > jnp.max(apart) + jnp.sqrt(eps) * size
    flat = by_edges & (jnp.max(along) > np.cos(FLAT))
    # Ties, but for rounding, are decided for the first solid, so that the choice does not flicker.
    reference = argmax(jnp.where(flat, along, apart / size) - ROUNDING * eps * of_second)
    normal = normals[reference]
    same = of_second == jnp.asarray(of_second)[reference]
    incident = argmax(jnp.where(same, -jnp.inf, -dots(normals, normal[None])[:, 0]))

    loops = loop_tables(A, B)
    sides, others = (jnp.stack([jnp.asarray(table)[face] for table in loops]) for face in (reference, incident))
    slots = A.faces.shape[1] + B.faces.shape[1]
    source, ends, active = _clipped(vertices, sides, others, normal, ROUNDING * eps * size, slots)
    by_edges = by_edges & ~flat
    return Touching(
        faces=jnp.stack([reference, incident]),
        source=jnp.where(by_edges, jnp.asarray(EDGES, INDEX), source),
        ends=jnp.where(by_edges, edges.ends[:, None], ends),
        sign=edges.sign,
        active=jnp.where(by_edges, edges.met & (np.arange(slots) == 0), active),
    )


class _Edges(NamedTuple):
    across: Real  # common normal, away from the first solid
    apart: Real
    ends: Real
    sign: Real
    met: Real  # whether the closest points of the two lines belong to the edges


def _edges(A: Topology, B: Topology, a, a_normals, b, b_normals) -> _Edges:
    """The pair of edges along whose common normal the solids are farthest apart, or overlap least.

    The common normal of two edges along u and v supports both solids where the arcs between the normals of their faces
    cross on the sphere of directions: if ``u . B_left``, ``-u . B_right``, ``v . A_left``, ``-v . A_right`` have one
    sign.
    """
    dtype = a.dtype
    hair = jnp.sqrt(jnp.finfo(dtype).eps)  # the common normal of edges closer to parallel is nothing but rounding
    (p, next_p), (q, next_q) = a[A.edges.T], b[B.edges.T]
    u_length, v_length = (jnp.sqrt(jnp.sum(x**2, axis=1)) for x in (next_p - p, next_q - q))
    u, v = (next_p - p) / u_length[:, None], (next_q - q) / v_length[:, None]
    over, under = dots(u, b_normals), dots(a_normals, v)
    (a_left, a_right), (b_left, b_right) = A.sides.T, B.sides.T
    arcs = jnp.stack([over[:, b_left], -over[:, b_right], under[a_left], -under[a_right]])
    sign = (jnp.min(arcs, axis=0) > hair).astype(dtype) - (jnp.max(arcs, axis=0) < -hair).astype(dtype)
    square = jnp.sum(cross(u[:, None], v[None]) ** 2, axis=2)
    reach = dots(u, cross(v, q)) + dots(cross(u, p), v)  # (u x v) . (q - p)
    apart = jnp.where(sign == 0.0, -jnp.inf, sign * reach / jnp.sqrt(jnp.maximum(square, hair**2)))

    best = argmax(apart.reshape(-1))
    i, j = best // len(B.edges), best % len(B.edges)
    u, v, between, sign = u[i], v[j], q[j] - p[i], sign[i, j]
    across = cross(u, v)
    square = jnp.maximum(jnp.sum(across**2), hair**2)
    places = jnp.stack([jnp.sum(cross(between, v) * across), jnp.sum(cross(between, u) * across)]) / square
    places = places / jnp.stack([u_length[i], v_length[j]])
    ends = jnp.concatenate([jnp.asarray(A.edges, INDEX)[i], jnp.asarray(B.edges + len(a), INDEX)[j]])
    met = jnp.all((places > -hair) & (places < 1.0 + hair))
    return _Edges(sign * across / jnp.sqrt(square), apart[i, j], ends, sign, met)


def _clipped(vertices, reference, incident, normal, hair, slots):
    """Corners of the overlap of two faces, seen along the normal of the first; loops are `[start or end, edge]`.

    Of edges that lie on each other, but for rounding, no corner must be lost, nor put where the lines cross far away:
    the incident edges are clipped against sides two hairs outside; an end that the sides themselves would put beyond
    the other end is no point; and corners of the reference face count from one hair inside.
    """
    (a, next_a), (b, next_b) = vertices[reference], vertices[incident]
    a_real, b_real = reference[0] != reference[1], incident[0] != incident[1]
    outward = cross(_direction(next_a - a, a_real), normal[None])
    offset = jnp.sum(outward * a, axis=1)[:, None]
    beyond, next_beyond = dots(outward, b) - offset, dots(outward, next_b) - offset  # [side, edge]
    change = jnp.where(beyond == next_beyond, 1.0, beyond - next_beyond)
    place, wide = beyond / change, (beyond - 2.0 * hair) / change
    starts, stops = beyond <= 2.0 * hair, next_beyond <= 2.0 * hair
    enter, leave = jnp.where(~starts & stops, wide, -1.0), jnp.where(starts & ~stops, wide, 2.0)
    first, last = argmax(enter), argmax(-leave)
    start, stop = jnp.max(enter, axis=0), jnp.min(leave, axis=0)
    kept = b_real & jnp.all(starts | stops, axis=0) & (start <= stop)
    entered, left = (jnp.take_along_axis(place, side[None], axis=0)[0] for side in (first, last))
    entered = kept & ((start < 0.0) | (entered <= jnp.minimum(stop, 1.0)))
    left = kept & (stop < 2.0) & (left >= jnp.maximum(start, 0.0))
    inward = cross(normal[None], _direction(next_b - b, b_real))
    out = dots(inward, a) - jnp.sum(inward * b, axis=1)[:, None]  # [edge, corner]
    within = a_real & jnp.all((out < -hair) | ~b_real[:, None], axis=0)

    every = jnp.arange(len(a), dtype=INDEX)
    sources = [jnp.full_like(every, BELOW), jnp.where(start < 0.0, CORNER, CROSSING), jnp.full_like(every, CROSSING)]
    side = jnp.concatenate([every, first, last])
    exists = jnp.concatenate([within, entered, left])
    table = [jnp.concatenate(sources)[None].astype(INDEX), reference[:, side], jnp.tile(incident, 3)]
    chosen = exists[None] & (jnp.cumsum(exists)[None] == np.arange(1, slots + 1)[:, None])
    found = jnp.where(chosen[None], jnp.concatenate(table)[:, None], jnp.zeros((), INDEX))
    found = jnp.sum(found, axis=2, dtype=INDEX)
    return found[0], found[1:], jnp.any(chosen, axis=1)


def _direction(u, real):
    return u / jnp.sqrt(jnp.where(real, jnp.sum(u**2, axis=1), 1.0))[:, None]


def loop_tables(*solids: Topology) -> tuple[np.ndarray, np.ndarray]:
    """Vertices at the starts and at the ends of the edges of all faces of the solids, two arrays `[face, edge]`."""
    size = max(solid.faces.shape[1] for solid in solids)
    before, rows = 0, []
    for solid in solids:
        rows.append(np.pad(solid.faces + before, ((0, 0), (0, size - solid.faces.shape[1])), mode="edge"))
        before += solid.faces.max() + 1
    start = np.concatenate(rows).astype(INDEX)
    return start, np.roll(start, -1, axis=1)


def argmax(x: Real) -> Real:
    """Place of the largest along the first axis."""
    return lax.argmax(x, 0, INDEX)


def cross(u: Real, v: Real) -> Real:
    """Products of vectors along the last axis."""
    (a, b, c), (d, e, f) = (jnp.moveaxis(x, -1, 0) for x in (u, v))
    return jnp.stack([b * f - c * e, c * d - a * f, a * e - b * d], axis=-1)


def dots(u: Real, v: Real) -> Real:
    """Of every row of u with every row of v. No matrix product: XLA cannot put these into one kernel."""
    return jnp.sum(u[:, None] * v[None], axis=2)
