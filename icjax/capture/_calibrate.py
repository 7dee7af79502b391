"""Kinematic calibration: a subject's segment lengths, joint axes and marker places from recorded movement."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._bundle import Blocks, Bundle, Data, adjust, schur
from icjax.capture._calibration_parameters import (
    CalibrationOptions,
    Parameters,
    calibration_parameters,
    changed_model,
)
from icjax.capture._pose import PoseSolution, solve_poses
from icjax.capture._posture import PosturePrior, no_prior
from icjax.model import Model

FIRST_SD = 0.001
"""m; marker noise before the first residuals are known."""

ROUNDS = 6
"""Most times that the noise is taken from the residuals and the adjustment repeated."""

SETTLED = 0.02
"""Relative change of the noise below which it is not repeated."""

CANDIDATES = 6
"""Frames looked at for every frame used."""

DETERMINED = 0.5
"""A parameter whose standard deviation is not brought below this share of its prior's is called undetermined."""


@dataclasses.dataclass(frozen=True)
class Calibration:
    """A calibrated model and how well it is known.

    - `model`; `names`, `units` of the parameters: scale factors are given as relative changes, tilts in rad, places
      in m along body axes.
    - `value`, `sd`, `prior_sd` [parameter]; `covariance` [parameter, parameter] after the poses are integrated out.
    - `determined` [parameter]: whether the recordings say more than the prior, sd < 0.5 prior sd.
    - `offset_covariance` [dof, dof]: of the constant error that all this leaves in the coordinates, averaged over the
      frames.
    - `marker_sd`: m, per axis, of a marker about the calibrated model; `frames` used.
    - `residual_before`, `residual_after`: m, RMS distance of the markers to the model's sites in these frames.
    - `converged`.
    """

    model: Model
    names: tuple[str, ...]
    units: tuple[str, ...]
    value: Float[np.ndarray, " parameter"]
    sd: Float[np.ndarray, " parameter"]
    prior_sd: Float[np.ndarray, " parameter"]
    determined: Bool[np.ndarray, " parameter"]
    covariance: Float[np.ndarray, "parameter parameter"]
    offset_covariance: Float[np.ndarray, "dof dof"]
    marker_sd: float
    frames: int
    residual_before: float
    residual_after: float
    converged: bool


