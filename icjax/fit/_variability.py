"""How far two repetitions of a movement drift apart: a Gaussian process, learnt where nothing touches."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from icjax.typing import Float

FAST, SLOW = 0.04, 0.3
"""s, length scales: tremor at 3 to 12 Hz, and the wandering of a movement repeated."""

TYPICAL = np.radians([0.05, 0.2])
"""rad, amplitudes of both about which the prior lies, within a factor of five."""

NOISE_SD = 0.3
"""Of the logarithm of `Variability.noise`: how well a recording's own covariance is trusted."""

JITTER = 1e-6
"""rad; added to every sample, far below any marker's noise."""


class Variability(NamedTuple):
    """Variance of a repetition about the intended movement: `amplitude` [2, dof], rad, of the fast and slow process.

    - `noise` [dof] multiplies the instrument's standard deviations: what of a stated error moves slowly (a wandering
      marker) is part of the slow process here, so that less is left for the noise from frame to frame.
    - `inflation` multiplies the covariance so that repetitions predicted from each other miss as much as it says.
    - `doubt` [dof, 3, 3]: covariance of the logarithms of each joint's two amplitudes and noise; None: they are known.
    """

    amplitude: Float[np.ndarray, "2 dof"]
    noise: Float[np.ndarray, " dof"]
    inflation: float
    doubt: Float[np.ndarray, "dof 3 3"] | None = None

    def moved(self, joint: int, logarithms: Float[np.ndarray, " 3"]) -> "Variability":
        """With the amplitudes and the noise of one joint multiplied by the exponentials."""
        amplitude, noise = self.amplitude.copy(), self.noise.copy()
        amplitude[:, joint] *= np.exp(logarithms[:2])
        noise[joint] *= np.exp(logarithms[2])
        return self._replace(amplitude=amplitude, noise=noise)


class Curve(NamedTuple):
    """A difference of two repetitions: `s` s [sample], `difference` rad [sample, dof], `rates` of the shifts, and what
    share of one it counts (less than one where the same two are compared again at another trial)."""

    s: Float[np.ndarray, " sample"]
    difference: Float[np.ndarray, "sample dof"]
    rates: tuple[Float[np.ndarray, "sample dof"], ...]
    share: float = 1.0


def matern(lag: Float[np.ndarray, "..."], length: float) -> Float[np.ndarray, "..."]:
    """Correlation (1 + x + x^2 / 3) exp(-x), x = sqrt(5) lag / length: twice differentiable in mean square.

    Source: Rasmussen and Williams 2006, Gaussian processes for machine learning, Eq. 4.17.
    """
    x = np.sqrt(5.0) * np.abs(lag) / length
    return (1.0 + x + x**2 / 3.0) * np.exp(-x)


def matern_by_length(lag: Float[np.ndarray, "..."], length: float) -> Float[np.ndarray, "..."]:
    """Derivative of `matern` by the logarithm of the length."""
    x = np.sqrt(5.0) * np.abs(lag) / length
    return (x**2 + x**3) / 3.0 * np.exp(-x)


def covariance(
    s: Float[np.ndarray, " sample"],
    variability: Variability,
    noise: Float[np.ndarray, "dof dof"],
    correlation: Float[np.ndarray, "sample sample"],
    joints: Sequence[int] | None = None,
) -> Float[np.ndarray, "sample dof sample joint"]:
    """Of one repetition's angles about the intended movement: fast and slow process, and the instrument's noise.

    **Arguments**: `noise` covariance of the angles at a frame, `correlation` of that noise between samples; `joints`
    those of the last axis, default all.
    """
    lag = s[:, None] - s[None, :]
    fast, slow = matern(lag, FAST), matern(lag, SLOW)
    own = [a**2 * fast + b**2 * slow for a, b in variability.amplitude.T]
    return variability.inflation * with_noise(
        own, noise * np.outer(variability.noise, variability.noise), correlation, joints
    )


def with_noise(
    own: list[np.ndarray],
    noise: Float[np.ndarray, "dof dof"],
    correlation: Float[np.ndarray, "sample sample"],
    joints: Sequence[int] | None,
) -> Float[np.ndarray, "sample dof sample joint"]:
    """Covariance of every joint's `own` movement, of the instrument's noise and of the jitter; `joints` those of the
    last axis, None for all."""
    joints = range(len(noise)) if joints is None else joints
    full = np.einsum("st,ij->sitj", correlation, noise[:, joints])
    for column, joint in enumerate(joints):
        full[:, joint, :, column] += own[joint] + JITTER**2 * np.eye(len(correlation))
    return full


