"""A contact that might be recorded as a row of a dynamic equilibrium, and its exact Jacobian."""

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import numpy as np

from icjax.fit._contacts import systematic
from icjax.fit._dynamic import DynamicEquilibrium, whitener
from icjax.fit._expected_contact import angle_errors, contact_force, filter_power, intended, smooth_force
from icjax.fit._options import FitOptions
from icjax.fit._parameters import Parameters
from icjax.fit._planned_movement import PlannedMovement, alike, pace, velocity
from icjax.fit._probe import Instruments, Probe
from icjax.fit._variability import Variability, covariance
from icjax.inference import jacobian
from icjax.model import Model
from icjax.running import on_full_blocks

BLOCK = 16
"""Probes that one compiled call takes."""


class Plan(NamedTuple):
    """What all probes share; `foretold` where nothing is repeated, `modes` what it may do alike at all contacts."""

    model: Model
    dofs: tuple[int, ...]
    options: FitOptions
    noise: Instruments
    variability: Variability
    catch_trials: int
    foretold: PlannedMovement | None = None
    modes: tuple[np.ndarray, list[np.ndarray]] | None = None

    def event(self, probe: Probe, touch, move, inertia, C) -> dict[str, np.ndarray]:
        """One contact as a row of a `DynamicEquilibrium`."""
        rate, options = self.noise.rate, self.options
        before, after = round(options.before * rate), int(np.floor(options.after * rate))
        columns = list(self.dofs)
        armature = np.diag(np.asarray(self.model.armature)[columns])
        G, N, M = (part.sum(axis=0) for part in inertia)
        frames = after + round(3.0 * rate / self.noise.cutoff)
        raw, e = contact_force(probe, touch, (G, N, M + armature), C, options.damping_time, frames, 1.0 / rate)
        force, force_rate = smooth_force(raw, before, after, self.noise)
        samples = np.arange(0, before + after + 1, max(1, round(options.spacing * rate)))
        s = (samples - before) / rate
        used = np.repeat(s <= probe.duration, len(columns))
        K = self.covariance_of(probe, move, s)
        last = int(np.floor(min(probe.duration, options.after) * rate))
        torque = force @ touch.jacobian
        return {
            "torque": torque,
            "rate": force_rate @ touch.jacobian,
            "by": np.einsum("tx,xio->tio", force, touch.by_unit),
            "inertia": np.stack(inertia),
            "frames": samples,
            "W": whitener(K, used),
            "peak": np.abs(torque[before : before + last + 1]).max(axis=0),
            "deflection": np.abs(e[: last + 1]).max(axis=0),
            "own": K,
        }

    def common_of(self, events: Sequence[dict], probes: Sequence[Probe], moves: Sequence) -> list[np.ndarray]:
        """What numbers of unit variance that all contacts share do to the angles [sample * dof, number] of each."""
        times = [self.times(event) for event in events]
        rows = len(times[0]) * len(self.dofs)
        if self.modes is None:
            return [np.zeros((rows, 0)) for _ in events]
        ways = [intended(probe, s)[0][:, None] * move for probe, move, s in zip(probes, moves, times, strict=True)]
        torque = [event["torque"][round(self.options.before * self.noise.rate) :].mean(axis=0) for event in events]
        sizes = alike(
            np.stack([self.pace_of(*each) for each in zip(probes, moves, times, strict=True)]),
            np.stack([velocity(s, way) for s, way in zip(times, ways, strict=True)]),
            np.stack(torque),
        )
        return [systematic(self.modes, s, size).reshape(rows, -1) for s, size in zip(times, sizes, strict=True)]

    def times(self, event: dict[str, np.ndarray]) -> np.ndarray:
        """Of the compared samples, s from contact."""
        return (event["frames"] - round(self.options.before * self.noise.rate)) / self.noise.rate

    def doubt(self, event: dict[str, np.ndarray], probe: Probe, common: np.ndarray) -> np.ndarray:
        """`doubt_of` a contact's angles, what all contacts share included."""
        until = min(probe.duration, self.options.after)
        return doubt_of(event["own"] + common @ common.T, self.times(event), until, len(self.dofs))

    def covariance_of(self, probe: Probe, move, s: np.ndarray) -> np.ndarray:
        """Of a contact's angles against the mean of the repetitions, or without them of the angles as they are
        foretold [sample * dof, sample * dof]."""
        columns = list(self.dofs)
        passed, correlation = filter_power(self.noise, round((s[-1] - s[0]) * self.noise.rate) + 1)
        lag = np.round(np.abs(s[:, None] - s[None, :]) * self.noise.rate).astype(int)
        frame = passed * angle_errors(self.model, np.asarray(probe.q), self.noise)[0][np.ix_(columns, columns)]
        rows = len(s) * len(columns)
        if self.foretold is not None:
            return self.foretold.covariance(s, self.pace_of(probe, move, s), frame, correlation[lag]).reshape(
                rows, rows
            )
        full = covariance(s, self.variability, frame, correlation[lag]).reshape(rows, rows)
        rates = (intended(probe, s)[1][:, None] * move).ravel()
        n = self.catch_trials
        return (1.0 + 1.0 / n) * full + self.options.shift_sd**2 / n * np.outer(rates, rates)

    def pace_of(self, probe: Probe, move, s: np.ndarray) -> np.ndarray:
        """Of the intended movement before contact, rad/s [dof]."""
        return pace(s, intended(probe, s)[0][:, None] * move)


def doubt_of(K: np.ndarray, s: np.ndarray, until: float, dofs: int) -> np.ndarray:
    """Of each angle at the last compared sample, given those of the same joint before contact."""
    last, free = int(np.flatnonzero(s <= until + 1e-9)[-1]), np.flatnonzero(s <= 0.0)
    found = []
    for joint in range(dofs):
        a, b = free * dofs + joint, last * dofs + joint
        left = K[b, b] - K[b, a] @ np.linalg.solve(K[np.ix_(a, a)], K[a, b])
        found.append(np.sqrt(max(left, 0.0)))
    return np.array(found)


def jacobians(model, dofs, rate, offset, events, parameters) -> np.ndarray:
    """d residual / dx of every event [event, row, n]."""
    keys = ("torque", "rate", "by", "inertia", "frames", "W")
    stacked = [np.stack([event[key] for event in events]) for key in keys]
    factor = np.linalg.cholesky(offset + 1e-18 * np.eye(len(offset)))
    armature = np.asarray(model.armature)[list(dofs)]

    def block(torque, slope, by, inertia, frames, W):
        count = torque.shape[1]
        G, N, M = (np.repeat(inertia[:, None, part], count, axis=1) for part in range(3))
        nothing = np.zeros((*frames.shape, len(dofs)))
        made = DynamicEquilibrium(
            "design", 1.0 / rate, torque, slope, by, (G, N, M), armature, factor, frames, nothing, W
        )  # fmt: skip
        J = np.asarray(_by_parameters(made, parameters))
        return J.reshape(len(torque), -1, J.shape[1])

    blocks = range(0, len(events), BLOCK)
    found = [on_full_blocks(block, *(item[at : at + BLOCK] for item in stacked), block=BLOCK) for at in blocks]
    return np.concatenate(found)


@eqx.filter_jit
def _by_parameters(made: DynamicEquilibrium, parameters: Parameters):
    return jacobian(lambda x: made.residual(parameters.values(x)), parameters.start)