def calibrate_model(
    model: Model,
    sites: tuple[int, ...],
    recordings: tuple[Float[np.ndarray, "_ marker 3"], ...],
    placement_sd: float,
    options: CalibrationOptions,
    posture: PosturePrior | None = None,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Segment lengths, joint axes and marker places of greatest posterior probability, with the poses of the frames.

    Minimise over the parameters z (in units of their priors) and the poses q_f

        sum_f sum_i norm(x_fi - p_i(q_f, z))^2 / s^2 + norm(z)^2 (+ posture),

    so that what the recordings do not say stays at the model's value: the estimate is shrunk to anthropometry. s is
    the markers' standard deviation, taken from the residuals. Poses are eliminated frame by frame (`schur`), and the
    covariance of the parameters is that of the reduced problem.

    The frames are spread over the postures that the recordings hold (each next one is the candidate farthest, in
    joint angles, from those chosen). A rotation of a distal cluster about its joint's axis cannot be told from a
    joint offset: it keeps its prior, and what it does to the angles is `offset_covariance`,

        d q_f = -(J_q^T J_q / s^2 + P)^-1 (J_q^T J_z / s^2) d z, averaged over the frames.

    Skin that moves over bone is no part of this: where residuals follow the posture, the standard deviations are
    too small.

    **Arguments**: `sites` one a marker; `recordings` markers of each trial, m, NaN in gaps; `placement_sd` m, per
    axis; `posture` for models with more joints than the markers determine.

    **Errors**: `ValueError` when no parameter is left to estimate, or no frame has markers.

    **Source**: Kry and Pai 2006, section 4.3 (calibration as the cure); Reinbolt et al. 2005, J. Biomech. 38, 621
    (joint parameters and poses from markers); Triggs et al. 2000 (bundle adjustment).
    """
    told = progress or (lambda fraction: None)
    parameters = calibration_parameters(model, sites, placement_sd, options)
    if not parameters.names:
        raise ValueError("calibration: nothing to estimate (no size, lengths, axes or placement)")
    markers, weight, poses = _spread_frames(model, sites, recordings, options.frames, posture)
    told(0.2)
    data = Data(
        markers=jnp.asarray(np.nan_to_num(markers)),
        weight=jnp.asarray(weight),
        posture=no_prior(model) if posture is None else posture,
        sd=jnp.asarray(FIRST_SD),
    )
    at = Bundle(jnp.asarray(poses.q), jnp.zeros(len(parameters.names)))
    sd, converged = FIRST_SD, False
    for turn in range(ROUNDS):

        def inner(fraction: float, turn: int = turn) -> None:
            told(0.2 + 0.8 * (turn + fraction) / ROUNDS)

        at, blocks, converged = adjust(model, sites, parameters, at, data, inner)
        found = _noise(blocks, data, sd)
        if abs(found - sd) < SETTLED * sd:
            break
        sd = found
        data = data._replace(sd=jnp.asarray(sd))
    told(1.0)
    return _result(model, sites, parameters, at, blocks, data, converged, poses)


def _result(
    model: Model,
    sites: tuple[int, ...],
    parameters: Parameters,
    at: Bundle,
    blocks: Blocks,
    data: Data,
    converged: bool,
    poses: PoseSolution,
) -> Calibration:
    prior = parameters.prior_sd
    inverse = np.linalg.inv(np.asarray(schur(blocks, jnp.asarray(0.0))[2]))
    effect = np.linalg.solve(np.asarray(blocks.A), np.asarray(blocks.B))
    sd = np.sqrt(np.diag(inverse))
    calibrated = jax.tree.map(np.asarray, changed_model(model, sites, parameters, at.z))
    weight = np.asarray(data.weight)
    before = np.linalg.norm(np.asarray(data.markers) - poses.predicted, axis=-1)
    return Calibration(
        model=calibrated,
        names=parameters.names,
        units=parameters.units,
        value=np.asarray(at.z) * prior,
        sd=sd * prior,
        prior_sd=prior,
        determined=sd < DETERMINED,
        covariance=inverse * prior[:, None] * prior[None, :],
        offset_covariance=np.einsum("fvp,pr,fwr->vw", effect, inverse, effect) / len(effect),
        marker_sd=float(data.sd),
        frames=len(effect),
        residual_before=float(np.sqrt(np.sum(weight * before**2) / weight.sum())),
        residual_after=float(np.sqrt(float(blocks.misfit) / weight.sum()) * float(data.sd)),
        converged=bool(converged),
    )


def _noise(blocks: Blocks, data: Data, sd: float) -> float:
    """Standard deviation of a marker per axis: sum of squares over what is left of the number of measurements.

    Poses and parameters take trace(H_data H^-1) measurements each, less than their number where priors hold them.
    """
    seen, A = np.asarray(blocks.seen), np.asarray(blocks.A)
    taken = float(np.sum(np.trace(np.linalg.solve(A, seen), axis1=1, axis2=2)))
    reduced = np.asarray(schur(blocks, jnp.asarray(0.0))[2])
    taken += len(reduced) - float(np.trace(np.linalg.inv(reduced)))
    left = 3 * float(jnp.sum(data.weight)) - taken
    if left <= 0:
        raise ValueError("calibration: the markers are too few to tell noise from movement")
    return float(np.sqrt(float(blocks.misfit) * sd**2 / left))


def _spread_frames(
    model: Model,
    sites: tuple[int, ...],
    recordings: tuple[np.ndarray, ...],
    count: int,
    posture: PosturePrior | None,
) -> tuple[np.ndarray, np.ndarray, PoseSolution]:
    """Frames that cover the postures, their weights, and their poses on the model as it is."""
    each = -(-CANDIDATES * count // len(recordings))
    parts = []
    for markers in recordings:
        seen = np.asarray(np.isfinite(markers).all(axis=-1))
        most = np.flatnonzero(seen.sum(axis=1) >= min(seen.sum(axis=1).max(), seen.shape[1] - 1))
        if not seen.any():
            raise ValueError("calibration: a recording has no markers")
        chosen = np.unique(most[np.linspace(0, len(most) - 1, min(each, len(most))).astype(int)])
        parts.append(markers[chosen])
    solved = [
        solve_poses(model, sites, part, np.isfinite(part).all(axis=-1).astype(float), posture=posture) for part in parts
    ]
    poses = jax.tree.map(lambda *items: np.concatenate(items), *solved)
    markers = np.concatenate(parts)
    weight = np.isfinite(markers).all(axis=-1).astype(float)
    distance = np.nan_to_num(np.linalg.norm(markers - poses.predicted, axis=-1))
    error = np.sqrt(np.sum(weight * distance**2, axis=1) / weight.sum(axis=1))
    settled = poses.converged | ~poses.converged.any()  # on a hand of another size none may; they are only a start
    usable = np.flatnonzero(settled & (error <= 3 * np.median(error)))
    picked = usable[_farthest(_angles(model, poses.q[usable]), count)]
    return markers[picked], weight[picked], jax.tree.map(lambda item: item[picked], poses)


def _angles(model: Model, q: np.ndarray) -> np.ndarray:
    """Coordinates of hinges, slides and balls: what a posture is, wherever it stands."""
    parts = [
        q[:, part]
        for kind, part in zip(model.joint_types, model.coordinate_slices, strict=True)
        if kind in ("hinge", "slide", "ball")
    ]
    return np.concatenate(parts, axis=1) if parts else np.zeros((len(q), 1))


def _farthest(points: np.ndarray, count: int) -> np.ndarray:
    """Indices of at most `count` points, each the farthest from all before it (Gonzalez 1985), in order of time."""
    if len(points) <= count:
        return np.arange(len(points))
    chosen = [int(np.argmin(np.linalg.norm(points - np.median(points, axis=0), axis=1)))]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return np.unique(chosen)
