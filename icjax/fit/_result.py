"""What a fit of a session says of every joint: a number with an interval, or a refusal with its reason."""

import os
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from icjax.fit._contacts import unexplained
from icjax.fit._doubt import with_doubt
from icjax.fit._options import FitOptions
from icjax.fit._parameters import Values
from icjax.fit._problem import Problem
from icjax.fit._session import SessionProblem, session_problem
from icjax.fit._solve import Minimum, Progress, linearised, solve
from icjax.inference import QUANTILE, Laplace, laplace
from icjax.recording import Session
from icjax.results import RESULTS, Solution

MOST_TIMES = 10.0
"""Times the recorded contacts beyond which more of the same is no advice."""


class JointFit(NamedTuple):
    """Compliance of one joint, rad/Nm, with its 95 % interval; `refused` is the reason where there is no number.

    `learned` is the share of the prior variance that the data removed; `width` the ratio of the interval's ends.
    """

    name: str
    compliance: float
    lower: float
    upper: float
    width: float
    learned: float
    refused: str


class SessionFit(NamedTuple):
    """`joints` in the model's order; `values` of all parameters; `laplace` of x; `chi2` mean square of the residuals.

    `warnings` are what a reader must know: a fit that did not converge or never moved.
    """

    made: SessionProblem
    solution: Solution[Minimum]
    values: Values
    laplace: Laplace
    joints: tuple[JointFit, ...]
    chi2: float
    warnings: tuple[str, ...]
    options: FitOptions = FitOptions()

    def __repr__(self) -> str:
        """Of the joints alone: the problem holds arrays of thousands of rows."""
        told = (
            f"{name} {'refused' if refused else f'{value:.3g}'} [{lower:.3g}, {upper:.3g}]"
            for name, value, lower, upper, _, _, refused in self.joints
        )
        return f"SessionFit({', '.join(told)}; chi2 {self.chi2:.2f})"


def fit_session(
    session: Session,
    options: FitOptions | None = None,
    progress: Callable[[Progress], Any] | None = None,
    cancelled: Callable[[], bool] | None = None,
    checkpoint: str | os.PathLike | None = None,
) -> SessionFit:
    """Compliance of every joint from the response to all contacts of a session, with intervals.

    The problem of `session_problem` is solved by Levenberg-Marquardt; intervals are those of Laplace in log C, from the
    exact Jacobian, priors included. A joint is refused where the ends of its interval differ by more than
    `options.widest`, whatever its value: the contacts did not load it enough. No truth and no result enters that rule.
    Without catch trials intervals include what was planned after contact (`session_problem`).

    **Arguments**: `progress`, `cancelled` and `checkpoint` are those of `solve`.

    **Errors**: those of `session_problem`.
    """
    options = options or FitOptions()
    made = session_problem(session, options)
    found = solve(made.problem, progress=progress, cancelled=cancelled, checkpoint=checkpoint)
    x = found.value.x
    residual, data, prior = linearised(made.problem, x)
    data, prior, rows = np.asarray(data), np.asarray(prior), np.asarray(residual)[: len(data)]
    known = _intervals(data, prior)
    known = with_doubt(known, made, data, rows, options)
    compared = len(made.dof_names) * sum(len(window.samples) for window in made.windows)
    place = made.problem.parameters.slices["compliance"]
    loads = _loads(made, np.asarray(_deviation(made.problem, x)))
    joints = tuple(
        _joint(name, float(x[i]), float(known.sd[i]), float(known.learned[i]), load, options)
        for name, i, load in zip(made.dof_names, range(place.start, place.stop), loads, strict=True)
    )
    values = made.problem.parameters.values(x)
    return SessionFit(
        made, found, values, known, joints, float(np.sum(rows**2)) / compared, _warnings(made, found), options
    )


def _intervals(data: np.ndarray, prior: np.ndarray) -> Laplace:
    """`laplace` in units of the priors: a delay in seconds beside logarithms is no blind direction."""
    return laplace(data, prior, scale=1.0 / np.linalg.norm(prior, axis=0))


