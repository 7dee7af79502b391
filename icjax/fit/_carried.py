"""What moves the compliant joints beside the contact: the rest of the body, pushed aside by it, carries them along."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.signal import bilinear, lfilter

from icjax.fit._windows import Motion
from icjax.model import Model, difference
from icjax.running import on_full_blocks
from icjax.typing import Float, Real

BLOCK = 256
"""Frames that one compiled call takes."""

FREQUENCIES = (1.0, 2.0, 4.0, 7.0, 12.0, 20.0, 40.0)
RATIOS = (0.3, 0.7, 1.5)
"""Hz and damping ratios of the springs of which an arm, a rest or a table is made up."""

LINES = 20.0
"""Hz below which angles vary; what is sampled more often is not independent."""

WIDTHS = np.geomspace(0.03, 3.0, 21)
"""Of the prior: root mean square of what the force is expected to move, by that of all that moved."""

MODES = 6
"""In which the doubt about each coordinate's acceleration is told, and that about the torque of all of them."""


def rest_of(motion: Motion) -> tuple[int, ...]:
    """Degrees of freedom that are not fitted: a forearm on its rest, a hand's root."""
    return tuple(dof for dof in range(motion.recording.model.nv) if dof not in motion.dofs)


def moved_aside(
    motion: Motion, repetitions: list[tuple[Motion, float]], frames: np.ndarray
) -> Float[np.ndarray, "frame rest"] | None:
    """How far the rest of the body is from where repetitions have it, in tangent coordinates of the trial; None without
    repetitions.

    **Arguments**: `repetitions` with the shift, s, by which each is read later.
    """
    if not repetitions:
        return None
    rest = list(rest_of(motion))
    time, q = np.asarray(motion.recording.time)[frames], np.asarray(motion.recording.q)[frames]
    result = np.zeros((len(frames), len(rest)))
    for other, shift in repetitions:
        when = np.asarray(other.recording.time)[other.valid]
        spline = make_interp_spline(when, np.asarray(other.recording.q)[other.valid], k=3)
        there = spline(np.clip(time + shift, when[0], when[-1]))
        found = on_full_blocks(lambda a, b: _apart(motion.recording.model, a, b), there, q, block=BLOCK)
        result += np.asarray(found)[:, rest] / len(repetitions)
    return result


class Pushed(NamedTuple):
    """The rest of the body as the contact pushes it: displacement, velocity and acceleration [frame, rest, ...]."""

    aside: np.ndarray
    velocity: np.ndarray
    acceleration: np.ndarray


def pushed(
    aside: Sequence[np.ndarray | None], force: Sequence[np.ndarray], rate: float
) -> tuple[list[Pushed], list[Pushed]]:
    """What of `aside` follows linearly from the contact force: a sum of damped springs d_s moved by all its components,

        d = sum_s d_s,    d_s'' = w_s^2 (sum_k c_sk f_k - d_s) - 2 z_s w_s d_s',

    from rest, w_s and z_s fixed (`FREQUENCIES`, `RATIOS`), so that any damped linear mechanism between contact and
    forearm is near. Differentiating the measured d twice instead would give noise that the angles of the fitted joints
    share (their markers are the same), and fits mistake that for inertia. c is found by a linear regression over all
    windows whose displacement is known, and holds for the others too; a constant and a slope of every window are left
    out, with a normal prior whose width is not known: it is averaged over `WIDTHS` by evidence.

    **Arguments**: of every window `aside` [frame, rest], None where it is not known, and `force` [frame, rest],
    generalised forces of the contact on the same coordinates; `rate` Hz.

    **Returns** of every window the mean [frame, rest], and the doubt about it [frame, rest, rest * `MODES`]: columns of
    a factor of its covariance, each of one coordinate, those that leave its acceleration least known.

    **Source**: evidence of a linear model: MacKay 1992, Bayesian interpolation.
    """
    rest = force[0].shape[1]
    result = [Pushed(*(np.zeros(item.shape) for _ in range(3))) for item in force]
    doubt = [Pushed(*(np.zeros((*item.shape, rest * MODES)) for _ in range(3))) for item in force]
    known = [number for number, item in enumerate(aside) if item is not None]
    scale = np.sqrt(np.mean(np.concatenate(force) ** 2, axis=0))
    used = np.flatnonzero(scale > 1e-9)
    if not used.size or not known:
        return result, doubt
    unit = [item[:, used] / scale[used] for item in force]
    kinds = [_spring(2.0 * np.pi * hertz, ratio, rate) for hertz in FREQUENCIES for ratio in RATIOS]
    springs = [_side_by_side([_followed(item, spring) for spring in kinds]) for item in unit]
    X = np.concatenate([_without_line(springs[number].aside) for number in known])
    straight = np.concatenate([_without_line(item) for item in aside if item is not None])
    share = 2.0 * LINES / rate  # of the samples is independent
    decomposed = np.linalg.svd(np.sqrt(share) * X, full_matrices=False)
    for joint in range(rest):
        y = straight[:, joint]
        if np.max(np.abs(y)) < 1e-12:
            continue
        c, factor = _regressed(decomposed, y, share)
        columns = principal([window.acceleration @ factor for window in springs], MODES)
        place = slice(joint * MODES, joint * MODES + columns.shape[1])
        for mean, left, window in zip(result, doubt, springs, strict=True):
            for into, spread, part in zip(mean, left, window, strict=True):
                into[:, joint] = part @ c
                spread[:, joint, place] = part @ (factor @ columns)
    return result, doubt


