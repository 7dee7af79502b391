"""Other people's solvers of the linear complementarity problem, as fast as they can be called (extra `bench`)."""

import time

import numpy as np
from numba import njit
from pydrake.solvers import MathematicalProgram, MobyLcpSolver, UnrevisedLemkeSolver
from quantecon.optimize import lcp_lemke

PIVOTS = 100_000
"""Most pivots that QuantEcon may take; it is never what ends it."""


@njit
def _quantecon(M, q, count, d, tableau, basis, z):
    for _ in range(count):
        answer = lcp_lemke(M, q, d, PIVOTS, tableau=tableau, basis=basis, z=z)
    return answer.success


class QuantEcon:
    """`quantecon.optimize.lcp_lemke(M, q)`, called from Python as its users do."""

    name = "QuantEcon"

    def solve(self, M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, bool]:
        """z and whether the solver says that it has solved the problem."""
        answer = lcp_lemke(M, q, max_iter=PIVOTS)
        return answer.z.copy(), bool(answer.success)

    def seconds(self, M: np.ndarray, q: np.ndarray, count: int) -> float:
        """Of `count` solutions one after the other."""
        start = time.perf_counter()
        for _ in range(count):
            lcp_lemke(M, q, max_iter=PIVOTS)
        return time.perf_counter() - start


class CompiledQuantEcon:
    """The same in a compiled loop, with its work space given: as fast as it can be."""

    name = "QuantEcon, numba loop"

    def solve(self, M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, bool]:
        """z and whether the solver says that it has solved the problem."""
        n = len(q)
        self.space = (np.ones(n), np.empty((n, 2 * n + 2)), np.empty(n, np.int_), np.empty(n))
        claimed = _quantecon(M, q, 1, *self.space)
        return self.space[3].copy(), bool(claimed)

    def seconds(self, M: np.ndarray, q: np.ndarray, count: int) -> float:
        """Of `count` solutions of the problem that `solve` was called with last."""
        start = time.perf_counter()
        _quantecon(M, q, count, *self.space)
        return time.perf_counter() - start


class Drake:
    """A solver of Drake, program and decision variables made beforehand.

    `UnrevisedLemkeSolver` begins with the basis of its last solution; between two timed calls it solves another problem
    of the same size, as it would in a simulation that jumps.
    """

    def __init__(self, kind: type) -> None:
        self.name = f"Drake {kind.__name__.removesuffix('Solver').removesuffix('Lcp')}"
        self.solver = kind()
        self.programs: list = []

    def solve(self, M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, bool]:
        """z and whether the solver says that it has solved the problem."""
        program = MathematicalProgram()
        z = program.NewContinuousVariables(len(q))
        program.AddLinearComplementarityConstraint(M, q, z)
        self.programs = [*self.programs[-1:], program]
        if self.programs[0].num_vars() != len(q):
            self.programs = [program]
        answer = self.solver.Solve(program, None, None)
        return np.asarray(answer.GetSolution(z)).reshape(-1), bool(answer.is_success())

    def seconds(self, M: np.ndarray, q: np.ndarray, count: int) -> float:
        """Of `count` solutions of the problem that `solve` was called with last."""
        total = 0.0
        for _ in range(count):
            if len(self.programs) > 1:
                self.solver.Solve(self.programs[0], None, None)
            start = time.perf_counter()
            self.solver.Solve(self.programs[-1], None, None)
            total += time.perf_counter() - start
        return total


def alternatives() -> list:
    """One of each."""
    return [QuantEcon(), CompiledQuantEcon(), Drake(UnrevisedLemkeSolver), Drake(MobyLcpSolver)]
