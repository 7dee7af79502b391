"""Prisms as polytopes: corners, faces and edges."""

from functools import lru_cache
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.spatial import Pose
from icjax.typing import Float, Real, Scalar


class Topology(NamedTuple):
    """What of a polytope is no place.

    **Fields**: `faces` corners of each, `[face, corner]`, counter-clockwise from outside; where there are fewer, the
    last one is repeated. `edges` both ends, `[edge, 2]`; `sides` the faces to the left and to the right of each, seen
    from outside, `[edge, 2]`.
    """

    faces: np.ndarray
    edges: np.ndarray
    sides: np.ndarray


class Polytope(eqx.Module):
    """Convex solid with plane faces: a prism over an outline of so many corners, lower end first.

    **Fields**: `vertices` m; `normals` of the faces, outward, unit; `corners` of the outline.
    """

    vertices: Float[Real, "vertex 3"]
    normals: Float[Real, "face 3"]
    corners: int = eqx.field(static=True)

    @property
    def topology(self) -> Topology:
        """Faces (sides, lower, upper end) and edges."""
        return prism_topology(self.corners)

    def moved(self, pose: Pose) -> "Polytope":
        """The same solid after a motion."""
        R = pose.rotation
        return Polytope(self.vertices @ R.T + pose.position[None], self.normals @ R.T, self.corners)


def prism(outline: Float[Real, "corner 2"], outward: Float[Real, "corner 2"], half_length: Scalar) -> Polytope:
    """Of an outline, counter-clockwise, m, with the unit normals of its edges, and half the length along z, m."""
    count, zero = outline.shape[0], jnp.zeros_like(outline[:, 0])
    ends = half_length * jnp.asarray(np.repeat([-1.0, 1.0], count), outline.dtype)
    vertices = jnp.concatenate([jnp.concatenate([outline, outline]), ends[:, None]], axis=1)
    sides = jnp.concatenate([outward, zero[:, None]], axis=1)
    caps = jnp.asarray([[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]], outline.dtype)
    return Polytope(vertices, jnp.concatenate([sides, caps]), count)


@lru_cache
def prism_topology(count: int) -> Topology:
    """Of a prism over an outline of so many corners."""
    low = np.arange(count)
    next_low, high, next_high = np.roll(low, -1), low + count, np.roll(low, -1) + count
    loops = [*np.stack([low, next_low, next_high, high], axis=1), low[::-1], high]
    size = max(count, 4)
    faces = np.stack([np.pad(loop, (0, size - len(loop)), mode="edge") for loop in loops])
    side, before = low, np.roll(low, 1)
    lower, upper = np.full(count, count), np.full(count, count + 1)
    edges = [(low, next_low), (next_high, high), (low, high)]
    sides = [(side, lower), (side, upper), (before, side)]
    return Topology(faces, *(np.concatenate([np.stack(pair, axis=1) for pair in table]) for table in (edges, sides)))
