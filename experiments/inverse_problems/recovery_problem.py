"""A finger that taps and strokes two plates with one intended movement: truth, noise-free data, random starts."""

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np

from icjax.fit import ContactForces, Parameter, Parameters, Problem, StaticEquilibrium, spline_basis
from icjax.geometry import Plane
from icjax.inference import Cholesky, Log
from icjax.model import index_finger, pad_positions
from icjax.synthesis import Scene, Surface

POSTURE = np.array([0.1, 0.5, 0.5, 0.3])
"""rad; wrist, MP, PIP, DIP."""

PLATES = {"high plate": (0.006, 0.5), "low plate": (0.010, 0.3)}
"""m below the fingertip in that posture; friction."""

FORCE_SD, ANGLE_SD = 0.02, 0.001
"""N and rad: what film sensors and markers reach. The data have no noise; these weigh them."""

CORRELATION = np.array([[1.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.3, 0.1], [0.0, 0.3, 1.0, 0.4], [0.0, 0.1, 0.4, 1.0]])
"""Of the full compliance; the diagonal is Table 1 of Kry and Pai 2006, exploring."""


@dataclasses.dataclass(frozen=True)
class Case:
    """One recovery: `full` compliance or its diagonal; `normal` forces only; `steps` of `duration` s, `functions` of
    the cubic spline of theta_r."""

    full: bool = False
    normal: bool = False
    steps: int = 30
    duration: float = 1.2
    functions: int = 5


