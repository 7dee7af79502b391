"""From markers to joint angles: one nonlinear least-squares problem a frame, all frames at once."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._posture import PosturePrior, prior_normal_equations
from icjax.capture._registration import start_coordinates
from icjax.inference import covariance, least_squares
from icjax.model import Model, frames, integrate, neutral, tree
from icjax.results import RESULTS
from icjax.typing import Real

BLOCK = 512
"""Frames solved by one compiled call; trials of every length share its compilation."""

NEAR = 1e-6
"""rad or m: error that the search may leave; most frames end a hundred times closer."""

FAR_START, NEAR_START = 1e-3, 1e-6
"""First damping of the search from a registration of the root, and from the solution of frames nearby."""

WIDEST = 10.0
"""rad or m: what an undetermined coordinate's standard deviation is set to."""


class PoseSolution(NamedTuple):
    """Pose of every frame.

    - `q` [frame, nq]; `information` [frame, nv, nv]: J^T J with J = d(markers) / dq, 1/m2 (rad, m).
    - `prior` [frame, nv, nv]: inverse covariance that a posture prior adds, 1 (rad, m); None without one.
    - `predicted` [frame, marker, 3]: markers on the model, m.
    - `rotations` [frame, marker, 3, 3]: of the body that carries each marker.
    - `body_rotations` [frame, body, 3, 3], `body_positions` [frame, body, 3]: world poses of all bodies.
    - `converged` [frame].
    """

    q: Float[np.ndarray, "frame nq"]
    information: Float[np.ndarray, "frame nv nv"]
    prior: Float[np.ndarray, "frame nv nv"] | None
    predicted: Float[np.ndarray, "frame marker 3"]
    rotations: Float[np.ndarray, "frame marker 3 3"]
    body_rotations: Float[np.ndarray, "frame body 3 3"]
    body_positions: Float[np.ndarray, "frame body 3"]
    converged: Bool[np.ndarray, " frame"]


def solve_poses(
    model: Model,
    sites: tuple[int, ...],
    markers: Float[np.ndarray, "frame marker 3"],
    weight: Float[np.ndarray, "frame marker"],
    start: Float[np.ndarray, "frame nq"] | None = None,
    shift: Float[np.ndarray, "marker 3"] | None = None,
    progress: Callable[[float], None] | None = None,
    posture: PosturePrior | None = None,
) -> PoseSolution:
    """Coordinates that bring the model's sites closest to the markers, frame by frame.

    Minimise sum_i w_i |x_i - p_i(q)|^2 over q, with w_i zero in gaps. Without `start`, frames spread over the trial
    are solved first from a registration of the root (see `start_coordinates`); the others start from what is found
    there, interpolated in time.

    **Arguments**: `sites` of the model, one a marker; `markers` m, NaN where `weight` is zero; `shift` moves the
    markers' places on their bodies away from the sites, m; `progress` is told the finished fraction; the residuals
    of `posture` are added to those of the markers.
    """
    weight = np.where(np.isfinite(markers).all(axis=-1), weight, 0.0)
    markers = np.nan_to_num(markers)
    places = np.asarray(model.site_position)[list(sites)]
    if shift is not None:
        places = places + shift
    if start is None:
        start = _spread_start(model, sites, places, markers, weight, posture)
    solve = partial(_compiled, model, sites, places, posture, np.asarray(NEAR_START))
    return PoseSolution(*by_blocks(solve, start, markers, weight, progress=progress))


def _spread_start(
    model: Model,
    sites: tuple[int, ...],
    places: np.ndarray,
    markers: np.ndarray,
    weight: np.ndarray,
    posture: PosturePrior | None,
) -> np.ndarray:
    """Solutions of at most one block of frames spread over the trial, interpolated to all frames."""
    count = len(markers)
    complete = np.flatnonzero(weight.sum(axis=1) >= weight.sum(axis=1).max())
    chosen = np.unique(complete[np.linspace(0, len(complete) - 1, min(len(complete), BLOCK)).astype(int)])
    observed, weights = markers[chosen], weight[chosen]

    def solve(q, w, prior=posture):
        rows = observed[: len(q)]
        solve = partial(_compiled, model, sites, places, prior, np.asarray(FAR_START))
        return PoseSolution(*by_blocks(solve, q, rows, w))

    nothing = posture
    if posture is not None:
        blank = {name: np.zeros_like(getattr(posture, name)) for name in ("over_q", "over_v", "target", "limit")}
        nothing = posture._replace(**blank)
    unmoved = solve(
        np.asarray(neutral(model))[None], np.zeros_like(weights[:1]), nothing
    )  # without weights nothing moves: the neutral poses
    guess = start_coordinates(model, sites, unmoved.body_rotations[0], unmoved.body_positions[0], observed, weights)
    found = solve(guess, weights)
    error = np.sqrt(np.mean(weights[:, :, None] * (observed - found.predicted) ** 2, axis=(1, 2)))
    near = _wrapped(model, found.q)
    good = error <= 3 * np.median(error)
    if not good.all():
        again = near[good][np.argmin(np.abs(chosen[:, None] - chosen[good][None, :]), axis=1)]
        near = _wrapped(model, solve(again, weights).q)
    return interpolated(model, chosen, _continuous(model, near), count)


