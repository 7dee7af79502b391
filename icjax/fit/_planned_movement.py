"""What a movement without catch trials would have done after contact: a Gaussian process learnt from free movement."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import minimize

from icjax.fit._variability import (
    FAST,
    JITTER,
    NOISE_SD,
    curvature_inverse,
    matern,
    matern_by_length,
    with_noise,
)
from icjax.fit._windows import Motion
from icjax.typing import Float

LEAST_STRETCHES = 4
"""Stretches of free movement below which nothing is learnt of how movement goes on."""

CENTRE = np.log([0.2, 0.2, np.radians(0.05), 1.0])
WIDTH = np.array([*np.log([5.0, 2.0, 5.0]), NOISE_SD])
"""Prior of the logarithms of `reach`, `length`, `tremor` and `noise`: means and standard deviations."""

LEAST = 2.0
"""Of these deviations, by which a number lies below the mean at most: a joint that never moved in what was recorded is
not known to a hundredth of a milliradian."""

STILL = 0.05
"""rad/s; a pace below which noise and tremor are all that moves."""

ANYWHERE = 1.0
"""rad; standard deviation of where a movement begins."""

MODES = 6
"""Of the systematic part of each joint; the sixth has a hundredth of the first one's standard deviation or less."""

GRID = 0.004
"""s between the times at which these modes are computed."""

BRAKING = 0.04
"""s before contact, over which its velocity is taken."""


class Stretch(NamedTuple):
    """Free movement, angles [sample, dof], and how much of it no other stretch holds: a sample that two hold counts
    half in each."""

    angle: Float[np.ndarray, "sample dof"]
    share: float = 1.0


