"""Recordings of one box as one problem: what the fingers' forces and angles say of compliance, friction and pads."""

import sys
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

sys.path.append(str(Path(__file__).resolve().parents[1] / "kry_pai_2006"))
from grasp5 import scene_of

from icjax.fit import ContactForces, Parameter, Parameters
from icjax.inference import Log, Transform
from icjax.model import Model
from icjax.recording import Recording
from icjax.synthesis import Scene
from icjax.typing import Float, Int

STEP = 0.02
"""s; forces on the wide box differ by 0.1 % in NRMSE from those of steps of 2 ms."""

FINGERS = ("thumb", "index", "middle", "ring", "little")

TYPICAL = {"wrist": 0.349, "0": 0.988, "abd": 0.494, "1": 0.672, "2": 2.005}
"""rad/Nm; what `human_hand` states, from Table 1 of Kry and Pai 2006 (exploring)."""

TYPICAL_THUMB = {"0": 0.349, "abd": 0.349, "1": 0.494, "2": 1.003}

SPREAD = 0.7
"""Of log C beforehand, a factor of two: as far as one joint of Table 1 differs between two tasks."""

YIELDS = 0.026
"""rad (1.5 degrees); of the deviation of the reference at the mean force, beforehand."""

MODEL_SD = 0.0009
"""rad (0.05 degrees); of angles, what a quasi-static hand leaves out."""

CORRELATED = 1.2
"""Noise of angles is correlated over about one step."""

BEGIN = 0.9
"""s; before any touch, the hand about the box."""

FORCE_SD, GAIN_SD, HIDDEN_SD = 0.03, 0.05, 0.07
"""N; share; N where the film sensor is below its threshold and says only that the force is small."""


class Placed(Transform):
    """The free entries of an array of that shape, zero elsewhere."""

    rows: Int[np.ndarray, " size"]
    columns: Int[np.ndarray, " size"]
    shape: tuple[int, int] = eqx.field(static=True)

    def size(self, value):
        return self.rows.size

    def value(self, x):
        return jnp.zeros(self.shape).at[self.rows, self.columns].set(x)

    def free(self, value):
        return jnp.asarray(value)[self.rows, self.columns]


def typical(joint: str) -> float:
    """rad/Nm of a joint by its name in the session."""
    finger, _, part = joint.partition("_")
    return TYPICAL[joint] if not part else (TYPICAL_THUMB if finger == "thumb" else TYPICAL)[part]


def joints_of(model: Model) -> tuple[str, ...]:
    """All but the three of the forearm, which is driven."""
    return tuple(name for name in model.dof_names if not name.startswith("fa_"))


def normal_force(recording: Recording) -> Float[np.ndarray, "time finger"]:
    """N; the sensors give the normal force only."""
    return np.linalg.norm(np.asarray(recording.contact_force), axis=2)


class Course:
    """What the movements on the box have in common: the joints' course `q`, and in which shapes (`basis`) the reference
    deviates from it.

    Before the touch, and after the box slipped out in some trials (loose), the measured angles are those of the
    reference; the commanded movement is the same in all trials. Between them the reference deviates from the angles of
    the contact by what the joints yield, -C tau: in the shape of the finger's own normal force, of the same growing
    until the lift, and of the same from the lift on, when the load turns. `q` is the mean of all trials until the lift,
    then that of the first alone, then that of the loose trials, each blended over 0.1 s.
    """

    def __init__(self, recordings: tuple[Recording, ...]):
        first = recordings[0]
        self.time = np.asarray(first.time) - float(first.time[0])
        loose = [not np.asarray(item.touching)[-100:].any() for item in recordings]
        ends = [self.time[_last(item)] for item, free in zip(recordings, loose, strict=True) if free]
        lost = np.max(ends) + 0.05 if ends else self.time[-1] + 1.0
        self.lift = self.time[np.argmax(np.asarray(first.q)[:, 2] > 0.001)]
        lifted, free = _ramp(self.time, self.lift, 0.1), _ramp(self.time, lost, 0.1)
        weight = np.array([(1 - lifted) + (lifted * (1 - free) if n == 0 else 0.0) for n in range(len(recordings))])
        weight += np.array(loose)[:, None] * free
        q = np.stack([np.asarray(item.q)[:, 3:] for item in recordings])
        self.weight = weight / weight.sum(axis=0)
        self.q = np.einsum("rt,rtj->tj", self.weight, q)
        held = normal_force(first)
        own = held * (1 - free)[:, None] / np.mean(held[held.sum(axis=1) > 0.1], axis=0)
        onset = self.time[np.flatnonzero(held.sum(axis=1) > 0.1)[0]]
        growing = np.clip((self.time - onset) / (self.lift - onset), 0.0, 1.0)[:, None]
        self.basis = np.concatenate([own, own * growing, own * _ramp(self.time, self.lift, 0.3)[:, None]], axis=1)

    def places(self, joints: tuple[str, ...]) -> Placed:
        """Joints of a finger deviate with its own force, the wrist with the thumb's."""
        fingers = [FINGERS.index(name.partition("_")[0]) if "_" in name else 0 for name in joints]
        pairs = [(finger + 5 * part, joint) for part in range(3) for joint, finger in enumerate(fingers)]
        rows, columns = np.array(pairs).T
        return Placed(rows, columns, (15, len(joints)))


