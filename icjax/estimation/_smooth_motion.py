"""Coordinates of a recording as smooth functions of time, with velocity and acceleration on the manifold."""

from typing import NamedTuple

import numpy as np

from icjax.model import Model
from icjax.typing import Bool, Float, Real

TWO_PASS = (2**0.5 - 1) ** 0.25
"""0.802: where 1 / (1 + x^4) is 1 / sqrt 2. The stated cut-off is this share of the frequency of half the amplitude."""

SHORTEST_RUN = 5
"""Frames; the least that a cubic smoothing spline is fitted to."""


class Motion(NamedTuple):
    """A smoothed movement.

    - `q` [time, nq]: coordinates, quaternions of unit length.
    - `v`, `a` [time, nv]: velocity and its time derivative, component by component, in the model's conventions
      (ball: angular velocity in body axes; free: body twist, the phi and phidot of Eq. 3).

    NaN where the pose is unknown.
    """

    q: Float[np.ndarray, "time coordinate"]
    v: Float[np.ndarray, "time dof"]
    a: Float[np.ndarray, "time dof"]


def smooth_motion(
    model: Model,
    time: Float[Real, " time"],
    q: Float[Real, "time coordinate"],
    cutoff: float,
    valid: Bool[Real, " time"] | None = None,
) -> Motion:
    """Cubic smoothing splines through the coordinates, and their derivatives.

    Every column y of q becomes the f that minimises sum_k (y_k - f(t_k))^2 + lambda integral f''^2. At equal steps h
    it is a zero-phase low-pass filter with the gain

        H(w) = 1 / (1 + lambda h w^4),    lambda = 1 / (h (2 pi cutoff / 0.802)^4),

    that of a second-order Butterworth filter forward and backward, with gain 1 / sqrt 2 at `cutoff`. Derivatives are
    those of the spline. f'' is zero at both ends of a run, so the acceleration is too small within about one period
    of the cut-off from there.

    Quaternions are made continuous, smoothed by component and scaled to unit length: with u the smoothed one,
    `w = 2 vec(u* u') / |u|^2` in body axes and dw/dt its derivative. A free joint's twist is (w, R^T p').

    **Arguments**: `time` s; `q` as in the model; `cutoff` Hz; `valid` frames with a known pose, default those with
    finite coordinates. Runs of such frames are smoothed each by itself; a run shorter than 5 frames counts as unknown.

    **Errors**: `ValueError` for a cut-off that is not positive or reaches half the sampling rate.

    Source: Woltring 1986, Advances in Engineering Software 8, 104-113 (the equivalent filter).
    """
    time, q = np.asarray(time, dtype=float), np.asarray(q, dtype=float)
    rate = (len(time) - 1) / float(time[-1] - time[0])
    if not 0 < cutoff < rate / 2:
        raise ValueError(f"cutoff = {cutoff:g} Hz: must be above zero and below half the rate, {rate / 2:g} Hz")
    known = np.isfinite(q).all(axis=1)
    if valid is not None:
        known &= np.asarray(valid)
    weight = rate / (2 * np.pi * cutoff / TWO_PASS) ** 4
    motion = Motion(np.full_like(q, np.nan), *(np.full((len(q), model.nv), np.nan) for _ in range(2)))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        if stop - start >= SHORTEST_RUN:
            parts = _one_run(model, time[start:stop], q[start:stop], weight)
            for whole, part in zip(motion, parts, strict=True):
                whole[start:stop] = part
    return motion


def _one_run(model: Model, time: np.ndarray, q: np.ndarray, weight: float) -> Motion:
    from scipy.interpolate import make_smoothing_spline

    y = _same_side(model, q)
    spline = make_smoothing_spline(time - time[0], y, lam=weight)
    f, df, ddf = (np.asarray(spline(time - time[0], order)) for order in range(3))
    v, a = np.zeros((len(q), model.nv)), np.zeros((len(q), model.nv))
    for kind, at, dofs in zip(model.joint_types, model.coordinate_slices, model.dof_slices, strict=True):
        if kind in ("hinge", "slide"):
            v[:, dofs], a[:, dofs] = df[:, at], ddf[:, at]
            continue
        unit = slice(at.stop - 4, at.stop)
        w, dw = _angular(f[:, unit], df[:, unit], ddf[:, unit])
        f[:, unit] /= np.linalg.norm(f[:, unit], axis=1, keepdims=True)
        turn = slice(dofs.start, dofs.start + 3)
        v[:, turn], a[:, turn] = w, dw
        if kind == "free":
            place, move = slice(at.start, at.start + 3), slice(dofs.start + 3, dofs.stop)
            v[:, move] = _into_body(f[:, unit], df[:, place])
            a[:, move] = _into_body(f[:, unit], ddf[:, place]) - np.cross(w, v[:, move])
    return Motion(f, v, a)


def _same_side(model: Model, q: np.ndarray) -> np.ndarray:
    """Quaternions of successive frames on the same side."""
    q = q.copy()
    for kind, at in zip(model.joint_types, model.coordinate_slices, strict=True):
        if kind in ("ball", "free"):
            unit = slice(at.stop - 4, at.stop)
            turns = np.sum(q[1:, unit] * q[:-1, unit], axis=1) < 0
            q[1:, unit] *= np.where(np.cumsum(turns) % 2 == 1, -1.0, 1.0)[:, None]
    return q


def _angular(u: np.ndarray, du: np.ndarray, ddu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Angular velocity in body axes and its derivative, of a quaternion that need not have unit length."""
    square = np.sum(u * u, axis=1, keepdims=True)
    w = 2 * _vector(u, du) / square
    dw = 2 * _vector(u, ddu) / square - w * 2 * np.sum(u * du, axis=1, keepdims=True) / square
    return w, dw


def _vector(u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Vector part of the product u* x."""
    return u[:, :1] * x[:, 1:] - x[:, :1] * u[:, 1:] - np.cross(u[:, 1:], x[:, 1:])


def _into_body(u: np.ndarray, x: np.ndarray) -> np.ndarray:
    """R(u)^T x for unit quaternions u = (s, -r): x + 2 s r x x + 2 r x (r x x)."""
    s, r = u[:, :1], -u[:, 1:]
    return x + 2 * s * np.cross(r, x) + 2 * np.cross(r, np.cross(r, x))
