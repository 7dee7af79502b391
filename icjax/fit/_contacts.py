"""Contacts of a session as rows of a dynamic equilibrium: what would have happened without them, and how surely."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from icjax.fit._carried import MODES, carried_torque, principal, pushed, rest_of
from icjax.fit._dynamic import Common, DynamicEquilibrium, whitener
from icjax.fit._inertia import inertia_along
from icjax.fit._options import FitOptions
from icjax.fit._planned_movement import PlannedMovement, alike, free_stretches, learn_movement, pace, velocity
from icjax.fit._repetitions import Repetition
from icjax.fit._variability import Curve, Variability, covariance, learn
from icjax.fit._windows import SMEAR, Motion, smoothed
from icjax.typing import Float


class Window(NamedTuple):
    """One contact: frames of the trial, its repetitions laid over it at the compared samples; none without them.

    `aside` [frame, rest]: how far the rest of the body is from theirs (`moved_aside`), from `first` to `last`; None
    without repetitions.
    """

    trial: str
    event: int
    first: int
    onset: int
    last: int
    samples: np.ndarray
    repetitions: tuple[Repetition, ...]
    aside: np.ndarray | None


class Expected(NamedTuple):
    """What is known of movement without contact, of the windows of a session.

    - `noise` [dof, dof]: rad^2, of the angles from frame to frame.
    - `variability`: how far repetitions depart from what was intended; None where no window has one.
    - `movement`: how movement goes on, for windows without repetitions; None where all have them.
    """

    noise: np.ndarray
    variability: Variability | None
    movement: PlannedMovement | None


def expectation(windows: list[Window], motions: dict[str, Motion], options: FitOptions) -> Expected:
    """Learnt from the repetitions, and from the free movement of trials without them.

    **Errors**: those of `learn` and `learn_movement`.
    """
    noise = np.mean([motion.noise for motion in motions.values()], axis=0)
    repeated = [window for window in windows if window.repetitions]
    alone = list(dict.fromkeys(window.trial for window in windows if not window.repetitions))
    variability = _learn_variability(repeated, motions, noise, options) if repeated else None
    movement = _learn_movement([motions[name] for name in alone], noise, options) if alone else None
    return Expected(noise, variability, movement)


def _learn_variability(windows, motions, noise, options) -> Variability:
    curves, correlations = [], []
    for window in windows:
        motion = motions[window.trial]
        s = (window.samples - window.onset) / motion.recording.rate
        rho = _correlation(motion, window.samples)
        for one, other in zip(window.repetitions, window.repetitions[1:], strict=False):
            share = 1.0 / min(one.trials, other.trials)
            curves.append(Curve(s, one.angle - other.angle, (one.rate, other.rate), share))
            correlations.append(rho)
        free = s <= -SMEAR
        for one in window.repetitions[:1]:
            curves.append(Curve(s[free], motion.angle[window.samples][free] - one.angle[free], (one.rate[free],)))
            correlations.append(rho[np.ix_(free, free)])
    return learn(curves, noise, correlations, options.shift_sd)


def _learn_movement(motions: list[Motion], noise, options) -> PlannedMovement:
    rate = motions[0].recording.rate
    stride = _stride(options, rate)
    before, after = (int(x * rate) // stride for x in (options.before, options.after))
    samples = before + after + 1
    margins = SMEAR, options.settle
    stretches = [item for motion in motions for item in free_stretches(motion, samples, stride, margins)]
    s = np.arange(-before, after + 1) * stride / rate
    longest = max(motions, key=lambda motion: len(motion.correlation))
    try:
        return learn_movement(s, stretches, noise, _correlation(longest, np.arange(samples) * stride))
    except ValueError as error:
        names = ", ".join(repr(motion.recording.name) for motion in motions)
        raise ValueError(f"without a catch trial ({names}): {error}") from error


def measured(
    windows: list[Window],
    motions: dict[str, Motion],
    groups: np.ndarray,
    expected: Expected,
    options: FitOptions,
) -> DynamicEquilibrium:
    """All windows as one measurement, filled up to one length."""
    first = motions[windows[0].trial]
    rate = first.recording.rate
    dofs = len(expected.noise)
    # At least as long as a whole window, so that sessions share a compiled program.
    full = round((options.before + options.after) * rate) + 1
    length = max(full, *(w.last - w.first + 1 for w in windows))
    count = max(-(-full // _stride(options, rate)), *(len(w.samples) for w in windows))
    rows: dict[str, list[np.ndarray]] = {
        key: [] for key in ("torque", "rate", "by", "frames", "y", "W", "common", "carried")
    }
    inertia: list[list[np.ndarray]] = [[], [], []]
    forces = [motions[w.trial].rest_torque[w.first : w.last + 1] for w in windows]
    rest, left = pushed([window.aside for window in windows], forces, rate)
    doubts = []
    movements = {name: smoothed(motions[name]) for name in dict.fromkeys(w.trial for w in windows)}
    modes = None if expected.movement is None else expected.movement.modes(options.before, options.after)
    sizes = done_alike(windows, motions)
    for window, aside, doubt, size in zip(windows, rest, left, sizes, strict=True):
        motion = motions[window.trial]
        frames = np.arange(window.first, window.last + 1)
        torque = motion.torque[frames]
        rows["torque"].append(_filled(torque, length))
        rows["rate"].append(_filled(np.gradient(torque, 1.0 / rate, axis=0), length))
        rows["by"].append(_filled(motion.by_offset[frames], length))
        parts = inertia_along(motion, movements[window.trial], groups, frames, (*motion.dofs, *rest_of(motion)))
        for store, part in zip(inertia, parts, strict=True):
            store.append(_filled(part[..., :dofs], length, repeat=True))
        others = parts[0][..., dofs:], parts[1][..., dofs:], parts[2][..., dofs:]
        rows["carried"].append(_filled(carried_torque(others, aside), length))
        doubts.append(carried_torque(others, doubt))
        y, K = _against_expected(motion, window, expected, options)
        used = np.zeros((count, dofs), bool)
        used[: len(window.samples)] = True
        padded = np.eye(count * dofs)
        padded[: y.size, : y.size] = K
        rows["W"].append(whitener(padded, used.ravel()))
        rows["y"].append(_filled(y, count))
        rows["frames"].append(_filled(window.samples - window.first, count))
        if modes is not None:
            effect = _filled(systematic(modes, (window.samples - window.onset) / rate, size), count)
            rows["common"].append(rows["W"][-1] @ effect.reshape(count * dofs, -1))
    uncertain = _largest(doubts, length) if any(map(np.any, doubts)) else None
    stacked = {key: np.stack(items) for key, items in rows.items() if items}
    common = Common.of(np.concatenate(rows["common"])) if modes else None
    offset = np.linalg.cholesky(first.offset + 1e-18 * np.eye(len(first.offset)))
    return DynamicEquilibrium(
        "contacts", 1.0 / rate, stacked["torque"], stacked["rate"], stacked["by"],
        (np.stack(inertia[0]), np.stack(inertia[1]), np.stack(inertia[2])),
        np.asarray(first.recording.model.armature)[list(first.dofs)], offset,
        stacked["frames"].astype(int), stacked["y"], stacked["W"], common, stacked["carried"], uncertain,
    )  # fmt: skip


def _largest(doubts: list[np.ndarray], length: int) -> np.ndarray:
    """Of all that is not known of carried torque the largest combinations [event, frame, segment, dof, mode], Nm."""
    columns = principal([part.sum(axis=1).reshape(-1, part.shape[-1]) for part in doubts], MODES)
    return np.stack([_filled(part @ columns, length) for part in doubts])


def _against_expected(motion: Motion, window: Window, expected: Expected, options: FitOptions):
    """Angles less what was expected [sample, dof], and the covariance of that [sample * dof, sample * dof]."""
    angle = motion.angle[window.samples]
    if not window.repetitions:
        return angle - angle[:1], planned_covariance(motion, window, expected)
    U = shifts(window, options)
    mean = np.mean([item.angle for item in window.repetitions], axis=0)
    return angle - mean, repeated_covariance(motion, window, expected) + U @ U.T


def repeated_covariance(
    motion: Motion, window: Window, expected: Expected, joints: Sequence[int] | None = None
) -> Float[np.ndarray, "row column"]:
    """Of a trial's angles less the mean of its repetitions, rad^2 [sample * dof, sample * joint], were none shifted;
    `joints` those of the columns, default all."""
    assert expected.variability is not None
    s = (window.samples - window.onset) / motion.recording.rate
    rows, rho = len(s) * len(expected.noise), _correlation(motion, window.samples)
    K = covariance(s, expected.variability, expected.noise, rho, joints)
    return (1.0 + of_mean(window)) * K.reshape(rows, -1)


def of_mean(window: Window) -> float:
    """Variance of the mean of n repetitions over that of one: sum k / n^2, 1/n where none is shared.

    Repetitions of k trials err in the same way at all of them, and contacts count as independent here: k times the
    variance leaves the mean over the k trials as uncertain as it is.
    """
    return sum(item.trials for item in window.repetitions) / len(window.repetitions) ** 2


def apparent(window: Window) -> float:
    """By how much smaller than one the whitened residuals of a window are expected to be, as its repetitions count more
    than once (`of_mean`)."""
    if not window.repetitions:
        return 1.0
    return float(np.sqrt((1.0 + 1.0 / len(window.repetitions)) / (1.0 + of_mean(window))))


def planned_covariance(
    motion: Motion, window: Window, expected: Expected, joints: Sequence[int] | None = None
) -> Float[np.ndarray, "row column"]:
    """Of a trial's angles as they are foretold, rad^2 [sample * dof, sample * joint], what contacts share not counted;
    `joints` those of the columns, default all."""
    assert expected.movement is not None
    s = (window.samples - window.onset) / motion.recording.rate
    angle, rho = motion.angle[window.samples], _correlation(motion, window.samples)
    return expected.movement.covariance(s, pace(s, angle), expected.noise, rho, joints).reshape(angle.size, -1)


def shifts(window: Window, options: FitOptions) -> Float[np.ndarray, "row repetition"]:
    """U, with U U^T the covariance that comes from repetitions that begin earlier or later, rad; see `of_mean`."""
    return (options.shift_sd / len(window.repetitions)) * np.stack(
        [np.sqrt(item.trials) * item.rate.ravel() for item in window.repetitions], axis=1
    )


def done_alike(windows: Sequence[Window], motions: dict[str, Motion]) -> Float[np.ndarray, "window kind dof"]:
    """`alike` of contacts without repetitions; zero of the others."""
    rows = []
    for window in windows:
        motion = motions[window.trial]
        s, angle = (window.samples - window.onset) / motion.recording.rate, motion.angle[window.samples]
        torque = np.mean(motion.torque[window.onset : window.last + 1], axis=0)
        rows.append(np.stack([pace(s, angle), velocity(s, angle), torque]))
    found, alone = np.zeros_like(rows), np.array([not window.repetitions for window in windows])
    if alone.any():
        found[alone] = alike(*np.stack(rows)[alone].swapaxes(0, 1))
    return found


def systematic(
    modes: tuple[np.ndarray, list[np.ndarray]], s: np.ndarray, sizes: Float[np.ndarray, "kind dof"]
) -> np.ndarray:
    """What the modes of all joints in turn, of each joint all kinds, do to the angles [sample, dof, mode]."""
    at, of = modes
    parts = [at_times(s, at, part, size) for part, size in zip(of, sizes.T, strict=True)]
    result, begin = np.zeros((len(s), len(of), sum(part.shape[1] for part in parts))), 0
    for joint, part in enumerate(parts):
        result[:, joint, begin : begin + part.shape[1]] = part
        begin += part.shape[1]
    return result


def at_times(s: np.ndarray, at: np.ndarray, modes: np.ndarray, sizes: Float[np.ndarray, " kind"]) -> np.ndarray:
    """Modes of one joint, of every size, at other times [time, kind * mode]."""
    moved = np.stack([np.interp(s, at, column) for column in modes.T], axis=1)
    return np.concatenate([size * moved for size in sizes], axis=1)


def unexplained(whitening: np.ndarray, window: Window, rate: float, dofs: int) -> tuple[np.ndarray, np.ndarray]:
    """Factor of the covariance of a window's angles, split where contact begins to show.

    **Returns** [row, row before] by whitened rows before contact, and [row, row]: columns before contact zero.
    """
    used = len(window.samples) * dofs
    factor = np.tril(np.linalg.inv(whitening[:used, :used]))
    known = int(np.sum(window.samples - window.onset <= -SMEAR * rate)) * dofs
    left = factor.copy()
    left[:, :known] = 0.0
    return factor[:, :known], left


def _stride(options: FitOptions, rate: float) -> int:
    return max(1, round(options.spacing * rate))


def _correlation(motion: Motion, samples: np.ndarray) -> np.ndarray:
    """Between samples; none beyond a recording's length."""
    known = motion.correlation
    lag = np.abs(samples[:, None] - samples[None, :])
    return np.where(lag < len(known), known[np.minimum(lag, len(known) - 1)], 0.0)


def _filled(values: np.ndarray, length: int, repeat: bool = False) -> np.ndarray:
    """Lengthened at the end, with zeros or the last row."""
    missing = length - len(values)
    if missing == 0:
        return values
    tail = np.repeat(values[-1:], missing, axis=0) if repeat else np.zeros((missing, *values.shape[1:]), values.dtype)
    return np.concatenate([values, tail])
