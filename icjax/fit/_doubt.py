"""What is not known of how movement without contact varies, carried into the covariance of a fit."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
from scipy.linalg import solve_triangular

from icjax.fit._contacts import Window, of_mean, planned_covariance, repeated_covariance, shifts, systematic
from icjax.fit._options import FitOptions
from icjax.fit._planned_movement import PlannedMovement, pace
from icjax.fit._session import SessionProblem
from icjax.fit._variability import Variability
from icjax.inference import Laplace
from icjax.typing import Float


def with_doubt(
    known: Laplace,
    made: SessionProblem,
    data: Float[np.ndarray, "row n"],
    residual: Float[np.ndarray, " row"],
    options: FitOptions,
) -> Laplace:
    """`known` with the hyperparameters of the repetitions' variability, and of planned movement where nothing is
    repeated, integrated out to second order.

    With h the logarithms of a joint's hyperparameters, of covariance H (`Variability.doubt`, `PlannedMovement.doubt`),
    and x(h), S(h) the minimum and the covariance of the linearised problem,

        cov x = E[S(h)] + cov x(h) = S + sum_k (S(+k) + S(-k) - 2 S) / 2 + (x(+k) - x(-k)) (x(+k) - x(-k))^T / 4,

    +-k one standard deviation along the principal axes of H.

    **Arguments**: `data` Jacobian of the whitened data at the minimum, `residual` there.

    **Source**: law of total covariance; Kass and Steffey 1989, approximate inference in conditionally independent
    hierarchical models.
    """
    if not known.determined.all():
        return known
    S = np.asarray(known.covariance)
    total, rows = S.copy(), np.column_stack([data, residual])
    expected = made.expected
    for process, told in (
        (expected.variability, _by_repetitions(made, rows, options)),
        (expected.movement, _by_planned_movement(made, rows, options)),
    ):
        if process is not None and process.doubt is not None:
            total += _beyond(S, process, told)
    if np.array_equal(total, S):
        return known
    sd = np.sqrt(np.diagonal(total))
    learned = 1.0 - (1.0 - np.asarray(known.learned)) * sd**2 / np.asarray(known.sd) ** 2
    return eqx.tree_at(lambda k: (k.sd, k.covariance, k.learned), known, (sd, total, np.clip(learned, 0.0, 1.0)))


Told = Callable[[Any], np.ndarray]
"""[J r]^T [J r] of some contacts, whitened as a process says."""


def _beyond(S: np.ndarray, process: Variability | PlannedMovement, told: Told) -> np.ndarray:
    """What not knowing a process adds to the covariance."""
    still = told(process)
    rest = np.linalg.inv(S) - still[:-1, :-1]  # what does not depend on h: priors, and contacts of the other kind

    def linear(h: Any) -> tuple[np.ndarray, np.ndarray]:
        """Step to the minimum, and covariance."""
        both = told(h)
        found = np.linalg.inv(rest + both[:-1, :-1])
        return -found @ (both[:-1, -1] - still[:-1, -1]), found

    assert process.doubt is not None
    added = np.zeros_like(S)
    for joint, H in enumerate(process.doubt):
        values, axes = np.linalg.eigh(H)
        for value, axis in zip(values, axes.T, strict=True):
            moved = np.sqrt(max(float(value), 0.0)) * axis
            (above, S_above), (below, S_below) = (linear(process.moved(joint, s * moved)) for s in (1.0, -1.0))
            added += 0.5 * (S_above + S_below - 2.0 * S) + 0.25 * np.outer(above - below, above - below)
    return added


def _own(made: SessionProblem, rows: np.ndarray, number: int, used: int) -> np.ndarray:
    """Of the whitened rows of all contacts those of one."""
    length = np.asarray(made.problem.measurements[0].whitening).shape[1]
    return rows[number * length : number * length + used]


def _by_repetitions(made: SessionProblem, rows: np.ndarray, options: FitOptions) -> Told:
    """Contacts with repetitions, by the variability of these."""
    alike: dict[Any, tuple[Window, list[np.ndarray]]] = {}  # contacts of one K(h) but for their shifts
    for number, window in enumerate(made.windows):
        if not window.repetitions:
            continue
        U, motion = shifts(window, options), made.motions[window.trial]
        L = np.linalg.cholesky(repeated_covariance(motion, window, made.expected) + U @ U.T)
        samples = (window.samples - window.onset).tobytes()
        repeated = len(window.repetitions), of_mean(window)
        key = samples, repeated, motion.recording.rate, motion.correlation.tobytes()
        plain = L @ _own(made, rows, number, len(U))
        alike.setdefault(key, (window, []))[1].append(np.column_stack([U, plain]))
    size = rows.shape[1]

    def told(h: Variability) -> np.ndarray:
        both = np.zeros((size, size))
        for window, members in alike.values():
            K = repeated_covariance(made.motions[window.trial], window, made.expected._replace(variability=h))
            white = _whitened(K, np.concatenate(members, axis=1))
            for V in np.split(white, len(members), axis=1):
                both += _without_common(V[:, -size:], V[:, :-size])
        return both

    return told


def _by_planned_movement(made: SessionProblem, rows: np.ndarray, options: FitOptions) -> Told:
    """Contacts without repetitions, by what the subject's movement is like."""
    size = rows.shape[1]
    common = made.problem.measurements[0].common
    apart = rows if common is None else common.plain(rows)
    contacts = []
    for number, window in enumerate(made.windows):
        if window.repetitions:
            continue
        motion = made.motions[window.trial]
        L = np.linalg.cholesky(planned_covariance(motion, window, made.expected))
        contacts.append((motion, window, L @ _own(made, apart, number, len(L))))

    def told(h: PlannedMovement) -> np.ndarray:
        expected, modes = made.expected._replace(movement=h), h.modes(options.before, options.after)
        white = []
        for motion, window, plain in contacts:
            s = (window.samples - window.onset) / motion.recording.rate
            effect = systematic(modes, s, pace(s, motion.angle[window.samples])).reshape(len(plain), -1)
            white.append(_whitened(planned_covariance(motion, window, expected), np.column_stack([effect, plain])))
        V = np.concatenate(white)
        return _without_common(V[:, -size:], V[:, :-size])

    return told


def _whitened(K: np.ndarray, rows: np.ndarray) -> np.ndarray:
    return np.asarray(solve_triangular(np.linalg.cholesky(K), rows, lower=True, check_finite=False))


def _without_common(rows: np.ndarray, common: np.ndarray) -> np.ndarray:
    """R^T (I + A A^T)^-1 R of white rows R and what they have in common, A."""
    along = common.T @ rows
    return rows.T @ rows - along.T @ np.linalg.solve(np.eye(common.shape[1]) + common.T @ common, along)
