"""Mass, damping and stiffness of the fingertip from its response to a perturbation (Table 2)."""

from typing import Literal, NamedTuple

import equinox as eqx
import numpy as np

from icjax.estimation._endpoint import NORMAL_95
from icjax.estimation._path import Path, path_basis
from icjax.typing import Float

PARAMETERS = ("m", "b", "k", "f0")
"""kg, Ns/m, N/m, N."""

LEAST_SAMPLES = 6
JUMP = 6.0
"""Standard deviations of the force by which it leaves rest."""
POLYNOMIAL = (9, 3)
"""Samples and degree of the sliding polynomial that the derivative method differentiates."""


class SecondOrderFit(eqx.Module):
    """`f = m z'' + b z' + k z + f0` as fitted; f is the force on the finger and z its displacement, both upward.

    **Fields**

    - `value`, `lower`, `upper` [4]: m (kg), b (Ns/m), k (N/m), f0 (N) with 95 % intervals; `covariance` [4, 4].
    - `r_squared`: of the force in the window, one less the share of its variance that the fit leaves.
    - `residual` N, RMS of the force; `autocorrelation` of successive residuals; `condition` number of the
      regressors (z'', z', z, 1), each scaled to unit length.
    - `onset` s: as fitted ("path") or given ("derivative"); `window` s.
    - `time` s, `force` N, `position` m [sample]: the window's samples as fitted, position from rest.
    """

    method: str
    value: Float[np.ndarray, "4"]
    lower: Float[np.ndarray, "4"]
    upper: Float[np.ndarray, "4"]
    covariance: Float[np.ndarray, "4 4"]
    r_squared: float
    residual: float
    autocorrelation: float
    condition: float
    onset: float
    window: float
    time: Float[np.ndarray, " sample"]
    force: Float[np.ndarray, " sample"]
    position: Float[np.ndarray, " sample"]


class _Data(NamedTuple):
    time: np.ndarray  # from the onset, rest and window
    position: np.ndarray
    force: np.ndarray
    inside: np.ndarray  # the window


def fit_second_order(
    time: Float[np.ndarray, " sample"],
    position: Float[np.ndarray, " sample"],
    force: Float[np.ndarray, " sample"],
    onset: float,
    window: float = 0.025,
    rest: float = 0.05,
    method: Literal["path", "derivative"] = "path",
    position_noise: float | None = None,
    force_noise: float | None = None,
) -> SecondOrderFit:
    """Least-squares fit of `f(t) = m z''(t) + b z'(t) + k z(t) + f0` from the onset of a perturbation on.

    - "derivative", the paper's: z is smoothed and differentiated by sliding cubic polynomials over 9 samples, f0 is
      the mean force at rest, then m, b and k follow from linear regression. Smoothing flattens z'', which makes m too
      large where the surface starts abruptly, and what noise is left in a regressor pulls its coefficient towards
      zero (errors in variables). The intervals know of neither.
    - "path": nothing is differentiated. The unknown true path is an acceleration a(t), a spline that starts at the
      onset, integrated twice; a, the onset and (m, b, k, f0) are found together so that z fits the measured position
      and m a + b v + k z + f0 the measured force, each weighted by its noise. This is maximum likelihood for
      white noise, and on noise-free data the covariance is the Cramer-Rao bound. A path known from calibration is
      used by a small `position_noise`.

    Intervals are normal, 95 %. The covariance is multiplied by (1 + r) / (1 - r) for a positive autocorrelation r of
    successive force residuals, and by their chi-square per degree of freedom where that exceeds one.

    **Arguments**

    - `time` s, evenly spaced; `position` m, upward (NaN is skipped by "path"); `force` N, on the finger, upward
      positive, unfiltered: a filter smears the onset.
    - `onset` s; "path" refines it by up to two samples. `window` s after it and `rest` s before it.
    - `position_noise` m, `force_noise` N: standard deviations; by default those found at rest.

    **Errors**: `ValueError` for series of unequal length, fewer than `LEAST_SAMPLES` samples in rest or window, a
    force that is not finite there, or (derivative) such a position.

    **Source**: Kry and Pai 2006, section 4.2 and Table 2.
    """
    data = _select(time, position, force, onset, window, rest)
    sd = (
        position_noise or float(np.nanstd(data.position[~data.inside])),
        force_noise or float(np.std(data.force[~data.inside])),
    )
    if method == "derivative":
        return _by_derivatives(data, sd, onset, window, np.asarray(position), np.asarray(time))
    if method == "path":
        return _by_path(data, sd, onset, window)
    raise ValueError(f"method = {method!r}: must be 'path' or 'derivative'")