def interpolated(
    model: Model, frames: np.ndarray, q: Float[np.ndarray, "_ nq"], count: int
) -> Float[np.ndarray, "frame nq"]:
    """Coordinates of `count` frames, linear between those of `frames`; quaternions are brought back to length one."""
    start = np.stack([np.interp(np.arange(count), frames, column) for column in q.T], axis=1)
    for kind, part in zip(model.joint_types, model.coordinate_slices, strict=True):
        if kind in ("ball", "free"):
            unit = slice(part.stop - 4, part.stop)
            start[:, unit] /= np.linalg.norm(start[:, unit], axis=1, keepdims=True)
    return start


def _wrapped(model: Model, q: np.ndarray) -> np.ndarray:
    """Hinge coordinates within half a turn of the model's zero."""
    q = q.copy()
    zero = np.asarray(model.zero)
    for kind, part in zip(model.joint_types, model.coordinate_slices, strict=True):
        if kind == "hinge":
            q[:, part] = zero[part] + (q[:, part] - zero[part] + np.pi) % (2 * np.pi) - np.pi
    return q


def _continuous(model: Model, q: np.ndarray) -> np.ndarray:
    """Quaternions of successive frames on the same side."""
    q = q.copy()
    for kind, part in zip(model.joint_types, model.coordinate_slices, strict=True):
        if kind in ("ball", "free"):
            unit = slice(part.stop - 4, part.stop)
            turns = np.sum(q[1:, unit] * q[:-1, unit], axis=1) < 0
            q[1:, unit] *= np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)[:, None]
    return q


def _padded(array: np.ndarray, length: int) -> np.ndarray:
    return np.concatenate([array, np.repeat(array[-1:], length - len(array), axis=0)])


@eqx.filter_jit
def _compiled(model: Model, sites: tuple[int, ...], places, posture, damping, start, markers, weight):
    bodies = np.asarray(model.site_bodies)[list(sites)]
    places = jnp.asarray(places)

    every = np.arange(len(model.body_names))

    def predicted(at):
        poses = at.bodies(model, bodies)
        return jnp.einsum("sij,sj->si", poses.rotation, places) + poses.position

    def normal_equations(q, data):
        observed, w = data
        at = frames(model, q)
        points = predicted(at)
        misfit = points - observed
        own = marker_normal_equations(model, bodies, at.twists, points, misfit, w)
        return own if posture is None else jax.tree.map(jnp.add, own, prior_normal_equations(model, posture, q))

    solution = least_squares(
        None,
        start,
        (markers, weight),
        nv=model.nv,
        retract=lambda q, dq: integrate(model, q, dq),
        normal_equations=normal_equations,
        tolerance=NEAR,
        damping=damping,
    )
    q = solution.value.value
    at = jax.vmap(lambda q: frames(model, q))(q)
    places_W, poses = jax.vmap(predicted)(at), jax.vmap(lambda at: at.bodies(model, every))(at)
    solved = jax.vmap(lambda item: item == RESULTS.solved)(solution.result)

    seen, prior = solution.value.information, None
    if posture is not None:
        known = jax.vmap(lambda q: prior_normal_equations(model, posture, q)[1])(q)
        seen, prior = seen - known, known / posture.noise**2
    return q, seen, prior, places_W, poses.rotation[:, bodies], poses.rotation, poses.position, solved


