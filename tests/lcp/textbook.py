"""Textbook problems as files and random problems as functions."""

from pathlib import Path

import numpy as np


def read_siconos(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """A dense problem of Siconos: n, storage header of five numbers, M by rows, q, then remarks."""
    numbers = path.read_text().split()
    n = int(numbers[0])
    values = np.array([float(x) for x in numbers[6 : 6 + n * n + n]])
    return values[: n * n].reshape(n, n), values[n * n :]


def positive_definite(rng: np.random.Generator, n: int) -> np.ndarray:
    """Not symmetric, with a positive definite symmetric part: a P-matrix, so the solution is unique."""
    root = rng.normal(size=(n, n))
    skew = rng.normal(size=(n, n))
    return root @ root.T / n + 0.1 * np.eye(n) + 0.5 * (skew - skew.T)