@eqx.filter_jit
def _deviation(problem: Problem, x: Any) -> jax.Array:
    """e of every frame."""
    return problem.measurements[0].deviation(problem.parameters.values(x))


class _Load(NamedTuple):
    """Of one joint in the session's contacts: what they did to it and what would have to be known to see that."""

    torque: float
    moved: float
    doubt: float
    contacts: int
    repeated: bool


def _loads(made: SessionProblem, deviation: np.ndarray) -> list[_Load]:
    """Largest torque and deflection of each joint, the median over contacts, and the doubt about its reference."""
    rows = []
    for number, window in enumerate(made.windows):
        motion = made.motions[window.trial]
        frames = slice(window.onset, window.last + 1)
        whitening = np.asarray(made.problem.measurements[0].whitening)[number]
        _, left = unexplained(whitening, window, motion.recording.rate, len(made.dof_names))
        doubt = np.linalg.norm(left, axis=1).reshape(len(window.samples), -1)[-1]
        moved = np.abs(deviation[number, : window.last - window.first + 1]).max(axis=0)
        rows.append([np.abs(motion.torque[frames]).max(axis=0), moved, doubt])
    torque, moved, doubt = np.median(rows, axis=0)
    repeated = all(window.repetitions for window in made.windows)
    return [
        _Load(float(torque[joint]), float(moved[joint]), float(doubt[joint]), len(rows), repeated)
        for joint in range(len(torque))
    ]


def _joint(name: str, x: float, sd: float, learned: float, load: _Load, options: FitOptions) -> JointFit:
    width = float(np.exp(2.0 * QUANTILE * sd))
    refused = "" if width <= options.widest else _refusal(width, sd, load, options)
    lower, upper = np.exp(x - QUANTILE * sd), np.exp(x + QUANTILE * sd)
    return JointFit(name, float(np.exp(x)), float(lower), float(upper), width, learned, refused)


def _refusal(width: float, sd: float, load: _Load, options: FitOptions) -> str:
    """How wide the interval is, what excitation there was, and what would give a number.

    Information about log C grows with the number of contacts: it is what the data added to the prior's, divided by
    their number.
    """
    told = (
        f"its interval spans a factor of {width:.3g} (at most {options.widest:g}); contacts loaded it with "
        f"{1e3 * load.torque:.3g} mNm and moved it by {np.degrees(load.moved):.2g} degrees, where it would be without "
        f"them is known to {np.degrees(load.doubt):.2g} degrees (medians); missing: "
    )
    if not load.repeated:
        return told + "catch trials, the same movement with the surface taken away"
    wanted = (2.0 * QUANTILE / np.log(options.widest)) ** 2 - options.compliance_sd**-2
    added = sd**-2 - options.compliance_sd**-2 if np.isfinite(sd) else 0.0
    if wanted < MOST_TIMES * added:
        count = int(np.ceil(load.contacts * wanted / added))
        return told + f"about {count} such contacts in all, or such as load it more"
    return told + "contacts whose force passes farther from its axis, or another posture"


def _warnings(made: SessionProblem, found: Solution[Minimum]) -> tuple[str, ...]:
    said = []
    alone = sum(not window.repetitions for window in made.windows)
    if alone:
        said.append(
            f"{alone} of {len(made.windows)} contacts have no catch trial: where the joints would have gone is "
            "foretold from the movement before contact, so intervals are wide; catch trials are what is missing"
        )
    blind = sorted({name for motion in made.motions.values() for name in motion.recording.normal_only})
    if blind:
        said.append(
            f"{', '.join(blind)}: only the normal force was measured; what friction does to the joints is missing, so "
            "compliances are wrong by more than their intervals say"
        )
    said += made.left_out
    if found.result != RESULTS.solved:
        said.append(f"the fit did not converge in {found.stats['steps']} steps")
    if float(np.abs(np.asarray(found.value.x) - np.asarray(made.problem.parameters.start)).max()) < 1e-6:
        said.append("the fit never moved from where it started")
    return tuple(said)
