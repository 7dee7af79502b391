"""Solids made of several."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.geometry._shape import MassProperties, Probes, Shape
from icjax.typing import Scalar, Vector3


class Union(Shape):
    """What belongs to any of its parts: a bulb of a ball and a cylinder, which need not be convex.

    Outside, distance and normal are exact; inside, the surface may be farther than stated.

    **Fields**: `parts`, shapes in one frame, [`Placed`] or at its origin.

    **Errors**: `TypeError` for what is no shape, `ValueError` for no part.
    """

    parts: tuple[Shape, ...] = eqx.field(converter=tuple)

    def __init__(self, parts: Sequence[Shape]):
        self.parts = tuple(parts)
        if not self.parts:
            raise ValueError("parts is empty; a union needs one shape at least")
        for part in self.parts:
            if not isinstance(part, Shape):
                raise TypeError(f"parts: {part!r} is no shape of icjax.geometry")

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the nearest part, negative inside, m."""
        return jnp.min(jnp.stack([part.signed_distance(p) for part in self.parts]))

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal of the part nearest to `p`, at its point closest to it."""
        nearest = jnp.argmin(jnp.stack([part.signed_distance(p) for part in self.parts]))
        normals = jnp.stack([part.normal(p) for part in self.parts])
        return jnp.sum(jnp.where((jnp.arange(len(self.parts)) == nearest)[:, None], normals, 0.0), axis=0)

    def mass_properties(self) -> MassProperties:
        """Sums over the parts: where these overlap, they count twice."""
        volumes, centres, inertias = (
            jnp.stack(rows) for rows in zip(*(p.mass_properties() for p in self.parts), strict=True)
        )
        volume = jnp.sum(volumes)
        com = jnp.sum(volumes[:, None] * centres, axis=0) / volume
        arms = centres - com[None]
        square = jnp.sum(arms**2, axis=1)[:, None, None] * np.eye(3)[None] - arms[:, :, None] * arms[:, None, :]
        return MassProperties(volume, com, jnp.sum(inertias + volumes[:, None, None] * square, axis=0))

    def probes(self, direction: Vector3) -> Probes:
        """Those of all parts."""
        centres, radii = zip(*(part.probes(direction) for part in self.parts), strict=True)
        return Probes(jnp.concatenate(centres), jnp.concatenate(radii))