def learn(
    curves: list[Curve],
    noise: Float[np.ndarray, "dof dof"],
    correlations: list[np.ndarray],
    shift_sd: float,
    onset: float = 0.0,
) -> Variability:
    """Amplitudes and noise of greatest posterior density from differences of repetitions, then how well they predict.

    A difference of two has twice the covariance. Joints are taken one by one. `inflation` is the mean square of the
    whitened differences after s = `onset` given those before, at least one.

    **Errors**: `ValueError` without any curve.
    """
    if not curves:
        raise ValueError("no stretch in which a trial and a repetition, or two repetitions, are free of contact")
    dofs = len(noise)
    found, doubt = np.empty((3, dofs)), np.empty((dofs, 3, 3))
    centre, width = np.log([*TYPICAL, 1.0]), np.array([np.log(5.0), np.log(5.0), NOISE_SD])
    for joint in range(dofs):
        parts = [
            (*_one_joint(curve, joint, noise[joint, joint], rho, shift_sd), curve.share)
            for curve, rho in zip(curves, correlations, strict=True)
        ]

        def cost(x, parts=parts):
            scale = 2.0 * np.exp(2.0 * x)
            total, gradient = 0.5 * np.sum(((x - centre) / width) ** 2), (x - centre) / width**2
            for y, kernels, rest, share in parts:
                K = np.tensordot(scale, kernels, 1) + rest
                inverse = np.linalg.inv(K)
                z = inverse @ y
                total += 0.5 * share * (y @ z + np.linalg.slogdet(K)[1])
                gradient = gradient + share * scale * np.tensordot(kernels, inverse - np.outer(z, z), 2)
            return total, gradient

        bounds = [(-14.0, 0.0), (-14.0, 0.0), (-2.0, 2.0)]
        best = np.asarray(minimize(cost, centre, jac=True, method="L-BFGS-B", bounds=bounds).x)
        found[:, joint] = np.exp(best)
        doubt[joint] = curvature_inverse(lambda x: cost(x)[1], best, width)
    plain = Variability(found[:2], found[2], 1.0, doubt)
    return plain._replace(inflation=max(1.0, _missed(curves, plain, noise, correlations, shift_sd, onset)))


def curvature_inverse(slope, x: np.ndarray, width: np.ndarray, step: float = 1e-3) -> np.ndarray:
    """Covariance of x from differences of the slope of its cost, nowhere wider than the prior."""
    H = np.stack([(slope(x + step * e) - slope(x - step * e)) / (2.0 * step) for e in np.eye(len(x))])
    values, axes = np.linalg.eigh(0.5 * (H + H.T) * np.outer(width, width))
    return np.outer(width, width) * ((axes / np.maximum(values, 1.0)) @ axes.T)


def _one_joint(curve, joint, noise, correlation, shift_sd):
    lag = curve.s[:, None] - curve.s[None, :]
    """Difference, kernels of the two processes and the noise, and what is known of its covariance."""
    rest = JITTER**2 * np.eye(len(curve.s))
    for rate in curve.rates:
        rest = rest + shift_sd**2 * np.outer(rate[:, joint], rate[:, joint])
    return curve.difference[:, joint], np.stack([matern(lag, FAST), matern(lag, SLOW), noise * correlation]), rest


def _missed(curves, variability, noise, correlations, shift_sd, onset) -> float:
    """Mean square of what the covariance says should have unit variance, after the onset given before."""
    squares, count = 0.0, 0.0
    for curve, rho in zip(curves, correlations, strict=True):
        K = 2.0 * covariance(curve.s, variability, noise, rho).reshape(curve.difference.size, -1)
        for rate in curve.rates:
            K = K + shift_sd**2 * np.outer(rate.ravel(), rate.ravel())
        white = solve_triangular(np.linalg.cholesky(K), curve.difference.ravel(), lower=True)
        white = white.reshape(curve.difference.shape)
        after = curve.s > onset  # whitening in the order of time conditions every sample on those before
        squares += curve.share * float(np.sum(white[after] ** 2))
        count += curve.share * int(np.sum(after)) * white.shape[1]
    return squares / count if count else 1.0
