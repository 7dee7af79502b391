"""Exact distance of a grid of points from a closed surface of triangles."""

import jax
import jax.numpy as jnp
import numpy as np

from icjax.typing import Float, Int, Real

_BLOCK = 4
"""Nodes along the edge of a block, for which the triangles that can be nearest are chosen together."""

_AT_ONCE = 4_000_000


def grid_points(origin: Float[Real, "3"], spacing: float, shape: tuple[int, ...]) -> Float[np.ndarray, "... 3"]:
    """Nodes of a grid, m, `[*shape, 3]`."""
    axes = (start + spacing * np.arange(count) for start, count in zip(origin, shape, strict=True))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def grid_distances(
    origin: Float[Real, "3"], spacing: float, shape: tuple[int, ...], triangles: Float[np.ndarray, "triangle 3 3"]
) -> Float[np.ndarray, "..."]:
    """Distance of every node from the nearest triangle, without sign, m.

    Of a block of nodes within the radius r about its middle only those triangles can be nearest that are at most 2 r
    farther from the middle than the nearest one.
    """
    blocks = tuple(-(-count // _BLOCK) for count in shape)
    points = grid_points(origin, spacing, tuple(_BLOCK * count for count in blocks))
    split = points.reshape(blocks[0], _BLOCK, blocks[1], _BLOCK, blocks[2], _BLOCK, 3)
    split = split.transpose(0, 2, 4, 1, 3, 5, 6).reshape(-1, _BLOCK**3, 3)
    middles = split.mean(axis=1)
    reach = spacing * (_BLOCK - 1) * np.sqrt(3.0) * (1 + 1e-9)
    found = np.empty(split.shape[:2])
    for part in np.array_split(np.arange(len(middles)), len(middles) * len(triangles) // _AT_ONCE + 1):
        away = np.sqrt(_all_squares(middles[part], triangles))
        near = away <= away.min(axis=1, keepdims=True) + reach
        for block, row in zip(part, near, strict=True):
            chosen = np.flatnonzero(row)
            chosen = np.pad(chosen, (0, 2 ** int(np.ceil(np.log2(len(chosen)))) - len(chosen)), mode="edge")
            found[block] = _least_squares(split[block], triangles[chosen])
    found = np.sqrt(found).reshape(*blocks, _BLOCK, _BLOCK, _BLOCK).transpose(0, 3, 1, 4, 2, 5)
    return found.reshape(points.shape[:3])[: shape[0], : shape[1], : shape[2]]


@jax.jit
def _all_squares(points, triangles):
    return jax.vmap(lambda p: _square(p, jnp.moveaxis(triangles, 0, -1)))(points)


@jax.jit
def _least_squares(points, triangles):
    return jnp.min(_all_squares(points, triangles), axis=1)


def _square(p, triangles):
    """Of a point from triangles `[corner, axis, triangle]`: over the face, or from the nearest edge."""
    corners = [tuple(corner) for corner in triangles]
    sides = [_less(after, corner) for after, corner in zip(corners[1:] + corners[:1], corners, strict=True)]
    normal = _cross(sides[0], sides[1])
    over, nearest = _dot(normal, normal) > 0.0, jnp.inf
    for corner, side in zip(corners, sides, strict=True):
        away, square = _less(tuple(p), corner), _dot(side, side)
        over = over & (_dot(_cross(normal, side), away) >= 0.0)
        place = jnp.clip(_dot(side, away) / jnp.where(square > 0.0, square, 1.0), 0.0, 1.0)
        rest = _less(away, tuple(place * x for x in side))
        nearest = jnp.minimum(nearest, _dot(rest, rest))
    height = _dot(normal, _less(tuple(p), corners[0]))
    return jnp.where(over, height**2 / jnp.where(over, _dot(normal, normal), 1.0), nearest)


def _less(a, b):
    return tuple(x - y for x, y in zip(a, b, strict=True))


def _dot(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a, b):
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def windings(
    origin: Float[Real, "3"], spacing: float, shape: tuple[int, ...], triangles: Float[np.ndarray, "triangle 3 3"]
) -> Int[np.ndarray, "..."]:
    """How often the surface is wound around each node of a grid: zero outside, one inside a solid.

    The signed count of triangles above the node. The columns of nodes are moved aside by a hair, so that they meet no
    edge; a node that lies within it of the surface may get the sign of its neighbour.
    """
    hair = 1e-7 * np.array([0.7548776662, 0.5698402910])
    flat = (triangles[:, :, :2] - origin[:2]) / spacing - hair
    first = np.clip(np.ceil(flat.min(axis=1)).astype(int), 0, None)
    last = np.minimum(np.floor(flat.max(axis=1)).astype(int), np.array(shape[:2]) - 1)
    wide, high = np.maximum(last - first + 1, 0).T
    owner = np.repeat(np.arange(len(triangles)), wide * high)
    number = np.arange(len(owner)) - np.repeat(np.cumsum(wide * high) - wide * high, wide * high)
    column = first[owner] + np.stack([number // high[owner], number % high[owner]], axis=1)
    a, b, c = (flat[owner, corner] - column for corner in range(3))
    areas = np.stack([_area(b, c), _area(c, a), _area(a, b)])
    total = areas.sum(axis=0)
    met = (np.all(areas > 0, axis=0) | np.all(areas < 0, axis=0)) & (total != 0)
    owner, column, areas, total = owner[met], column[met], areas[:, met], total[met]
    height = np.sum(areas / total * triangles[owner, :, 2].T, axis=0)
    below = np.clip(np.ceil((height - origin[2]) / spacing).astype(int), 0, shape[2])  # nodes that it is above
    count = np.zeros((*shape[:2], shape[2] + 1), int)
    np.add.at(count, (column[:, 0], column[:, 1], below), np.sign(total).astype(int))
    return count[:, :, ::-1].cumsum(axis=2)[:, :, ::-1][:, :, 1:]


def _area(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
