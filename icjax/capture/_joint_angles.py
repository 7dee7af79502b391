"""Joint angles of a trial with their uncertainty: solve, bridge gaps, filter, solve again."""

import dataclasses
from collections.abc import Callable

import jax
import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._filters import HIGHEST_CUTOFF, lowpass, runs
from icjax.capture._pose import PoseSolution, interpolated, pose_covariance, solve_poses
from icjax.capture._posture import PosturePrior
from icjax.model import Model

LONGEST_BRIDGE = 0.1
"""s; a marker that was missing for longer is left out of the second solution while it is missing."""

FIRST_SD = 0.001
"""m; a marker noise for asking which coordinates the visible markers determine at all."""

FIRST_RATE = 100.0
"""Frames a second of the first solution; a hand's movement lies below 20 Hz."""

OFFSET_FRAMES = 1024
"""Frames, spread over the trial, that the mean of an offset's covariance is taken from."""

ENOUGH = 50
"""Frames that are enough for a mean place."""


@dataclasses.dataclass(frozen=True)
class JointAngles:
    """Coordinates of a trial.

    - `q` [frame, nq], `covariance` [frame, nv, nv] of the frame-to-frame error.
    - `offset_covariance` [nv, nv]: of the constant offset that marker placement leaves.
    - `valid` [frame]: whether the markers determine every coordinate.
    - `residual` [frame, marker]: distance of the measured marker to the model, m; NaN in gaps.
    - `body_rotations`, `body_positions`: world poses of all bodies in every frame.
    - `marker_sd`: m, per axis, of the filtered markers about a rigid body, from the residuals.
    """

    q: Float[np.ndarray, "frame nq"]
    covariance: Float[np.ndarray, "frame nv nv"]
    offset_covariance: Float[np.ndarray, "nv nv"]
    valid: Bool[np.ndarray, " frame"]
    residual: Float[np.ndarray, "frame marker"]
    body_rotations: Float[np.ndarray, "frame body 3 3"]
    body_positions: Float[np.ndarray, "frame body 3"]
    marker_sd: float

    @property
    def offset_sd(self) -> Float[np.ndarray, " nv"]:
        """Standard deviation of the constant offset of every coordinate."""
        return np.sqrt(np.diag(self.offset_covariance))