class Truth:
    """Model, data of both plates and the problems of one case."""

    def __init__(self, case: Case):
        finger = index_finger(root="fixed")
        unlimited = np.full(4, np.inf)
        self.case, self.model = case, dataclasses.replace(finger, lower=-unlimited, upper=unlimited)
        self.time = np.linspace(0.0, case.duration, case.steps)
        self.basis = spline_basis(self.time, case.functions)
        self.nominal = np.tile(POSTURE, (case.steps, 1))
        diagonal = np.asarray(finger.compliance)
        size = np.sqrt(diagonal)
        self.compliance = CORRELATION * size[:, None] * size[None, :] if case.full else diagonal
        self.reference = np.linalg.lstsq(self.basis, movement(self.time / case.duration), rcond=None)[0]
        self.values = {"compliance": jnp.asarray(self.compliance), "reference": jnp.asarray(self.reference)}
        self.values |= {f"friction of {name}": jnp.asarray(mu) for name, (_, mu) in PLATES.items()}
        self.info = {name: self.trial(name, np.zeros((case.steps, 1))).simulate(self.values) for name in PLATES}
        self.slipping = {name: int(np.sum(np.asarray(info.slip_state) == 2)) for name, info in self.info.items()}

    def trial(self, name: str, force: Any, basis: Any = None, angles: Any = None) -> ContactForces:
        """A measurement on one plate."""
        depth, mu = PLATES[name]
        tip = pad_positions(self.model, jnp.asarray(POSTURE))[0]
        height = float(tip[2]) - float(self.model.pad_radius[0]) - depth
        plane = Plane(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0]))
        return ContactForces(
            name,
            self.model,
            Scene(name, (Surface(name, plane, mu),)),
            self.time,
            force,
            FORCE_SD,
            self.nominal,
            basis=self.basis if basis is None else basis,
            uses=("compliance", "reference", f"friction of {name}"),
            angles=self.nominal if angles is None else angles,
            angle_sd=ANGLE_SD,
        )

    def forces(self) -> tuple[ContactForces, ...]:
        """(c): what the model itself makes, on both plates."""
        found = []
        for name, info in self.info.items():
            force = np.asarray(info.contact_force)
            normal = np.sum(force * np.asarray(info.contact_normal), axis=2)
            found.append(self.trial(name, normal if self.case.normal else force, angles=np.asarray(info.q)))
        return tuple(found)

    def statics(self, shared: bool = True, basis: Any = None) -> tuple[StaticEquilibrium, ...]:
        """(a): the torques of the simulation, and angles in equilibrium with them."""
        C, theta_r = np.diag(self.compliance) if self.compliance.ndim == 1 else self.compliance, self.theta_r
        return tuple(
            StaticEquilibrium(
                name,
                self.time,
                theta_r + np.asarray(info.torque) @ C,
                np.asarray(info.torque),
                ANGLE_SD,
                nominal=self.nominal,
                basis=self.basis if basis is None else basis,
                uses=("compliance", "reference" if shared else f"reference of {name}"),
            )
            for name, info in self.info.items()
        )

    @property
    def theta_r(self) -> np.ndarray:
        """rad, `[time, joint]`."""
        return self.nominal + self.basis @ self.reference

    @property
    def guess(self) -> np.ndarray:
        """Spline through the mean measured angles of the two trials: what one knows of theta_r beforehand."""
        mean = np.mean([np.asarray(info.q) for info in self.info.values()], axis=0)
        return np.linalg.lstsq(self.basis, mean - self.nominal, rcond=None)[0]

    def parameters(self, friction: bool) -> Parameters:
        """At the truth."""
        size = np.diag(self.compliance) if self.case.full else self.compliance
        transform = Cholesky(4, tuple(np.sqrt(size).tolist())) if self.case.full else Log()
        stated = [
            Parameter("compliance", self.compliance, "rad/Nm", transform),
            Parameter("reference", self.reference, "rad"),
        ]
        if friction:
            stated += [
                Parameter(f"friction of {name}", np.array(mu), transform=Log()) for name, (_, mu) in PLATES.items()
            ]
        return Parameters(tuple(stated))

    def problem(self, kind: str) -> Problem:
        """(a) "static" or (c) "rollout"."""
        measured = self.statics() if kind == "static" else self.forces()
        return Problem(self.parameters(kind == "rollout"), measured)

    def starts(self, parameters: Parameters, count: int, rng: np.random.Generator, factor: float, spread: float):
        """x: C's diagonal and friction log-uniform within a factor of the truth, no coupling; the guess of theta_r with
        normal errors of its coefficients."""
        found = np.zeros((count, parameters.size))
        at, wide = parameters.slices, np.log(factor)
        diagonal = slice(at["compliance"].start, at["compliance"].start + 4)
        logarithm = np.zeros(4) if self.case.full else np.log(self.compliance)
        share = 0.5 if self.case.full else 1.0  # L is a square root of C
        found[:, diagonal] = logarithm + share * rng.uniform(-wide, wide, (count, 4))
        found[:, at["reference"]] = self.guess.reshape(-1) + spread * rng.standard_normal((count, self.guess.size))
        for name, place in at.items():
            if name.startswith("friction"):
                found[:, place] = np.log(parameters[name].nominal) + rng.uniform(-wide, wide, (count, 1))
        return found

    def errors(self, parameters: Parameters, x: Any) -> np.ndarray:
        """Largest errors `[3]`: of C relative to sqrt(C_ii C_jj), of friction relative, of theta_r in rad."""
        values = parameters.values(jnp.asarray(x))
        size = np.sqrt(np.diag(self.compliance) if self.case.full else self.compliance)
        scale = size[:, None] * size[None, :] if self.case.full else size**2
        rubbing = [
            abs(float(values[f"friction of {name}"]) / mu - 1.0)
            for name, (_, mu) in PLATES.items()
            if f"friction of {name}" in values
        ]
        moved = self.basis @ (np.asarray(values["reference"]) - self.reference)
        of_compliance = np.abs((np.asarray(values["compliance"]) - self.compliance) / scale).max()
        return np.array([of_compliance, max(rubbing, default=0.0), np.abs(moved).max()])


def movement(s: np.ndarray) -> np.ndarray:
    """theta_r minus the posture at the share s of the time, rad: a tap, then a stroke."""
    tap = 0.25 * np.sin(2 * np.pi * s) ** 2 * (s < 0.5)
    MP = tap + 0.25 * np.clip((s - 0.55) / 0.15, 0.0, 1.0)
    PIP = -0.4 * np.clip((s - 0.65) / 0.35, 0.0, 1.0)
    return np.stack([0.05 * np.sin(3.0 * s), MP, PIP, 0.1 * np.sin(5.0 * s)], axis=1)
