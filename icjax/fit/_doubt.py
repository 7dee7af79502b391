"""What is not known of how movement without contact varies, carried into the covariance of a fit."""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

from icjax.fit._contacts import (
    Window,
    at_times,
    done_alike,
    planned_covariance,
    repeated_covariance,
    shifts,
    systematic,
)
from icjax.fit._options import FitOptions
from icjax.fit._planned_movement import PlannedMovement
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
    for process, groups in (
        (expected.variability, _by_repetitions(made, rows, options)),
        (expected.movement, _by_planned_movement(made, rows, options)),
    ):
        if process is not None and process.doubt is not None:
            total += _beyond(S, process, groups)
    if np.array_equal(total, S):
        return known
    sd = np.sqrt(np.diagonal(total))
    learned = 1.0 - (1.0 - np.asarray(known.learned)) * sd**2 / np.asarray(known.sd) ** 2
    return eqx.tree_at(lambda k: (k.sd, k.covariance, k.learned), known, (sd, total, np.clip(learned, 0.0, 1.0)))


class _Contact(NamedTuple):
    """Rows R = [A J r] of a contact, not whitened: what numbers of unit variance do to them that contacts of a group
    have in common, Jacobian, residual; with the inverse of their covariance K and R^T K^-1 R.

    `columns` of a process and a joint are those of K that belong to the joint, `effect` what of A does in its rows.
    """

    rows: Float[np.ndarray, "row column"]
    inverse: Float[np.ndarray, "row row"]
    square: Float[np.ndarray, "column column"]
    columns: Callable[[Any, int], np.ndarray]
    effect: Callable[[Any, int], np.ndarray] | None = None

    @staticmethod
    def of(K: np.ndarray, rows: np.ndarray, columns, effect=None) -> "_Contact":
        inverse = np.linalg.inv(K)
        return _Contact(rows, inverse, rows.T @ inverse @ rows, columns, effect)


def _beyond(S: np.ndarray, process: Variability | PlannedMovement, groups: Sequence[Sequence[_Contact]]) -> np.ndarray:
    """What not knowing a process adds to the covariance."""
    numbers = len(S) + 1
    still = _told([[contact.square for contact in group] for group in groups], numbers)
    rest = np.linalg.inv(S) - still[:-1, :-1]  # what does not depend on h: priors, and contacts of the other kind

    assert process.doubt is not None
    added = np.zeros_like(S)
    for joint, H in enumerate(process.doubt):
        squares = [[_square(contact, process, joint) for contact in group] for group in groups]

        def linear(h: Any, squares=squares) -> tuple[np.ndarray, np.ndarray]:
            """Step to the minimum, and covariance."""
            both = _told([[square(h) for square in group] for group in squares], numbers)
            found = np.linalg.inv(rest + both[:-1, :-1])
            return -found @ (both[:-1, -1] - still[:-1, -1]), found

        values, axes = np.linalg.eigh(H)
        for value, axis in zip(values, axes.T, strict=True):
            moved = np.sqrt(max(float(value), 0.0)) * axis
            (above, S_above), (below, S_below) = (linear(process.moved(joint, s * moved)) for s in (1.0, -1.0))
            added += 0.5 * (S_above + S_below - 2.0 * S) + 0.25 * np.outer(above - below, above - below)
    return added


