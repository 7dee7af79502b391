"""Low-degree polynomials on either side of a contact, by least squares, with the error of their slopes.

Time is s = t - onset. Coefficients are lowest degree first.
"""

from typing import NamedTuple

import numpy as np

from icjax.typing import Float


class SlopeChange(NamedTuple):
    """Two polynomials that meet at the contact, and how much the slope changes there."""

    before: np.ndarray
    after: np.ndarray
    change: float
    change_se: float
    r_squared: tuple[float, float]


class Rise(NamedTuple):
    """A polynomial that starts at zero at the contact, and its slope there."""

    coefficients: np.ndarray
    slope: float
    slope_se: float
    noise: float
    slope_noise: float
    r_squared: float


def fit_slope_change(
    s_before: Float[np.ndarray, " n"],
    y_before: Float[np.ndarray, " n"],
    s_after: Float[np.ndarray, " m"],
    y_after: Float[np.ndarray, " m"],
    degree: int,
    variance: float = 0.0,
) -> SlopeChange:
    """One value and two sets of higher coefficients, fitted to both windows together.

    `y = a_0 + sum_k a_k s^k` for s <= 0 and `y = a_0 + sum_k b_k s^k` for s > 0, so the angle is continuous at
    contact (it cannot jump, as the torque starts from zero) and its slope is free. The change of slope is
    `b_1 - a_1`; its variance is that of least squares with the larger of the residual variance and the stated
    `variance` of one sample, widened for serial correlation by `fit_variance`.
    """
    scale = max(-s_before[0], s_after[-1])
    powers_before = _powers(s_before / scale, degree)
    powers_after = _powers(s_after / scale, degree)
    design = np.block(
        [
            [np.ones((len(s_before), 1)), powers_before, np.zeros_like(powers_before)],
            [np.ones((len(s_after), 1)), np.zeros_like(powers_after), powers_after],
        ]
    )
    y = np.concatenate([y_before, y_after])
    offset = y.mean()
    solution, covariance = _least_squares(design, y - offset)
    residual = y - offset - design @ solution
    residual_before, residual_after = np.split(residual, [len(s_before)])
    _, counts = fit_variance(design.shape[1], residual_before, residual_after, least=variance)
    contrast = np.zeros(design.shape[1])
    contrast[1], contrast[1 + degree] = -1.0, 1.0
    units = scale ** -np.arange(1.0, degree + 1)
    value = solution[:1] + offset
    before = np.concatenate([value, solution[1 : 1 + degree] * units])
    after = np.concatenate([value, solution[1 + degree :] * units])
    error = np.sqrt(contrast @ covariance @ contrast * counts) / scale
    quality = (_r_squared(y_before, residual_before), _r_squared(y_after, residual_after))
    return SlopeChange(before, after, float(after[1] - before[1]), float(error), quality)


def fit_rise(s: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], degree: int) -> Rise:
    """`y = sum_{k >= 1} c_k s^k`: the torque is zero at contact. The slope there is `c_1`.

    The standard error is as in `fit_slope_change` and contains what the polynomial cannot follow. `noise` does
    not: it is `second_difference_noise`, and `slope_noise` is what it alone does to the slope.
    """
    scale = s[-1]
    design = _powers(s / scale, degree)
    solution, covariance = _least_squares(design, y)
    residual = y - design @ solution
    _, counts = fit_variance(degree, residual)
    error = float(np.sqrt(covariance[0, 0] * counts) / scale)
    noise = second_difference_noise(y)
    noise_error = float(np.sqrt(covariance[0, 0])) * noise / scale
    coefficients = np.concatenate([[0.0], solution * scale ** -np.arange(1.0, degree + 1)])
    total, left = float(y @ y), float(residual @ residual)  # about zero: the fit has no constant
    quality = 1.0 - left / total if total > 0 else 1.0
    return Rise(coefficients, float(coefficients[1]), error, noise, noise_error, quality)


def second_difference_noise(y: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of one sample from second differences, in which a smooth course cancels.

    Their mean square is 6 sigma^2 for white noise.
    """
    return float(np.sqrt(np.mean(np.diff(y, 2) ** 2) / 6.0))


def correlated_noise(rise: Rise, stated: float) -> tuple[float, float]:
    """Noise of one sample and what it does to the slope at contact, where filtered noise is smoother than white.

    Second differences r of noise that a low-pass filter left below the share x of the sampling rate are too small:
    r^2 = sigma^2 (2 pi x)^4 / 30. With sigma known from elsewhere (`stated`, of the unloaded sensor after the same
    filter) that gives x, and the noise counts as one independent sample in 1 / (2 x).

    **Arguments**: `rise` with its noise r; `stated` sigma, zero if unknown. **Returns** the larger of both noises, and
    the standard deviation of the slope.
    """
    if not stated > rise.noise:
        return rise.noise, rise.slope_noise
    ratio = max(rise.noise / stated, 1e-6)
    independent = max(np.pi / (30.0 * ratio**2) ** 0.25, 1.0)
    return stated, rise.slope_noise / rise.noise * stated * float(np.sqrt(independent)) if rise.noise > 0 else np.inf


def fit_variance(parameters: int, *residuals: np.ndarray, least: float = 0.0) -> tuple[float, float]:
    """Variance of one sample about a fit, and the variance that counts for the fit's coefficients.

    Serial correlation rho of first order widens the variance of slow trends by F = (1 + rho) / (1 - rho), and
    the fitted coefficients, being slow trends, take F times their share of it out of the residuals: with n
    samples and p parameters the residual sum of squares is (n - p F) sigma^2 and the lag-one correlation r of the
    residuals satisfies r (1 - p F / n) = rho - p F / n. Both are solved for sigma^2 and rho >= 0. Filtered data,
    and a polynomial too stiff for the data, thus count as n / F samples, but as p + 1 at least.

    **Returns** sigma^2 (at least `least`) and F sigma^2.
    """
    count = sum(len(r) for r in residuals)
    power = sum(float(r @ r) for r in residuals)
    if power == 0.0:
        return least, least
    found = sum(float(r[1:] @ r[:-1]) for r in residuals) / power
    most = max(count / (parameters + 1), 1.0)
    factor, share = 1.0, parameters / count
    for _ in range(50):
        rho = min(max(found + (1.0 - found) * share, 0.0), 0.999)
        previous, factor = factor, min((1.0 + rho) / (1.0 - rho), most)
        if factor == previous:
            break
        share = parameters * factor / count
    variance = max(power / (count * (1.0 - share)), least)
    return variance, factor * variance


def _powers(s: np.ndarray, degree: int) -> np.ndarray:
    return s[:, None] ** np.arange(1, degree + 1)


def _least_squares(design: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    orthogonal, triangular = np.linalg.qr(design)
    solution = np.linalg.solve(triangular, orthogonal.T @ y)
    inverse = np.linalg.inv(triangular)
    return solution, inverse @ inverse.T


def _r_squared(y: np.ndarray, residual: np.ndarray) -> float:
    """1 - residual / total variation; 1 for data that do not vary and are met, 0 where they are not met."""
    total = float(np.sum((y - y.mean()) ** 2))
    left = float(residual @ residual)
    if total == 0.0:
        return 1.0 if left == 0.0 else 0.0
    return 1.0 - left / total
