"""A path as an acceleration spline that starts from rest, integrated twice."""

from typing import NamedTuple

import numpy as np

DEGREE = 3
FIRST_INTERVAL = 0.004
"""s. A released platform accelerates at once and then ever less: intervals grow from this by GROWTH."""
GROWTH = 1.6


class Path(NamedTuple):
    """Acceleration, velocity, displacement: of one path `[sample]` or of the basis `[sample, coefficient]`."""

    a: np.ndarray
    v: np.ndarray
    z: np.ndarray


class PathBasis:
    """Paths that rest before s = 0: a(s) = sum_j c_j B_j(s), v and z its integrals."""

    def __init__(self, breaks: np.ndarray):
        from scipy.interpolate import BSpline

        knots = np.concatenate([np.full(DEGREE, breaks[0]), breaks, np.full(DEGREE, breaks[-1])])
        self.count = len(knots) - DEGREE - 1
        self.last = breaks[-1]
        self._a = BSpline(knots, np.eye(self.count), DEGREE)
        self._v = self._a.antiderivative()
        self._z = self._v.antiderivative()
        self._jerk = self._a.derivative()

    def matrices(self, s: np.ndarray) -> Path:
        """The basis at times `s` (s, from the onset)."""
        return Path(*(self._at(spline, s) for spline in (self._a, self._v, self._z)))

    def jerk(self, s: np.ndarray) -> np.ndarray:
        """Derivative of the acceleration."""
        return self._at(self._jerk, s)

    def path(self, s: np.ndarray, coefficients: np.ndarray) -> Path:
        """The path with these coefficients (m/s^2)."""
        return Path(*(B @ coefficients for B in self.matrices(s)))

    def fitted(self, s: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Coefficients of the path closest to a displacement."""
        return np.linalg.lstsq(self.matrices(s).z, z, rcond=None)[0]

    def _at(self, spline, s: np.ndarray) -> np.ndarray:
        return spline(np.clip(s, 0.0, self.last)) * (s >= 0)[:, None]


def path_basis(window: float) -> PathBasis:
    """Basis for a window after the onset, with intervals that grow from FIRST_INTERVAL.

    A cubic acceleration on these intervals follows a released platform of 25 Hz to 0.3 % of its largest
    acceleration.
    """
    breaks, width = [0.0], FIRST_INTERVAL
    while breaks[-1] + width < window:
        breaks.append(breaks[-1] + width)
        width *= GROWTH
    return PathBasis(np.array([*breaks, window]) if window - breaks[-1] > 0.5 * FIRST_INTERVAL else np.array(breaks))