class PlannedMovement(NamedTuple):
    """Planned movement of each joint as a process of twice differentiable paths (`matern`).

    - `reach` s [dof]: its standard deviation over the `pace` of the movement, so that fast movements may change more.
    - `length` s [dof] of the process, `tremor` rad [dof] of what is faster (length `FAST`).
    - `noise` [dof] multiplies the instrument's standard deviations.
    - `inflation` multiplies the covariance so that free movement foretold from what precedes it misses as much as it
      says.
    - `doubt` [dof, 4, 4]: covariance of the logarithms of each joint's reach, length, tremor and noise; None: they are
      known.
    """

    reach: Float[np.ndarray, " dof"]
    length: Float[np.ndarray, " dof"]
    tremor: Float[np.ndarray, " dof"]
    noise: Float[np.ndarray, " dof"]
    inflation: float
    doubt: Float[np.ndarray, "dof 4 4"] | None = None

    def moved(self, joint: int, logarithms: Float[np.ndarray, " 4"]) -> "PlannedMovement":
        """With the reach, length, tremor and noise of one joint multiplied by the exponentials."""
        numbers = np.stack(self[:4])
        numbers[:, joint] *= np.exp(logarithms)
        return self._replace(reach=numbers[0], length=numbers[1], tremor=numbers[2], noise=numbers[3])

    def covariance(
        self,
        s: Float[np.ndarray, " sample"],
        pace: Float[np.ndarray, " dof"],
        noise: Float[np.ndarray, "dof dof"],
        correlation: Float[np.ndarray, "sample sample"],
        joints: Sequence[int] | None = None,
    ) -> Float[np.ndarray, "sample dof sample joint"]:
        """Of the measured angles of a movement, wherever it begins; `joints` those of the last axis, default all."""
        lag = s[:, None] - s[None, :]
        tremor = matern(lag, FAST)
        own = [
            (reach * speed) ** 2 * matern(lag, length) + short**2 * tremor + ANYWHERE**2
            for reach, speed, length, short in zip(self.reach, pace, self.length, self.tremor, strict=True)
        ]
        return self.inflation * with_noise(own, noise * np.outer(self.noise, self.noise), correlation, joints)

    def modes(
        self, before: float, after: float, joints: Sequence[int] | None = None
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Of every joint, what a movement of unit pace may do after contact given all before it.

        **Arguments**: `joints` default all.

        **Returns** times s from contact, and for each joint an array [time, mode], s: columns of a factor of the
        covariance over pace^2, largest first.
        """
        s = np.arange(-round(before / GRID), round(after / GRID) + 1) * GRID
        known = s <= 0.0
        lag = s[:, None] - s[None, :]
        found = []
        for joint in range(len(self.reach)) if joints is None else joints:
            reach, length = self.reach[joint], self.length[joint]
            K = self.inflation * reach**2 * (matern(lag, length) + 1e-10 * np.eye(len(s)))
            gain = np.linalg.solve(K[np.ix_(known, known)], K[np.ix_(known, ~known)]).T
            left = K[np.ix_(~known, ~known)] - gain @ K[np.ix_(known, ~known)]
            values, vectors = np.linalg.eigh(0.5 * (left + left.T))
            values, vectors = values[::-1], vectors[:, ::-1]
            columns = np.zeros((len(s), MODES))
            columns[~known] = vectors[:, :MODES] * np.sqrt(np.maximum(values[:MODES], 0.0))
            found.append(columns)
        return s, found


def typical_movement(dofs: int) -> PlannedMovement:
    """At the centre of the prior: what is expected of a person of whom nothing is known."""
    reach, length, tremor, noise = np.repeat(np.exp(CENTRE)[:, None], dofs, axis=1)
    return PlannedMovement(reach, length, tremor, noise, 1.0)


def pace(
    s: Float[np.ndarray, " sample"], angle: Float[np.ndarray, "*rows sample dof"]
) -> Float[np.ndarray, "*rows dof"]:
    """Root mean square of the angular velocity at s <= 0, rad/s, at least `STILL`."""
    before = angle[..., s <= 0.0, :]
    rate = np.gradient(before, s[s <= 0.0], axis=-2)
    return np.sqrt(np.mean(rate**2, axis=-2) + STILL**2)


def velocity(s: Float[np.ndarray, " sample"], angle: Float[np.ndarray, "sample dof"]) -> Float[np.ndarray, " dof"]:
    """Mean angular velocity, rad/s, over the last `BRAKING` s before s = 0."""
    ends = np.stack([np.interp([-BRAKING, 0.0], s, column) for column in angle.T])
    return (ends[:, 1] - ends[:, 0]) / BRAKING


def alike(
    pace: Float[np.ndarray, "contact dof"],
    velocity: Float[np.ndarray, "contact dof"],
    torque: Float[np.ndarray, "contact dof"],
) -> Float[np.ndarray, "contact kind dof"]:
    """How large at each contact what movements do alike at all of them may be, rad/s: in proportion to their pace; to
    their velocity, as one who brakes brakes harder where faster; to the mean torque of the contact (over its root mean
    square, by that of the pace), as one may plan otherwise where one pushes harder."""
    size = np.sqrt(np.mean(torque**2, axis=0))
    usual = np.sqrt(np.mean(pace**2, axis=0))
    pushed = usual * np.divide(torque, size, out=np.zeros_like(torque), where=size > 0.0)
    return np.stack([pace, velocity, pushed], axis=1)


def free_stretches(motion: Motion, samples: int, stride: int, margins: tuple[float, float]) -> list[Stretch]:
    """Stretches of a recording without contact, each half over the next, `stride` frames apart.

    **Arguments**: `margins` s before an onset and after a release that do not count as free.
    """
    recording, length = motion.recording, (samples - 1) * stride + 1
    time = np.asarray(recording.time)
    free = motion.valid & ~np.asarray(recording.touching).any(axis=1)
    onset, release = np.asarray(recording.events.onset, float), np.asarray(recording.events.release, float)
    for start, end in zip(onset, release, strict=True):
        free &= (time < start - margins[0]) | (time > (np.inf if np.isnan(end) else end + margins[1]))
    edges = np.flatnonzero(np.diff(np.concatenate([[0], free.astype(int), [0]])))
    found = []
    for begin, end in zip(edges[::2], edges[1::2], strict=True):
        starts = range(end - length, begin - 1, -max(1, length // 2))
        share = (len(starts) + 1) / (2 * max(1, len(starts)))
        found += [Stretch(motion.angle[at : at + length : stride], share) for at in starts]
    return found


def learn_movement(
    s: Float[np.ndarray, " sample"],
    stretches: Sequence[Stretch],
    noise: Float[np.ndarray, "dof dof"],
    correlation: Float[np.ndarray, "sample sample"],
) -> PlannedMovement:
    """Hyperparameters of greatest posterior density from stretches of free movement, joints taken one by one.

    `inflation` is the mean square of the whitened angles at s > 0 given those before, at least one.

    **Arguments**: `s` of the samples, zero where in a contact's window the contact would be; `stretches` count by
    their shares.

    **Errors**: `ValueError` for fewer than `LEAST_STRETCHES`.
    """
    if len(stretches) < LEAST_STRETCHES:
        raise ValueError(
            f"{len(stretches)} stretches of {s[-1] - s[0]:.2g} s without contact; at least {LEAST_STRETCHES} must tell "
            "how movement goes on"
        )
    angle, share = np.stack([item.angle for item in stretches]), np.array([item.share for item in stretches])
    angle, paces = angle - angle[:, :1], pace(s, angle)
    lag = s[:, None] - s[None, :]
    found, doubt = np.empty((len(CENTRE), angle.shape[2])), np.empty((angle.shape[2], len(CENTRE), len(CENTRE)))
    for joint in range(angle.shape[2]):
        white, rest = noise[joint, joint] * correlation, JITTER**2 * np.eye(len(s)) + ANYWHERE**2
        y, speed = angle[:, :, joint, None], paces[:, joint, None, None]

        def cost(x, y=y, speed=speed, white=white, rest=rest):
            reach, length, tremor, scale = np.exp(x)
            slow, fast, noise = reach**2 * matern(lag, length), tremor**2 * matern(lag, FAST), scale**2 * white
            inverse = np.linalg.inv(speed**2 * slow + fast + noise + rest)
            z = inverse @ y
            told = 0.5 * share @ (np.sum(y * z, axis=(1, 2)) - np.linalg.slogdet(inverse)[1])
            left = share[:, None, None] * (inverse - z * z.swapaxes(1, 2))
            moving, all_alike = np.sum(speed**2 * left, axis=0), np.sum(left, axis=0)
            by_length = 0.5 * reach**2 * matern_by_length(lag, length)
            slope = [
                np.sum(moving * slow),
                np.sum(moving * by_length),
                np.sum(all_alike * fast),
                np.sum(all_alike * noise),
            ]
            apart = (x - CENTRE) / WIDTH
            return told + 0.5 * np.sum(apart**2), np.array(slope) + apart / WIDTH

        bounds = list(zip(CENTRE - LEAST * WIDTH, CENTRE + 4.0 * WIDTH, strict=True))
        best = np.asarray(minimize(cost, CENTRE, jac=True, method="L-BFGS-B", bounds=bounds).x)
        found[:, joint] = np.exp(best)
        doubt[joint] = curvature_inverse(lambda x, cost=cost: cost(x)[1], best, WIDTH)
    plain = PlannedMovement(found[0], found[1], found[2], found[3], 1.0, doubt)
    squares = [_missed(plain, s, one, speed, noise, correlation) for one, speed in zip(angle, paces, strict=True)]
    return plain._replace(inflation=max(1.0, float(np.average(squares, weights=share))))


def _missed(plain, s, angle, speed, noise, correlation) -> float:
    """Mean square of a stretch's whitened angles at s > 0."""
    K = plain.covariance(s, speed, noise, correlation).reshape(angle.size, -1)
    white = solve_triangular(np.linalg.cholesky(K), angle.ravel(), lower=True).reshape(angle.shape)
    return float(np.mean(white[s > 0.0] ** 2))
