"""What a fit says of one joint: a number with an interval, or a refusal with its reason."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from icjax.fit._contacts import unexplained
from icjax.fit._options import FitOptions
from icjax.fit._periods import Changes, numbers_of
from icjax.fit._problem import Problem
from icjax.fit._session import SessionProblem
from icjax.inference import QUANTILE, Laplace

MOST_TIMES = 10.0
"""Times the recorded contacts beyond which more of the same is no advice."""


LEAST_OWN = 0.1
"""Share of what is open about a period's deviation from the others that its contacts must remove."""


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


def joints_of(
    made: SessionProblem, x: Any, plain: Laplace, known: Laplace, changes: Changes | None, options: FitOptions
) -> tuple[tuple[JointFit, ...], ...]:
    """Of every joint for the session as a whole, then of every joint in every period.

    With several periods the session's log C is the mean over them, and a period in which nearly all comes from the
    others (`LEAST_OWN` of `Changes.learned`) is refused. Ends are those of `numbers_of`, in which a joint's own prior
    has no part.
    """
    at = made.problem.parameters.slices["compliance"]
    count, numbers = len(made.dof_names), at.stop - at.start
    periods = numbers // count
    rows = np.eye(numbers)
    if periods > 1:
        rows = np.concatenate([np.tile(np.eye(count), periods) / periods, rows])
    along = np.zeros((len(rows), len(x)))
    along[:, at] = rows
    log_C, sd, lower, upper = numbers_of(made.problem, x, plain, known, along)
    prior = options.compliance_sd**2 * np.ones(len(rows))
    if periods > 1:
        prior += options.compliance_change**2 * np.where(np.arange(len(rows)) < count, 1.0 / periods, 1.0)
    learned = np.clip(1.0 - sd**2 / prior, 0.0, 1.0)
    added = np.divide(1.0, sd**2, out=np.zeros_like(sd), where=sd > 0) - 1.0 / prior
    loads = _loads(made, np.asarray(_deviation(made.problem, x)))
    own = np.ones(len(rows)) if changes is None else np.concatenate([np.ones(count), changes.learned.ravel()])
    joints = [
        _joint(made.dof_names[row % count], *told, float(own[row]), loads[row // count][row % count], options)
        for row, told in enumerate(zip(log_C, lower, upper, learned, added, strict=True))
    ]
    table = tuple(tuple(joints[row : row + count]) for row in range(0, len(joints), count))
    return table if periods > 1 else (*table, *table)


@eqx.filter_jit
def _deviation(problem: Problem, x: Any) -> jax.Array:
    """e of every frame."""
    return problem.measurements[0].deviation(problem.parameters.values(x))


class _Load(NamedTuple):
    """Of one joint in the contacts of the session, or of a period (`part`): what they did to it and what would have to
    be known to see that."""

    torque: float
    moved: float
    doubt: float
    contacts: int
    repeated: bool
    part: bool


def _loads(made: SessionProblem, deviation: np.ndarray) -> list[list[_Load]]:
    """Largest torque and deflection of each joint, the median over contacts, and the doubt about its reference: of the
    session, then of every period where there are several."""
    rows = []
    for number, window in enumerate(made.windows):
        motion = made.motions[window.trial]
        frames = slice(window.onset, window.last + 1)
        whitening = np.asarray(made.problem.measurements[0].whitening)[number]
        _, left = unexplained(whitening, window, motion.recording.rate, len(made.dof_names))
        doubt = np.linalg.norm(left, axis=1).reshape(len(window.samples), -1)[-1]
        moved = np.abs(deviation[number, : window.last - window.first + 1]).max(axis=0)
        rows.append([np.abs(motion.torque[frames]).max(axis=0), moved, doubt])
    of = made.problem.measurements[0].period
    whole = np.ones(len(rows), bool)
    parts = [] if of is None else [np.asarray(of) == number for number in range(len(made.periods))]
    repeated = np.array([bool(window.repetitions) for window in made.windows])
    return [
        [
            _Load(
                float(torque),
                float(moved),
                float(doubt),
                int(part.sum()),
                bool(repeated[part].all()),
                part is not whole,
            )  # fmt: skip
            for torque, moved, doubt in np.median(np.array(rows)[part], axis=0).T
        ]
        for part in (whole, *parts)
    ]


def _joint(
    name: str,
    log_C: float,
    lower: float,
    upper: float,
    learned: float,
    added: float,
    own: float,
    load: _Load,
    options: FitOptions,
) -> JointFit:
    width = float(np.exp(upper - lower))
    if width > options.widest:
        refused = _refusal(width, added, load, options)
    else:
        refused = "" if own > LEAST_OWN else f"its own contacts say nothing of it ({own:.0%} of what was open)"
    value, lower, upper = (float(np.exp(end)) for end in (log_C, lower, upper))
    return JointFit(name, value, lower, upper, width, float(learned), refused)


def _refusal(width: float, added: float, load: _Load, options: FitOptions) -> str:
    """How wide the interval is, what excitation there was, and what would give a number.

    Information about log C grows with the number of contacts: what they `added` to the prior's.
    """
    spans = f"spans a factor of {width:.3g}" if width < np.inf else "has an end missing"
    told = (
        f"its interval {spans} (a factor of {options.widest:g} at most); contacts loaded it with "
        f"{1e3 * load.torque:.3g} mNm and moved it by {np.degrees(load.moved):.2g} degrees, where it would be without "
        f"them is known to {np.degrees(load.doubt):.2g} degrees (medians); missing: "
    )
    if not load.repeated:
        return told + "catch trials, the same movement with the surface taken away"
    if load.part:
        return told + "more such contacts there, or such as load it more"
    wanted = (2.0 * QUANTILE / np.log(options.widest)) ** 2
    if wanted < MOST_TIMES * added:
        count = max(load.contacts + 1, int(np.ceil(load.contacts * wanted / added)))  # an end may be far by itself
        return told + f"about {count} such contacts in all, or such as load it more"
    return told + "contacts whose force passes farther from its axis, or another posture"