def marker_normal_equations(
    model: Model,
    bodies: np.ndarray,
    twists: Float[Real, "nv 6"],
    points: Float[Real, "marker 3"],
    misfit: Float[Real, "marker 3"],
    weight: Float[Real, " marker"],
) -> tuple[Float[Real, ""], Float[Real, "nv nv"], Float[Real, " nv"]]:
    """Cost, J^T J and J^T r of sum_i w_i |e_i|^2 for points fixed in bodies, e_i their misfits.

    J^T J is the mass matrix of masses w_i at the points, J^T r the generalised force of the forces w_i e_i there. Like
    those they come from sums over what each degree of freedom carries (composite bodies), for a fraction of the
    products of J^T J: with c = sum w p and I = sum w (|p|^2 - p p^T), the momentum of a twist (omega, v) is
    (I omega + c x v, v sum w - c x omega). All about the mean of the points, where the sums do not cancel.
    """
    origin = jnp.mean(points, axis=0)
    points = points - origin[None]
    carried = jnp.asarray(model.path_mask[bodies], points.dtype).T
    force = weight[:, None] * misfit
    square = jnp.sum(points**2, axis=1)[:, None, None] * jnp.eye(3, dtype=points.dtype)[None]
    inertia = weight[:, None, None] * (square - points[:, :, None] * points[:, None, :])
    each = [weight[:, None], weight[:, None] * points, inertia.reshape(-1, 9), jnp.cross(points, force), force]
    mass, centre, inertia, wrench = jnp.split(carried @ jnp.concatenate(each, axis=1), (1, 4, 13), axis=1)
    omega = twists[:, :3]
    v = twists[:, 3:] + jnp.cross(omega, origin[None])
    turning = jnp.einsum("dij,dj->di", inertia.reshape(-1, 3, 3), omega) + jnp.cross(centre, v)
    twists = jnp.concatenate([omega, v], axis=1)
    half = jnp.concatenate([turning, mass * v - jnp.cross(centre, omega)], axis=1) @ twists.T
    above = tree(model).dof_mask
    H = jnp.where(above, half, jnp.where(above.T, half.T, 0.0))
    return jnp.sum(force * misfit), 0.5 * (H + H.T), jnp.sum(wrench * twists, axis=1)


def marker_jacobian(
    model: Model, bodies: np.ndarray, twists: Float[Real, "nv 6"], points: Float[Real, "marker 3"]
) -> Float[Real, "marker 3 nv"]:
    """Velocity of points fixed in bodies per velocity of the coordinates: v + w x p of every twist that moves them.

    **Arguments**: `bodies` [marker] index; `twists` of the degrees of freedom and `points` (m), world.
    """
    velocities = twists[None, :, 3:] + jnp.cross(twists[None, :, :3], points[:, None, :])
    return jnp.swapaxes(model.path_mask[bodies][:, :, None] * velocities, 1, 2)


def pose_covariance(
    information: Float[np.ndarray, "frame nv nv"], sd: float, prior: Float[np.ndarray, "frame nv nv"] | None = None
) -> tuple[Float[np.ndarray, "frame nv nv"], Bool[np.ndarray, " frame"]]:
    """Covariance of the coordinates for markers of standard deviation `sd` (m, per axis), (J^T J / s^2 + P)^-1.

    **Arguments**: `prior` P, the inverse covariance of a posture prior, default none.

    **Returns** the covariance (rad2, m2, in single precision: a standard deviation to 1e-7) and which frames determine
    every coordinate.
    """
    rows = (information,) if prior is None else (information, prior)
    return by_blocks(partial(_covariance, np.float64(sd) ** 2), *rows)


@jax.jit
def _covariance(variance, information, prior=0.0):
    found, determined = covariance(information / variance + prior, 1.0, WIDEST)
    return found.astype(jnp.float32), determined


def by_blocks(
    function: Callable[..., Any], *arrays: np.ndarray, progress: Callable[[float], None] | None = None
) -> Any:
    """Apply a compiled function to blocks of `BLOCK` frames, the last one filled up, and join what it returns."""
    count = len(arrays[0])
    joined = None
    for first in range(0, count, BLOCK):
        rows = slice(first, min(first + BLOCK, count))
        filled = [_padded(np.asarray(array[rows]), BLOCK) for array in arrays]
        result = function(*(jnp.asarray(array) for array in filled))
        if joined is None:
            joined = jax.tree.map(lambda item: np.empty((count, *item.shape[1:]), item.dtype), result)
        for whole, part in zip(jax.tree.leaves(joined), jax.tree.leaves(result), strict=True):
            whole[rows] = np.asarray(part)[: rows.stop - first]
        if progress is not None:
            progress(rows.stop / count)
    return joined
