"""Box with its exact signed distance."""

import itertools

import jax.numpy as jnp
import numpy as np

from icjax.geometry._polytope import Polytope, prism
from icjax.geometry._shape import MassProperties, Probes, Shape, corner
from icjax.typing import Scalar, Vector3

_CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
_OUTLINE = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
_OUTWARD = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])


class Box(Shape):
    """Box about the origin, its edges along the axes.

    **Fields**: `half_sizes` half the edges, m, positive.
    """

    half_sizes: Vector3

    def __init__(self, half_sizes: Vector3):
        self.half_sizes = jnp.asarray(half_sizes)

    def _corner(self, p: Vector3):
        side = jnp.where(p < 0.0, -1.0, 1.0).astype(p.dtype)
        distance, gradient = corner(side * p - self.half_sizes)
        return distance, side * gradient

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return self._corner(p)[0]

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`; outside an edge, from there to `p`."""
        return self._corner(p)[1]

    def mass_properties(self) -> MassProperties:
        """V = 8 a b c and V (b^2 + c^2) / 3 about the first axis."""
        square = self.half_sizes**2
        volume = 8.0 * jnp.prod(self.half_sizes)
        return MassProperties(volume, jnp.zeros_like(square), jnp.diag(volume / 3.0 * (jnp.sum(square) - square)))

    def probes(self, direction: Vector3) -> Probes:
        """The eight corners."""
        dtype = self.half_sizes.dtype
        return Probes(self.half_sizes[None] * jnp.asarray(_CORNERS, dtype), jnp.zeros(8, dtype))

    def polytope(self) -> Polytope:
        """Corners, faces and edges."""
        dtype = self.half_sizes.dtype
        outline = self.half_sizes[None, :2] * jnp.asarray(_OUTLINE, dtype)
        return prism(outline, jnp.asarray(_OUTWARD, dtype), self.half_sizes[2])
