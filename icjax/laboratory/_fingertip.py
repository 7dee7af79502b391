"""Soft fingertip on a plate: a spring law with Coulomb friction that sticks without creeping.

Every shape keeps its own spring. With depth d of the undeformed sphere and tangential stretch s since the skin
last stuck,

    f_n = k d (1 + a d'),   f_t = -k s - c s',   |f_t| <= mu f_n  (s relaxes to the limit where it slides),

the law of Hunt and Crossley (1975) in the normal and of Cundall and Strack (1979) in the tangential direction. The
patch of skin that touches stays behind the bone by s. All motion lies in the plane y = 0.
"""

import math

from icjax.laboratory._subject import Subject
from icjax.laboratory._surface import Surface

NORMAL_LOSS = 2.0
"""a, s/m: about 30 % more force while pressing in at 0.15 m/s."""

TANGENTIAL_DAMPING = 0.6
"""c, Ns/m."""


class Fingertip:
    """Contact state of one run; call `touch` once a step with positions relative to the middle of the plate's top."""

    def __init__(self, subject: Subject, surface: Surface):
        self._radius = subject.pad_radius
        self._stiffness = subject.pad_stiffness
        self._friction = surface.friction
        self._bump = surface.bump
        self._height = surface.height
        self._last: tuple[float, float] | None = None
        self._depth = [0.0, 0.0]
        self._stretch = [0.0, 0.0]

    def touch(self, x: float, z: float, dt: float) -> tuple[float, float, float, float]:
        """Force on the finger (x, z; N) and the point it acts at (x, z; m) for the pad centre now at (x, z)."""
        last = self._last or (x, z)
        self._last = (x, z)
        move = (x - last[0], z - last[1])
        total_x = total_z = weighted_x = weighted_z = weight = 0.0
        for slot in (0, 1) if self._bump is not None else (0,):
            if slot == 0:
                distance, normal_x, normal_z = z, 0.0, 1.0
            else:
                distance, normal_x, normal_z = self._over_bump(x, z)
            depth = self._radius - distance
            if depth <= 0.0:
                self._depth[slot] = self._stretch[slot] = 0.0
                continue
            rate = (depth - self._depth[slot]) / dt
            self._depth[slot] = depth
            normal = self._stiffness * depth * max(0.0, 1.0 + NORMAL_LOSS * rate)
            # The tangent is the normal turned clockwise: (1, 0) on the plate.
            slip = (move[0] * normal_z - move[1] * normal_x) / dt
            stretch = self._stretch[slot] + slip * dt
            tangential = -self._stiffness * stretch - TANGENTIAL_DAMPING * slip
            limit = self._friction * normal
            if abs(tangential) > limit:
                tangential = math.copysign(limit, tangential)
                stretch = math.copysign(min(abs(stretch), limit / self._stiffness), stretch)
            self._stretch[slot] = stretch
            force_x = normal * normal_x + tangential * normal_z
            force_z = normal * normal_z - tangential * normal_x
            total_x += force_x
            total_z += force_z
            weighted_x += normal * (x - distance * normal_x - stretch * normal_z)
            weighted_z += normal * (z - distance * normal_z + stretch * normal_x)
            weight += normal
        if weight == 0.0:
            return 0.0, 0.0, x, z - self._radius
        return total_x, total_z, weighted_x / weight, weighted_z / weight

    def _over_bump(self, x: float, z: float) -> tuple[float, float, float]:
        """Distance of (x, z) from the bump and its outward normal there."""
        bump = self._bump
        assert bump is not None
        x, z = x - bump.centre[0], z - (bump.centre[2] - self._height)
        near = self._radius + 0.001
        if abs(x) > bump.radii[0] + near or abs(z) > bump.radii[2] + near:
            return math.inf, 0.0, 1.0
        on_x, on_z = closest_on_ellipse(x, z, bump.radii[0], bump.radii[2])
        away_x, away_z = x - on_x, z - on_z
        distance = math.hypot(away_x, away_z)
        if distance < 1e-9:
            return math.inf, 0.0, 1.0
        return distance, away_x / distance, away_z / distance


def closest_on_ellipse(x: float, z: float, a: float, b: float) -> tuple[float, float]:
    """Nearest point of the ellipse with semi-axes a, b, by circles of curvature (error below 1 nm here)."""
    point_x, point_z = abs(x), abs(z)
    cos = sin = math.sqrt(0.5)
    for _ in range(8):
        centre_x = (a * a - b * b) * cos**3 / a
        centre_z = (b * b - a * a) * sin**3 / b
        radius = math.hypot(a * cos - centre_x, b * sin - centre_z)
        out_x, out_z = point_x - centre_x, point_z - centre_z
        ratio = radius / max(math.hypot(out_x, out_z), 1e-12)
        cos = min(1.0, max(0.0, (out_x * ratio + centre_x) / a))
        sin = min(1.0, max(0.0, (out_z * ratio + centre_z) / b))
        length = math.hypot(cos, sin)
        cos, sin = cos / length, sin / length
    return math.copysign(a * cos, x), math.copysign(b * sin, z)
