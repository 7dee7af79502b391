"""What a fit of a session says of every joint: a number with an interval, or a refusal with its reason."""

import os
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from icjax.fit._options import FitOptions
from icjax.fit._parameters import Values
from icjax.fit._problem import Problem
from icjax.fit._session import SessionProblem, session_problem
from icjax.fit._solve import Minimum, Progress, solve
from icjax.inference import QUANTILE, Laplace, jacobian, laplace
from icjax.recording import Session
from icjax.results import RESULTS, Solution


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

    **Arguments**: `progress`, `cancelled` and `checkpoint` are those of `solve`.

    **Errors**: those of `session_problem`.
    """
    options = options or FitOptions()
    made = session_problem(session, options)
    found = solve(made.problem, progress=progress, cancelled=cancelled, checkpoint=checkpoint)
    x = found.value.x
    data, prior = _jacobians(made.problem, x)
    known = laplace(np.asarray(data), np.asarray(prior))
    rows = np.asarray(made.problem.data(x))
    compared = max(1, int(np.sum(rows != 0.0)))
    place = made.problem.parameters.slices["compliance"]
    joints = tuple(
        _joint(name, float(x[i]), float(known.sd[i]), float(known.learned[i]), made, options)
        for name, i in zip(made.dof_names, range(place.start, place.stop), strict=True)
    )
    values = made.problem.parameters.values(x)
    return SessionFit(
        made, found, values, known, joints, float(np.sum(rows**2)) / compared, _warnings(made, found), options
    )


@eqx.filter_jit
def _jacobians(problem: Problem, x: Any) -> tuple[jax.Array, jax.Array]:
    return jacobian(problem.data, x), jacobian(problem.parameters.prior, x)


def _joint(name: str, x: float, sd: float, learned: float, made: SessionProblem, options: FitOptions) -> JointFit:
    width = float(np.exp(2.0 * QUANTILE * sd))
    refused = ""
    if not width <= options.widest:
        refused = (
            f"its interval spans a factor of {width:.3g} (at most {options.widest:g}); missing: more contacts, or "
            "contacts that load it more"
        )
    lower, upper = np.exp(x - QUANTILE * sd), np.exp(x + QUANTILE * sd)
    return JointFit(name, float(np.exp(x)), float(lower), float(upper), width, learned, refused)


def _warnings(made: SessionProblem, found: Solution[Minimum]) -> tuple[str, ...]:
    said = []
    if found.result != RESULTS.solved:
        said.append(f"the fit did not converge in {found.stats['steps']} steps")
    if float(np.abs(np.asarray(found.value.x) - np.asarray(made.problem.parameters.start)).max()) < 1e-6:
        said.append("the fit never moved from where it started")
    return tuple(said)
