"""B-splines as matrices: a movement as few numbers."""

import numpy as np

from icjax.typing import Float, Real


def spline_basis(time: Float[Real, " time"], count: int, degree: int = 3) -> Float[np.ndarray, "time basis"]:
    """Values of `count` B-splines at given times, on uniform knots from the first time to the last (both clamped).

    The functions add to one everywhere; the first is one at the first time, the last at the last.

    **Arguments**: `time` s, increasing; `count` of functions, above `degree`.

    **Errors**: `ValueError` for times that do not increase and a count that is too small.

    **Source**: de Boor 1978, A practical guide to splines; the values are scipy's.
    """
    from scipy.interpolate import BSpline

    time = np.asarray(time, float)
    if time.size < 2 or not (np.isfinite(time).all() and np.all(np.diff(time) > 0)):
        raise ValueError("time must be two or more finite numbers that increase")
    if not count > degree >= 0:
        raise ValueError(f"count = {count}: a spline of degree {degree} needs at least {degree + 1} functions")
    ends = np.linspace(time[0], time[-1], count - degree + 1)
    knots = np.concatenate([np.full(degree, time[0]), ends, np.full(degree, time[-1])])
    return BSpline.design_matrix(time, knots, degree).toarray()
