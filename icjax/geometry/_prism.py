"""Prisms over convex outlines: wedges, hexagonal rods, ramps."""

import math

import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from icjax.geometry._polytope import Polytope, prism
from icjax.geometry._shape import MassProperties, Probes, Shape, corner, length_and_direction, one_of
from icjax.typing import Float, Real, Scalar, Vector3


class Prism(Shape):
    """Convex outline in the x-y plane, drawn out along z.

    **Fields**: `outline` its corners, counter-clockwise, m; `half_length` from the origin to an end, m.

    **Errors**: `ValueError` for fewer than three corners, or an outline that is not convex or goes clockwise.
    """

    outline: Float[Real, "corner 2"]
    half_length: Scalar

    def __init__(self, outline: Float[Real, "corner 2"], half_length: Scalar | float):
        self.outline, self.half_length = jnp.asarray(outline), jnp.asarray(half_length)
        if self.outline.shape[0] < 3:
            raise ValueError(f"outline has {self.outline.shape[0]} corners; a prism needs at least three")
        if not isinstance(self.outline, Tracer):
            edge = np.roll(self.outline, -1, axis=0) - np.asarray(self.outline)
            following = np.roll(edge, -1, axis=0)
            turn = edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0]
            angle = np.arctan2(turn, np.sum(edge * following, axis=1))
            if not (np.all(turn > 0) and abs(np.sum(angle) - 2 * math.pi) < 1e-6):
                raise ValueError("outline must be convex and go counter-clockwise, without corners of 180 degrees")

    def _from_the_outline(self, p: Float[Real, "2"]):
        start = self.outline
        edge = jnp.roll(start, -1, axis=0) - start
        size = jnp.sqrt(jnp.sum(edge**2, axis=1))
        along = edge / size[:, None]
        outward = jnp.stack([along[:, 1], -along[:, 0]], axis=1)
        offset = jnp.sum((p[None] - start) * outward, axis=1)
        inside = jnp.all(offset <= 0.0)
        place = jnp.clip(jnp.sum((p[None] - start) * along, axis=1), 0.0, size)
        away = p[None] - start - place[:, None] * along
        square = jnp.sum(away**2, axis=1)
        # Outside, the edge that is nearest; of two that share a corner, whichever.
        chosen = one_of(jnp.where(inside, jnp.argmax(offset), jnp.argmin(square)), start.shape[0])
        offset = jnp.sum(jnp.where(chosen, offset, 0.0))
        outward = jnp.sum(jnp.where(chosen[:, None], outward, 0.0), axis=0)
        away = jnp.sum(jnp.where(chosen[:, None], away, 0.0), axis=0)
        over = jnp.any(chosen & (place > 0.0) & (place < size))
        straight = inside | over
        distance, direction = length_and_direction(jnp.where(straight, outward, away))
        return jnp.where(straight, offset, distance), direction

    def _corner(self, p: Vector3):
        out, sideways = self._from_the_outline(p[:2])
        side = jnp.where(p[2] < 0.0, -1.0, 1.0).astype(p.dtype)
        distance, gradient = corner(jnp.stack([out, side * p[2] - self.half_length]))
        return distance, jnp.concatenate([gradient[0] * sideways, (gradient[1] * side)[None]])

    def signed_distance(self, p: Vector3) -> Scalar:
        """Distance of `p` (m) from the surface, negative inside, m."""
        return self._corner(p)[0]

    def normal(self, p: Vector3) -> Vector3:
        """Outward unit normal at the point of the surface closest to `p`; outside an edge, from there to `p`."""
        return self._corner(p)[1]

    def mass_properties(self) -> MassProperties:
        """By Green's theorem: sums over the triangles between the origin and the edges."""
        a, b = self.outline, jnp.roll(self.outline, -1, axis=0)
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        area = jnp.sum(cross) / 2.0
        centre = jnp.sum(cross[:, None] * (a + b), axis=0) / (6.0 * area)
        a, b = a - centre[None], b - centre[None]
        pairs = a[:, :, None] * a[:, None, :] + b[:, :, None] * b[:, None, :]
        pairs = pairs + (a[:, :, None] * b[:, None, :] + b[:, :, None] * a[:, None, :]) / 2.0
        cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
        second = jnp.sum(cross[:, None, None] * pairs, axis=0) / 12.0  # integral of x x^T over the outline
        volume = 2.0 * self.half_length * area
        moments = jnp.zeros((3, 3), second.dtype).at[:2, :2].set(2.0 * self.half_length * second)
        moments = moments.at[2, 2].set(volume * self.half_length**2 / 3.0)
        inertia = jnp.trace(moments) * jnp.eye(3, dtype=second.dtype) - moments
        return MassProperties(volume, jnp.concatenate([centre, jnp.zeros_like(centre[:1])]), inertia)

    def probes(self, direction: Vector3) -> Probes:
        """All corners."""
        count = self.outline.shape[0]
        ends = self.half_length * jnp.repeat(jnp.array([-1.0, 1.0], self.outline.dtype), count)
        centre = jnp.concatenate([jnp.tile(self.outline, (2, 1)), ends[:, None]], axis=1)
        return Probes(centre, jnp.zeros(2 * count, self.outline.dtype))

    def polytope(self) -> Polytope:
        """Corners, faces and edges."""
        edge = jnp.roll(self.outline, -1, axis=0) - self.outline
        along = edge / jnp.sqrt(jnp.sum(edge**2, axis=1, keepdims=True))
        return prism(self.outline, jnp.stack([along[:, 1], -along[:, 0]], axis=1), self.half_length)


def wedge(width: float, height: float, depth: float, tilt: float) -> Prism:
    """Box whose faces at +x and -x lean towards each other: closer together at the top (+y) by `tilt` each.

    **Arguments**: `width` at half the height, `height` along y, `depth` along z, m; `tilt` rad, each face.

    **Errors**: `ValueError` where the faces would meet below the top or at the bottom.
    """
    lean = height / 2.0 * math.tan(tilt)
    if not (abs(lean) < width / 2.0 and height > 0 and depth > 0):
        raise ValueError(
            f"a wedge of width {width:g}, height {height:g} and depth {depth:g} m cannot have faces tilted by {tilt:g}"
        )
    half, top = width / 2.0, height / 2.0
    outline = [(-half - lean, -top), (half + lean, -top), (half - lean, top), (-half + lean, top)]
    return Prism(np.array(outline), depth / 2.0)
