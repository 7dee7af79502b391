"""Outcome of an iterative computation: a value, a status and statistics; failure is data, never a silent fallback."""

from typing import Any, Generic, TypeVar

import equinox as eqx

Value = TypeVar("Value")


class RESULTS(eqx.Enumeration):
    """Status of a solve. ``RESULTS.solved`` is the only success."""

    solved = "Solved."
    secondary_ray = (
        "Lemke's method ended on a secondary ray. Unless the matrix is copositive-plus (that of a contact problem with "
        "friction is not) this does not prove that the problem has no solution."
    )
    breakdown = "The solver lost its basis to rounding: the recomputed residual is above the tolerance."
    max_pivots = "The solver reached its maximum number of pivots or iterations."
    not_converged = "The solver stopped before it reached its tolerance."
    invalid_input = "The problem contains NaN, infinite numbers, or negative friction."
    crowded = (
        "More contacts or joint limits took part than the scene has room for (its `contacts` and `limits`); the others "
        "were left out."
    )


class Solution(eqx.Module, Generic[Value]):
    """What a solver returns.

    **Fields**

    - `value`: the solution (meaningful only where `result` is solved).
    - `result`: a [`RESULTS`] member, traced, one for each problem of a batch.
    - `stats`: a dictionary of statistics, at least the recomputed residual.
    """

    value: Value
    result: RESULTS
    stats: dict[str, Any]
