"""A session fitted: compliance of every joint with intervals, and what a reader must know."""

import os
import re
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from icjax.capture import check_recording
from icjax.fit._changes import change_warnings, changed, spread_warnings
from icjax.fit._check_fit import far_from_prior, unusual_chi2
from icjax.fit._contacts import apparent
from icjax.fit._doubt import with_doubt
from icjax.fit._fitted import fitted_parameters
from icjax.fit._joints import JointFit, joints_of
from icjax.fit._options import FitOptions
from icjax.fit._parameters import Values
from icjax.fit._periods import Changes, changes_of
from icjax.fit._problem import intervals
from icjax.fit._record import FittedParameters
from icjax.fit._session import SessionProblem, session_problem
from icjax.fit._solve import Minimum, Progress, linearised, solve
from icjax.inference import Laplace
from icjax.recording import Session
from icjax.results import RESULTS, Solution

_SUSPICIOUS = "suspicious: "

TOLERANCE = 1e-6
"""Of `solve`: the minimum is known to a thousandth of a standard deviation."""


class SessionFit(NamedTuple):
    """`joints` in the model's order; `values` of all parameters and `parameters` the same with intervals; `laplace` of
    x; `chi2` mean square of the residuals.

    `periods` has the joints of every period in which compliance may be another (`SessionProblem.periods`); there is one
    where it is the same throughout. With several `joints` are their geometric means, and `changes` says by what
    factor they differ.

    `warnings` are what a reader must know: what is suspicious about the recordings (`check_recording`), a fit that did
    not converge (all its joints are refused) or never moved, residuals larger than assumed, numbers far from their
    priors, trials that speak for different compliances.
    """

    made: SessionProblem
    solution: Solution[Minimum]
    values: Values
    laplace: Laplace
    joints: tuple[JointFit, ...]
    periods: tuple[tuple[JointFit, ...], ...]
    changes: Changes | None
    parameters: FittedParameters
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
    keep_checkpoint: bool = False,
) -> SessionFit:
    """Compliance of every joint from the response to all contacts of a session, with intervals.

    The problem of `session_problem` is solved by Levenberg-Marquardt. `laplace` is from the exact Jacobian, priors
    included; what is not known of the repetitions' variability counts (`with_doubt`). The interval of a joint ends
    where the cost has risen by 1.96^2 / 2, what was assumed of that joint's compliance left out (`likelihood_ends`): it
    has no end where the data show none. A joint is refused where the ends differ by more than
    `options.widest`, whatever its value: the contacts did not load it enough. No truth and no result enters that rule.
    Without catch trials intervals include what was planned after contact (`session_problem`).

    **Arguments**: `progress`, `cancelled`, `checkpoint` and `keep_checkpoint` are those of `solve`.

    **Errors**: those of `session_problem`.
    """
    options = options or FitOptions()
    made = session_problem(session, options)
    found = solve(
        made.problem,
        tolerance=TOLERANCE,
        progress=progress,
        cancelled=cancelled,
        checkpoint=checkpoint,
        keep_checkpoint=keep_checkpoint,
    )
    x = found.value.x
    residual, data, prior = linearised(made.problem, x)
    data, prior, both = np.asarray(data), np.asarray(prior), np.asarray(residual)
    rows = both[: len(data)]
    plain = intervals(data, prior)
    known = with_doubt(plain, made, data, rows, options)
    compared = len(made.dof_names) * sum(len(window.samples) for window in made.windows)
    changes = changes_of(made, x, plain, known, options.compliance_change)
    joints, *periods = joints_of(made, x, plain, known, changes, options)
    if found.result != RESULTS.solved:
        joints, *periods = (_refused(row, found.stats["steps"]) for row in (joints, *periods))
    parameters = fitted_parameters(made.problem.parameters, np.asarray(x), known, periods)
    own = np.repeat([apparent(window) for window in made.windows], len(rows) // len(made.windows))
    chi2 = float(np.sum((rows / own) ** 2)) / compared
    warnings = (
        *_doubts(session),
        *_warnings(made, found),
        *unusual_chi2(chi2, compared),
        *far_from_prior(parameters),
        *change_warnings(changed(made, data, prior, both)),
        *spread_warnings(made.dof_names, periods, options),
    )
    values = made.problem.parameters.values(x)
    return SessionFit(made, found, values, known, joints, tuple(periods), changes, parameters, chi2, warnings, options)


def _refused(joints: tuple[JointFit, ...], steps: int) -> tuple[JointFit, ...]:
    why = f"the fit did not converge in {steps} steps, so that neither number nor interval is one"
    return tuple(joint._replace(refused=joint.refused or why) for joint in joints)


def _doubts(session: Session) -> list[str]:
    """What is suspicious about the recordings, a line for those of which the same is said but for its numbers."""
    said: dict[str, tuple[list[str], str]] = {}
    for line in check_recording(session):
        if line.startswith(_SUSPICIOUS):
            name, found, text = line.removeprefix(_SUSPICIOUS).partition("': ")
            alone = not (found and name.startswith("recording '"))
            key = line if alone else re.sub(r"[-+.\d]+(e[-+]\d+)?", "#", text)
            names, _ = said.setdefault(key, ([], line.removeprefix(_SUSPICIOUS) if alone else text))
            names += () if alone else (name.removeprefix("recording '"),)
    lines = [f"{', '.join(names)}: {text}" if names else text for names, text in said.values()]
    blind = [item.name for item in session.recordings if item.role == "catch" and not item.contact_names]
    if blind:
        lines.append(
            f"{', '.join(blind)}: a catch trial without a force; one that touched something would go unnoticed, and "
            "joints would look stiffer than they are"
        )
    return lines


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