def pool_fits(fits: tuple[SecondOrderFit, ...]) -> tuple[Float[np.ndarray, "4"], Float[np.ndarray, "4 4"]]:
    """One (m, b, k, f0) for several trials: their plain mean.

    The trials must be repetitions, same posture and grip. Weighting each by its own covariance would favour those
    whose noise happens to make m small; repetitions are equally good, so they weigh the same.

    **Returns** the values and their covariance.
    """
    if not fits:
        raise ValueError("fits is empty: nothing to pool")
    values = np.stack([np.asarray(fit.value) for fit in fits])
    return values.mean(axis=0), np.stack([np.asarray(fit.covariance) for fit in fits]).mean(axis=0) / len(fits)


def _select(time, position, force, onset: float, window: float, rest: float) -> _Data:
    time, position, force = (np.asarray(item, dtype=float) for item in (time, position, force))
    if not len(time) == len(position) == len(force):
        raise ValueError(f"time, position and force have {len(time)}, {len(position)} and {len(force)} samples")
    s = time - onset
    used = (s >= -rest) & (s <= window)
    inside = s[used] >= 0
    for name, count in (("rest", int(np.sum(~inside))), ("window", int(np.sum(inside)))):
        if count < LEAST_SAMPLES:
            raise ValueError(
                f"{name} = {rest if name == 'rest' else window:g} s holds {count} samples; {LEAST_SAMPLES} are needed"
            )
    if not np.isfinite(force[used]).all():
        raise ValueError(f"force is not finite at {time[used][~np.isfinite(force[used])][0]:g} s")
    return _Data(s[used], position[used], force[used], inside)


def _by_derivatives(data: _Data, sd, onset: float, window: float, position, time) -> SecondOrderFit:
    from scipy.signal import savgol_filter

    start = int(np.argmin(np.abs(time - (onset + data.time[0]))))
    margin = slice(max(start - POLYNOMIAL[0], 0), start + len(data.time) + POLYNOMIAL[0])
    if not np.isfinite(position[margin]).all():
        raise ValueError("position has gaps near the perturbation; the derivative method needs every sample")
    step = float(np.mean(np.diff(time[margin])))
    here = slice(start - margin.start, start - margin.start + len(data.time))
    a, v, z = (
        np.asarray(savgol_filter(position[margin], *POLYNOMIAL, deriv=order, delta=step))[here] for order in (2, 1, 0)
    )
    at_rest, rest_force = np.mean(z[~data.inside]), np.mean(data.force[~data.inside])
    z = z - at_rest
    columns = np.stack([a, v, z], axis=1)[data.inside]
    x, *_ = np.linalg.lstsq(columns, data.force[data.inside] - rest_force, rcond=None)
    value = np.append(x, rest_force)
    fitted = columns @ x + rest_force
    left = data.force[data.inside] - fitted
    information = columns.T @ columns / max(np.sum(left**2) / (len(left) - 3), sd[1] ** 2)
    covariance = np.zeros((4, 4))
    covariance[:3, :3] = np.linalg.inv(information)
    covariance[3, 3] = sd[1] ** 2 / np.sum(~data.inside)
    regressors = np.column_stack([columns, np.ones(len(columns))])
    return _result("derivative", value, covariance, data, left, fitted, z, regressors, onset, window, 1.0)