def principal(effects: list[np.ndarray], count: int) -> Float[np.ndarray, "column mode"]:
    """Orthonormal combinations of columns whose effect [row, column] is largest over all parts."""
    _, vectors = np.linalg.eigh(np.sum([part.T @ part for part in effects], axis=0))
    return vectors[:, ::-1][:, :count]


class _Spring(NamedTuple):
    """Of unit compliance: w rad/s, damping ratio z, filters from force to displacement and velocity."""

    w: float
    z: float
    displacement: tuple[Any, Any]
    velocity: tuple[Any, Any]


def _spring(w: float, z: float, rate: float) -> _Spring:
    """By the bilinear rule."""
    den = np.array([1.0, 2.0 * z * w, w**2])
    displacement, velocity = (bilinear(np.array(num), den, rate) for num in ([w**2], [w**2, 0.0]))
    return _Spring(w, z, displacement, velocity)


def _followed(force: np.ndarray, spring: _Spring) -> Pushed:
    """A spring as each component of the force moves it."""
    w, z = spring.w, spring.z
    d, v = (np.asarray(lfilter(*filters, force, axis=0)) for filters in (spring.displacement, spring.velocity))
    return Pushed(d, v, w**2 * (force - d) - 2.0 * z * w * v)


def _side_by_side(parts: list[Pushed]) -> Pushed:
    return Pushed(*(np.concatenate(columns, axis=1) for columns in zip(*parts, strict=True)))


def _without_line(values: np.ndarray) -> np.ndarray:
    """Less the straight line that fits best, column by column."""
    t = np.linspace(-1.0, 1.0, len(values))
    Q, _ = np.linalg.qr(np.stack([np.ones_like(t), t], axis=1))
    return values - Q @ (Q.T @ values)


def _regressed(decomposed: Any, y: np.ndarray, share: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean of c and a factor of its covariance; only a `share` of the samples is independent.

    With sqrt(share) X = U S V^T, `decomposed`, noise of variance s2 in independent samples, a prior of width p and
    r = s2 / p^2 the posterior of V^T c has the mean S U^T y / (S^2 + r) and the variance s2 / (S^2 + r), y that of the
    share; evidence weighs the widths, and what their means differ by counts as doubt.
    """
    U, s, Vt = decomposed
    along, count, total = np.sqrt(share) * (U.T @ y), share * len(y), share * float(y @ y)
    prior = WIDTHS**2 * total / float(np.sum(s**2))
    kept, left = np.zeros((len(WIDTHS), len(s))), np.full(len(WIDTHS), total)
    for _ in range(3):  # the noise is what the mean leaves
        kept = s**2 / (s**2 + (left / count / prior)[:, None])
        left = total - kept @ along**2
    evidence = -0.5 * count * np.log(left) + 0.5 * np.sum(np.log1p(-kept), axis=1)
    weight = np.exp(evidence - np.max(evidence))
    weight /= weight.sum()
    means, variances = kept * along / np.maximum(s, 1e-300), (1.0 - kept) * prior[:, None]
    mean = weight @ means
    apart = (np.sqrt(weight)[:, None] * (means - mean)).T
    factor = np.concatenate([np.diag(np.sqrt(weight @ variances)), apart], axis=1)
    return Vt.T @ mean, Vt.T @ factor


def carried_torque(
    parts: tuple[np.ndarray, np.ndarray, np.ndarray], rest: Pushed
) -> Float[np.ndarray, "frame segment dof ..."]:
    """Torque that the fitted joints need to go along: A2 d'' + A1 d' + A0 d, Nm for every unit of a mass factor.

    **Arguments**: `parts` A0, A1, A2 `[frame, segment, dof, rest]` (`linear_inertia`).
    """
    return np.sum([np.einsum("tsij,tj...->tsi...", A, d) for A, d in zip(parts, rest, strict=True)], axis=0)


@eqx.filter_jit
def _apart(model: Model, there: Float[Real, "frame nq"], q: Float[Real, "frame nq"]) -> Float[Real, "frame nv"]:
    return -jax.vmap(lambda a, b: difference(model, a, b))(jnp.asarray(q), jnp.asarray(there))