def joint_angles(
    model: Model,
    sites: tuple[int, ...],
    markers: Float[np.ndarray, "frame marker 3"],
    rate: float,
    cutoff: float,
    placement_sd: float,
    progress: Callable[[float], None] | None = None,
    posture: PosturePrior | None = None,
) -> JointAngles:
    """Joint angles from markers.

    1. The pose from the raw markers, gaps left out, a hundred times a second and wherever a marker is missing
       (`first_frames`). From it the mean place of every marker on its body: markers sit a little beside their sites,
       and a cluster that loses one of them would turn. Frames with a gap are solved again with these places (which
       leaves the pose of complete frames where it is).
    2. A gap is bridged with the place of the marker on the model plus its residual, interpolated over the gap.
    3. The markers are low-pass filtered (`lowpass`), so that neither gaps nor noise reach the angles.
    4. The pose of every frame, with gaps longer than 0.1 s left out.

    The covariance is s^2 (J^T J)^-1; s^2 is the variance of what is left between filtered markers and model after
    the mean of each marker in its body's frame, which is misplacement and not noise. Misplacement itself turns a
    whole cluster about its joint, which no recording shows: `offset_covariance` is placement_sd^2 (J^T J)^-1, averaged
    over the trial. With a `posture` prior of inverse covariance P every (J^T J / s^2)^-1 is (J^T J / s^2 + P)^-1.

    **Arguments**: `sites` one a marker; `markers` m, NaN in gaps; `rate`, `cutoff` Hz; `placement_sd` m, per axis;
    `posture` for models with more joints than the markers determine.
    """
    told = progress or (lambda fraction: None)
    seen = np.asarray(np.isfinite(markers).all(axis=-1))
    first = first_frames(seen, rate)
    some, there = markers[first], seen[first]
    raw = solve_poses(model, sites, some, there.astype(float), progress=lambda done: told(0.3 * done), posture=posture)
    shift = _mean_places(raw, some, there)
    raw = _gaps_again(model, sites, raw, some, there, shift, posture)
    filtered = lowpass(_bridged(raw, first, markers, seen), rate, min(cutoff, HIGHEST_CUTOFF * rate))
    weight = np.where(_long_gaps(seen, rate), 0.0, 1.0)
    start = interpolated(model, first, raw.q, len(markers))
    second = solve_poses(model, sites, filtered, weight, start, shift, lambda done: told(0.3 + 0.7 * done), posture)
    sd = _marker_sd(second, filtered, weight, model.nv, FIRST_SD if posture is None else float(posture.noise))
    covariance, determined = pose_covariance(second.information, sd if np.isfinite(sd) else FIRST_SD, second.prior)
    if not np.isfinite(sd):
        covariance = np.full_like(covariance, np.nan)
    usable = determined & second.converged
    some = np.flatnonzero(usable) if usable.any() else np.arange(len(usable))
    some = some[:: -(-len(some) // OFFSET_FRAMES)]
    prior = None if second.prior is None else second.prior[some]
    offsets, _ = pose_covariance(second.information[some], placement_sd, prior)
    on_sites = second.predicted - _turned(second, shift)
    return JointAngles(
        q=second.q,
        covariance=covariance,
        offset_covariance=offsets.astype(float).mean(axis=0),
        valid=usable,
        residual=np.where(seen, np.linalg.norm(markers - on_sites, axis=-1), np.nan),
        body_rotations=second.body_rotations,
        body_positions=second.body_positions,
        marker_sd=sd,
    )


def first_frames(seen: Bool[np.ndarray, "frame marker"], rate: float) -> np.ndarray:
    """Frames that the first solution needs: `FIRST_RATE` of them a second, and those with a gap."""
    wanted = np.array(~seen.all(axis=1))
    wanted[:: max(1, int(rate / FIRST_RATE))] = True
    wanted[-1] = True
    return np.flatnonzero(wanted)


def _turned(poses: PoseSolution, places: np.ndarray) -> np.ndarray:
    """Vectors fixed in the markers' bodies, in world axes, `[frame, marker, 3]`."""
    return np.einsum("fmij,mj->fmi", poses.rotations, places)


def _mean_places(poses: PoseSolution, markers: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Mean place of every marker beside its site, body axes; from complete frames where there are enough."""
    complete = np.asarray(seen.all(axis=1))
    used = seen & complete[:, None] if complete.sum() >= ENOUGH else seen
    beside = np.einsum("fmji,fmj->fmi", poses.rotations, np.nan_to_num(markers - poses.predicted))
    return np.sum(np.where(used[:, :, None], beside, 0.0), axis=0) / np.maximum(used.sum(axis=0), 1)[:, None]


def _gaps_again(
    model: Model,
    sites: tuple[int, ...],
    poses: PoseSolution,
    markers: np.ndarray,
    seen: np.ndarray,
    shift: np.ndarray,
    posture: PosturePrior | None,
) -> PoseSolution:
    """Frames with a gap solved with the markers' own places; predictions of all frames on these places."""
    poses = poses._replace(predicted=poses.predicted + _turned(poses, shift))
    gaps = np.flatnonzero(~seen.all(axis=1))
    if not len(gaps):
        return poses
    again = solve_poses(model, sites, markers[gaps], seen[gaps].astype(float), poses.q[gaps], shift, posture=posture)

    def replaced(old: np.ndarray, new: np.ndarray) -> np.ndarray:
        old = old.copy()
        old[gaps] = new
        return old

    return jax.tree.map(replaced, poses, again)


def _bridged(poses: PoseSolution, frames: np.ndarray, markers: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Markers with their gaps filled from the poses at `frames`, which hold every gap and what is near it."""
    result = markers.copy()
    for marker in range(markers.shape[1]):
        here = seen[frames, marker]
        gone = ~here
        if not gone.any():
            continue
        rotations, predicted = poses.rotations[:, marker], poses.predicted[:, marker]
        if here.any():
            beside = np.einsum("fji,fj->fi", rotations[here], markers[frames[here], marker] - predicted[here])
            filled = np.stack([np.interp(frames[gone], frames[here], column) for column in beside.T], axis=1)
        else:
            filled = np.zeros((gone.sum(), 3))
        result[frames[gone], marker] = predicted[gone] + np.einsum("fij,fj->fi", rotations[gone], filled)
    return result


def _long_gaps(seen: np.ndarray, rate: float) -> np.ndarray:
    long = np.zeros(seen.shape, bool)
    for marker in range(seen.shape[1]):
        for start, stop in runs(~seen[:, marker]):
            if stop - start > LONGEST_BRIDGE * rate:
                long[start:stop, marker] = True
    return long


def _marker_sd(poses: PoseSolution, markers: np.ndarray, weight: np.ndarray, nv: int, noise: float) -> float:
    """Standard deviation per axis of markers about their mean place on their body, NaN if none is redundant.

    Frames in which too few markers are seen to determine the pose say nothing and are left out. A frame's pose takes
    trace(H (H + P)^-1) measurements, H = J^T J / noise^2: nv without a posture prior P.
    """
    used = weight > 0
    if poses.prior is not None:
        seen = poses.information / noise**2
        eye = np.eye(nv) * 1e-9 * np.max(seen)
        taken = np.trace(np.linalg.solve(seen + poses.prior + eye, seen), axis1=1, axis2=2)
    else:
        taken = np.full(len(used), float(nv))
    used &= (3 * used.sum(axis=1) >= taken)[:, None]
    beside = np.einsum("fmji,fmj->fmi", poses.rotations, markers - poses.predicted)
    count = used.sum(axis=0)
    mean = np.sum(np.where(used[:, :, None], beside, 0.0), axis=0) / np.maximum(count, 1)[:, None]
    squares = np.sum(np.where(used[:, :, None], (beside - mean) ** 2, 0.0))
    freedom = 3 * used.sum() - taken[used.any(axis=1)].sum() - 3 * np.sum(count > 0)
    return float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")