def _by_path(data: _Data, sd, onset: float, window: float) -> SecondOrderFit:
    from scipy.optimize import least_squares

    basis = path_basis(window)
    known = np.isfinite(data.position)
    f0, z0 = float(np.mean(data.force[~data.inside])), float(np.nanmean(data.position[~data.inside]))
    size = np.concatenate([[0.01, 1.0, 100.0, 0.01, 1e-4, 1e-3], np.full(basis.count, 10.0)])

    def split(x):
        x = x * size
        return x[:4], x[4], x[5], x[6:]

    def residual(x):
        (m, b, k, rest_force), at, late, a = split(x)
        path = basis.path(data.time - late, a)
        modelled = m * path.a + b * path.v + k * path.z + rest_force
        return np.concatenate([((data.position - at - path.z) / sd[0])[known], (data.force - modelled) / sd[1]])

    def jacobian(x):
        (m, b, k, _), _, late, a = split(x)
        B = basis.matrices(data.time - late)
        path = Path(B.a @ a, B.v @ a, B.z @ a)
        jerk = basis.jerk(data.time - late) @ a
        one, none = np.ones_like(data.time), np.zeros_like(data.time)
        of_z = np.column_stack([none, none, none, none, one, -path.v, B.z])
        by_onset = -(m * jerk + b * path.a + k * path.v)
        of_f = np.column_stack([path.a, path.v, path.z, one, none, by_onset, m * B.a + b * B.v + k * B.z])
        return -np.concatenate([of_z[known] / sd[0], of_f / sd[1]]) * size

    lower, upper = np.full(len(size), -np.inf), np.full(len(size), np.inf)
    lower[5], upper[5] = _onset_interval(data, f0, sd[1]) / size[5]
    start = np.concatenate(
        [[1.0, 1.0, 1.0, f0 / size[3], z0 / size[4], 0.5 * (lower[5] + upper[5])], np.zeros(basis.count)]
    )
    start[6:] = basis.fitted(data.time[known] - start[5] * size[5], data.position[known] - z0) / size[6:]
    # The stub of SciPy does not know that jac may be a function.
    found = least_squares(residual, start, jac=jacobian, bounds=(lower, upper), x_scale="jac", max_nfev=200)  # pyright: ignore[reportArgumentType]
    value, at, late, a = split(found.x)
    J = jacobian(found.x)
    covariance = np.linalg.pinv(J.T @ J, rcond=1e-13)[:4, :4] * np.outer(size[:4], size[:4])
    path = basis.path(data.time - late, a)
    inside = data.inside
    regressors = np.stack([path.a, path.v, path.z, np.ones_like(path.z)], axis=1)[inside]
    fitted = regressors @ value
    left = data.force[inside] - fitted
    freedom = max(len(found.fun) - len(found.x), 1)
    scale = max(1.0, float(found.fun @ found.fun) / freedom)
    moved = path.z
    return _result("path", value, covariance, data, left, fitted, moved, regressors, onset + late, window, scale)


def _onset_interval(data: _Data, f0: float, sd: float) -> np.ndarray:
    """The two sample times between which the force left rest, within two samples of the given onset.

    A sudden acceleration makes the force jump, so that the fit is not continuous across a sample.
    """
    step = float(np.median(np.diff(data.time)))
    near = np.abs(data.time) <= 2.5 * step
    left = np.flatnonzero(near & (np.abs(data.force - f0) > JUMP * sd))
    first = left[0] if len(left) else int(np.argmin(np.abs(data.time)))
    return np.array([data.time[first] - step, data.time[first]])


def _result(
    method, value, covariance, data: _Data, left, fitted, moved, regressors, onset, window, scale
) -> SecondOrderFit:
    spread = float(left @ left)
    correlation = float(left[1:] @ left[:-1] / spread) if spread > 0 else 0.0
    r = min(max(correlation, 0.0), 0.95)
    covariance = covariance * scale * (1 + r) / (1 - r)
    half = NORMAL_95 * np.sqrt(np.diag(covariance))
    scaled = regressors / np.linalg.norm(regressors, axis=0)
    force = data.force[data.inside]
    return SecondOrderFit(
        method=method,
        value=value,
        lower=value - half,
        upper=value + half,
        covariance=covariance,
        r_squared=float(1 - spread / np.sum((force - force.mean()) ** 2)),
        residual=float(np.sqrt(spread / len(left))),
        autocorrelation=correlation,
        condition=float(np.linalg.cond(scaled)),
        onset=float(onset),
        window=window,
        time=data.time[data.inside],
        force=fitted,
        position=moved[data.inside],
    )