def _ramp(time, start, length):
    return np.clip((time - start) / length, 0.0, 1.0)


def _last(recording: Recording) -> int:
    return int(np.flatnonzero(np.asarray(recording.touching).any(axis=1))[-1])


class Together(eqx.Module):
    """Trials of one form as one measurement: compiled once, simulated one after the other."""

    name: str = eqx.field(static=True)
    uses: tuple[str, ...] = eqx.field(static=True)
    trials: ContactForces
    """Every number with a leading axis, the trial."""

    @staticmethod
    def of(trials: tuple[ContactForces, ...]) -> "Together":
        """From trials that differ in numbers only, not in names."""
        stacked = jax.tree.map(lambda *leaves: jnp.stack([jnp.asarray(leaf) for leaf in leaves]), *trials)
        return Together(trials[0].name, trials[0].uses, stacked)

    def residual(self, values: Any) -> Any:
        """Those of all trials, one after the other."""
        return jax.lax.map(lambda trial: trial.residual(values), self.trials).reshape(-1)

    def unsolved(self, values: Any) -> Any:
        """Steps of each trial that were not solved."""
        return jax.lax.map(lambda trial: trial.unsolved(values), self.trials)


def coarse(scene: Scene) -> Scene:
    """The same in steps of `STEP`, and without a name of its own."""
    return Scene(
        name="box",
        surfaces=scene.surfaces,
        objects=scene.objects,
        frictions=scene.frictions,
        contacts=scene.contacts,
        step=STEP,
        limits=0,  # the session's hand has none
    )


def compared_rows(course: Course) -> Int[np.ndarray, " row"]:
    """Samples of the recordings that the simulation steps through."""
    return np.arange(round(BEGIN / 0.002), course.time.size, round(STEP / 0.002))


def measured(recording: Recording, model: Model, course: Course, solid: Any) -> ContactForces:
    """One trial on the box; where the box is lost, only until the lift: how friction lets go is not modelled."""
    rows = compared_rows(course)
    nominal = np.concatenate([np.asarray(recording.q)[rows, :3], course.q[rows]], axis=1)
    force, touching = normal_force(recording), np.asarray(recording.touching)
    hidden = touching.any(axis=1)[:, None] & ~touching
    sd = np.where(hidden, HIDDEN_SD, np.sqrt(FORCE_SD**2 + (GAIN_SD * force) ** 2))
    angle_sd = np.sqrt(np.median(np.diagonal(np.asarray(recording.q_covariance), axis1=1, axis2=2)[rows, 3:], axis=0))
    return ContactForces(
        "box",
        model,
        coarse(scene_of(recording, solid)),
        course.time[rows],
        force[rows],
        sd[rows],
        nominal,
        uses=("compliance", "reference", "friction of object", "pad stiffness"),
        basis=course.basis[rows],
        angles=np.concatenate([nominal[:, :3], np.asarray(recording.q)[rows, 3:]], axis=1),
        angle_sd=np.hypot(CORRELATED * angle_sd, MODEL_SD),
        joints=joints_of(model),
        counts=(course.time[rows] < course.lift + 0.1) | touching[-100:].any(),
    )


def parameters(model: Model, course: Course) -> Parameters:
    """Beforehand: typical compliances within a factor of two, friction of 0.6 too, pads as pressed within 20 %."""
    joints = joints_of(model)
    centre = np.array([typical(name) for name in joints])
    return Parameters(
        (
            Parameter("compliance", centre, "rad/Nm", Log(), prior_sd=SPREAD, labels=joints),
            Parameter("reference", np.zeros((15, len(joints))), "rad", course.places(joints), prior_sd=YIELDS),
            Parameter("friction of object", np.array(0.6), transform=Log(), prior_sd=0.7),
            Parameter("pad stiffness", 1.0 / np.asarray(model.pad_compliance), "N/m", Log(), prior_sd=0.2),
        )
    )