def _square(contact: _Contact, process: Any, joint: int) -> Callable[[Any], np.ndarray]:
    """R^T K^-1 R of a contact under a process in which one joint is another.

    With E the rows of the joint and N the columns of the noise that it shares with all others, K changes by
    V M V^T, V = [E N], so that K^-1 changes by -K^-1 V M (1 + V^T K^-1 V M)^-1 V^T K^-1: as many rows as the joint has
    are taken, not those of all joints.
    """
    known = contact.columns(process, joint)
    samples = known.shape[1]
    at = slice(joint, None, len(known) // samples)
    own, shared = known[at], known.copy()
    shared[at] = 0.0
    along = np.concatenate([contact.inverse[at], shared.T @ contact.inverse])
    Q = np.concatenate([along[:, at], along @ shared], axis=1)
    seen, one = along @ contact.rows, np.eye(samples)
    before = np.zeros((samples, 0)) if contact.effect is None else contact.effect(process, joint)

    def square(h: Any) -> np.ndarray:
        noise = (h.noise[joint] / process.noise[joint] - 1.0) * one
        M = np.block([[contact.columns(h, joint)[at] - own, noise], [noise, 0.0 * one]])
        whole, part = contact.square, seen
        if contact.effect is not None:
            change = np.zeros((samples, len(whole)))
            change[:, : before.shape[1]] = contact.effect(h, joint) - before
            cross = seen[:samples].T @ change
            whole = whole + cross + cross.T + change.T @ Q[:samples, :samples] @ change
            part = seen + Q[:, :samples] @ change
        return whole - part.T @ M @ np.linalg.solve(np.eye(len(Q)) + Q @ M, part)

    return square


def _told(squares: Sequence[Sequence[np.ndarray]], numbers: int) -> np.ndarray:
    """[J r]^T [J r] of groups of contacts, what each has in common integrated out."""
    found = np.zeros((numbers, numbers))
    for group in squares:
        total = np.sum(group, axis=0)
        common = len(total) - numbers
        cross = total[:common, common:]
        found += total[common:, common:] - cross.T @ np.linalg.solve(np.eye(common) + total[:common, :common], cross)
    return found


def _own(made: SessionProblem, rows: np.ndarray, number: int, used: int) -> np.ndarray:
    """Of the whitened rows of all contacts those of one."""
    length = np.asarray(made.problem.measurements[0].whitening).shape[1]
    return rows[number * length : number * length + used]


def _by_repetitions(made: SessionProblem, rows: np.ndarray, options: FitOptions) -> list[list[_Contact]]:
    """Contacts with repetitions, each a group: its own repetitions may be shifted."""
    groups = []
    for number, window in enumerate(made.windows):
        if window.repetitions:
            U, K = shifts(window, options), _repeated(made, window)
            plain = np.linalg.cholesky(K() + U @ U.T) @ _own(made, rows, number, len(U))
            groups.append([_Contact.of(K(), np.column_stack([U, plain]), K)])
    return groups


def _repeated(made: SessionProblem, window: Window) -> Callable[..., np.ndarray]:
    def K(process: Variability | None = None, joint: int | None = None) -> np.ndarray:
        expected = made.expected if process is None else made.expected._replace(variability=process)
        return repeated_covariance(made.motions[window.trial], window, expected, None if joint is None else [joint])

    return K


def _by_planned_movement(made: SessionProblem, rows: np.ndarray, options: FitOptions) -> list[list[_Contact]]:
    """Contacts without repetitions as one group: the subject may do the same at all of them."""
    movement, common = made.expected.movement, made.problem.measurements[0].common
    if movement is None:
        return []
    apart = rows if common is None else common.plain(rows)
    modes, group = movement.modes(options.before, options.after), []
    sizes = done_alike(made.windows, made.motions)
    for number, window in enumerate(made.windows):
        if not window.repetitions:
            K, effect, A = _planned(made, window, modes, sizes[number], options)
            plain = np.linalg.cholesky(K()) @ _own(made, apart, number, len(A))
            group.append(_Contact.of(K(), np.column_stack([A, plain]), K, effect))
    return [group]


def _planned(made: SessionProblem, window: Window, modes, sizes: np.ndarray, options: FitOptions):
    """Covariance of a contact, what common numbers do in the rows of one joint, and in all."""
    motion = made.motions[window.trial]
    s = (window.samples - window.onset) / motion.recording.rate
    A = systematic(modes, s, sizes).reshape(len(s) * sizes.shape[1], -1)

    def K(process: PlannedMovement | None = None, joint: int | None = None) -> np.ndarray:
        expected = made.expected if process is None else made.expected._replace(movement=process)
        return planned_covariance(motion, window, expected, None if joint is None else [joint])

    def effect(process: PlannedMovement, joint: int) -> np.ndarray:
        at, (own,) = process.modes(options.before, options.after, [joint])
        moved = at_times(s, at, own, sizes[:, joint])
        done, begin = np.zeros((len(s), A.shape[1])), joint * moved.shape[1]
        done[:, begin : begin + moved.shape[1]] = moved
        return done

    return K, effect, A
