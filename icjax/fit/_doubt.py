"""What is not known of how repetitions vary, carried into the covariance of a fit."""

from typing import Any

import equinox as eqx
import numpy as np
from scipy.linalg import solve_triangular

from icjax.fit._contacts import Window, repeated_covariance, shifts
from icjax.fit._options import FitOptions
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
    """`known` with the hyperparameters of the repetitions' variability integrated out, to second order.

    With h the logarithms of amplitudes and noise, of covariance H (`Variability.doubt`), and x(h), S(h) the minimum and
    the covariance of the linearised problem,

        cov x = E[S(h)] + cov x(h) = S + sum_k (S(+k) + S(-k) - 2 S) / 2 + (x(+k) - x(-k)) (x(+k) - x(-k))^T / 4,

    +-k one standard deviation along the principal axes of H. Contacts without repetitions, whose movement is foretold,
    keep what they have.

    **Arguments**: `data` Jacobian of the whitened data at the minimum, `residual` there.

    **Source**: law of total covariance; Kass and Steffey 1989, approximate inference in conditionally independent
    hierarchical models.
    """
    variability = made.expected.variability
    if variability is None or variability.doubt is None or not known.determined.all():
        return known
    S = np.asarray(known.covariance)
    # What does not depend on h stays: priors, and contacts without repetitions.
    rest, slope = np.linalg.inv(S), np.zeros(len(S))
    length = np.asarray(made.problem.measurements[0].whitening).shape[1]
    alike: dict[Any, tuple[Window, list[np.ndarray]]] = {}  # contacts of one K(h) but for their shifts
    for number, window in enumerate(made.windows):
        if not window.repetitions:
            continue
        U, motion = shifts(window, options), made.motions[window.trial]
        own = slice(number * length, number * length + len(U))
        J, r = data[own], residual[own]
        rest, slope = rest - J.T @ J, slope - J.T @ r
        L = np.linalg.cholesky(repeated_covariance(motion, window, made.expected) + U @ U.T)
        samples = (window.samples - window.onset).tobytes()
        key = samples, len(window.repetitions), motion.recording.rate, motion.correlation.tobytes()
        alike.setdefault(key, (window, []))[1].append(np.column_stack([U, L @ np.column_stack([J, r])]))

    def linear(h: Variability) -> tuple[np.ndarray, np.ndarray]:
        """Step to the minimum, and covariance."""
        both = np.zeros((len(S) + 1, len(S) + 1))
        for window, members in alike.values():
            K = repeated_covariance(made.motions[window.trial], window, made.expected._replace(variability=h))
            rows = np.concatenate(members, axis=1)
            white = solve_triangular(np.linalg.cholesky(K), rows, lower=True, check_finite=False)
            for V in np.split(white, len(members), axis=1):
                V, white_plain = V[:, : -len(both)], V[:, -len(both) :]
                along = V.T @ white_plain
                both += white_plain.T @ white_plain - along.T @ np.linalg.solve(np.eye(V.shape[1]) + V.T @ V, along)
        found = np.linalg.inv(rest + both[:-1, :-1])
        return -found @ (slope + both[:-1, -1]), found

    total = S.copy()
    for joint, H in enumerate(variability.doubt):
        values, axes = np.linalg.eigh(H)
        for value, axis in zip(values, axes.T, strict=True):
            moved = np.sqrt(max(float(value), 0.0)) * axis
            (above, S_above), (below, S_below) = (linear(variability.moved(joint, s * moved)) for s in (1.0, -1.0))
            total += 0.5 * (S_above + S_below - 2.0 * S) + 0.25 * np.outer(above - below, above - below)
    sd = np.sqrt(np.diagonal(total))
    learned = 1.0 - (1.0 - np.asarray(known.learned)) * sd**2 / np.asarray(known.sd) ** 2
    return eqx.tree_at(lambda k: (k.sd, k.covariance, k.learned), known, (sd, total, np.clip(learned, 0.0, 1.0)))
