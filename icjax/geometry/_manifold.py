"""Where two solids touch: a fixed number of points with normals and gaps."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp

from icjax.spatial import Pose
from icjax.typing import Bool, Float, Real

APART = 1e3
"""m; the gap of a slot without a point: farther than anything."""


class Manifold(eqx.Module):
    """Points at which two solids touch, or would touch first.

    **Fields**

    - `point`: on the surface of the first solid (of a capsule, on a ball about its axis), m; the one opposite, on the
      second, is `point - gap * normal`.
    - `normal`: outward unit normal of the second solid, towards the first.
    - `gap`: between the solids along the normal, negative where they overlap, m.
    - `active`: whether there is a point; where not, the gap is a kilometre, and point and normal are finite and
      mean nothing.
    """

    point: Float[Real, "slot 3"]
    normal: Float[Real, "slot 3"]
    gap: Float[Real, " slot"]
    active: Bool[Real, " slot"]

    def moved(self, pose: Pose) -> "Manifold":
        """After a motion of both solids."""
        R = pose.rotation
        return Manifold(self.point @ R.T + pose.position[None], self.normal @ R.T, self.gap, self.active)

    def exchanged(self) -> "Manifold":
        """The second solid as the first one."""
        return Manifold(self.point - self.gap[:, None] * self.normal, -self.normal, self.gap, self.active)


def joined(manifolds: Sequence[Manifold]) -> Manifold:
    """The points of several manifolds in one."""
    names = ("point", "normal", "gap", "active")
    return Manifold(*(jnp.concatenate([getattr(item, name) for item in manifolds]) for name in names))
