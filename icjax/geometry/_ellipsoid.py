"""Ellipsoid with its exact signed distance."""

import math

import jax
import jax.numpy as jnp

from icjax.geometry._shape import MassProperties, Probes, Shape
from icjax.typing import Float, Real

_MAX_ITERATIONS = 100
_SMOOTHING_STEPS = 2  # Newton steps kept in the derivative: exact to third order (errors e -> e^2 -> e^4)


class Ellipsoid(Shape):
    r"""Solid ellipsoid $\sum_i (y_i / r_i)^2 \le 1$ with $y = R^T (p - c)$.

    The closest point is $x_i = r_i^2 y_i / (t + r_i^2)$, where $t$ is the largest root of the secular equation
    $\sum_i (r_i y_i / (t + r_i^2))^2 = 1$ (Eberly, *Distance from a Point to an Ellipse, an Ellipsoid*, 2013).
    Then $p - x = t\, u$ with $u_i = y_i / (t + r_i^2)$ along the normal, so the signed distance is
    $t \lVert u \rVert$: smooth through the surface. Only on the focal set inside (the centre of a sphere, for
    example) is the closest point not unique; one of them is returned there and derivatives stay finite.

    **Arguments**

    - `centre`: m, world.
    - `rotation`: columns are the axes of the ellipsoid in world.
    - `radii`: half-axes, m, all positive.
    """

    centre: Float[Real, "3"]
    rotation: Float[Real, "3 3"]
    radii: Float[Real, "3"]

    def __init__(self, centre: Float[Real, "3"], rotation: Float[Real, "3 3"], radii: Float[Real, "3"]):
        self.centre = jnp.asarray(centre)
        self.rotation = jnp.asarray(rotation)
        self.radii = jnp.asarray(radii)

    def signed_distance(self, p: Float[Real, "3"]) -> Float[Real, ""]:
        """Distance of `p` (m) from the surface, negative inside, m. Its gradient is `normal(p)`."""
        t, u = self._closest(p)
        return t * jnp.sqrt(jnp.sum(u**2))

    def closest_point(self, p: Float[Real, "3"]) -> Float[Real, "3"]:
        """Point of the surface closest to `p`, m."""
        _, u = self._closest(p)
        return self.centre + self.rotation @ (self.radii**2 * u)

    def normal(self, p: Float[Real, "3"]) -> Float[Real, "3"]:
        """Outward unit normal at the point of the surface closest to `p`."""
        _, u = self._closest(p)
        return self.rotation @ (u / jnp.sqrt(jnp.sum(u**2)))

    def mass_properties(self) -> MassProperties:
        """V = 4 pi a b c / 3 and V (b^2 + c^2) / 5 about the first axis."""
        square = self.radii**2
        volume = 4.0 / 3.0 * math.pi * jnp.prod(self.radii)
        inertia = self.rotation @ jnp.diag(volume / 5.0 * (jnp.sum(square) - square)) @ self.rotation.T
        return MassProperties(volume, self.centre, inertia)

    def probes(self, direction: Float[Real, "3"]) -> Probes:
        """The point farthest along the direction, ``c + R r^2 d / norm(r d)`` with d in the axes of the ellipsoid."""
        scaled = self.radii * (self.rotation.T @ direction)
        farthest = self.centre + self.rotation @ (self.radii * scaled / jnp.sqrt(jnp.sum(scaled**2)))
        return Probes(farthest[None], jnp.zeros(1, farthest.dtype))

    def _closest(self, p: Float[Real, "3"]) -> tuple[Float[Real, ""], Float[Real, "3"]]:
        """The root t of the secular equation and u = y / (t + r^2); the closest point is r^2 u."""
        y = self.rotation.T @ (p - self.centre)
        smallest = jnp.argmin(self.radii)
        least = self.radii[smallest] ** 2
        excess = self.radii**2 - least
        y = _off_focal_set(y, self.radii, excess, smallest)
        # s = t + r_min^2 > 0. The root search carries no derivative; the Newton steps after it give
        # the derivatives of the implicit function.
        s = _largest_root(*jax.lax.stop_gradient((y, self.radii, excess)))
        for _ in range(_SMOOTHING_STEPS):
            s = s + _newton_step(s, y, self.radii, excess)
        return s - least, y / (s + excess)


def _off_focal_set(y, radii, excess, smallest):
    """Where the closest point is not unique, move y off the focal set along the smallest axis by a hair.

    At the smallest admitted s the secular sum without that axis is below one; its missing part is put there.
    """
    hair = jnp.sqrt(jnp.finfo(y.dtype).eps)
    s = hair * radii[smallest] ** 2
    on_axis = jnp.arange(3) == smallest
    others = jnp.sum(jnp.where(on_axis, jnp.zeros(3, y.dtype), (radii * y / (s + excess)) ** 2))
    along = (radii[smallest] * y[smallest] / s) ** 2
    degenerate = others + along < 1.0
    side = jnp.where(y[smallest] < 0.0, -1.0, 1.0).astype(y.dtype)
    missing = jax.lax.stop_gradient(side * s / radii[smallest] * jnp.sqrt(jnp.maximum(1.0 - others, 0.0)))
    return jnp.where(degenerate & on_axis, missing, y)


def _newton_step(s, y, radii, excess):
    """Newton's step for the secular equation, convex and decreasing in s."""
    terms = (radii * y / (s + excess)) ** 2
    return 0.5 * (jnp.sum(terms) - 1.0) / jnp.sum(terms / (s + excess))


def _largest_root(y, radii, excess):
    """Newton from a lower bound, where no term exceeds one: it rises monotonically to the root."""
    eps = jnp.finfo(y.dtype).eps
    start = jnp.max(radii * jnp.abs(y) - excess)

    def unfinished(carry):
        s, step, count = carry
        return (step > 2.0 * eps * s) & (count < _MAX_ITERATIONS)

    def advance(carry):
        s, _, count = carry
        step = _newton_step(s, y, radii, excess)
        return s + step, step, count + 1

    s, _, _ = jax.lax.while_loop(unfinished, advance, (start, start, jnp.zeros((), jnp.int32)))
    return s
