"""Readers of the friction and linear complementarity problems of Siconos: its text files and the FCLIB layout."""

import re
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from icjax.contact import ContactProblem

ROUNDING = 1e-12
"""Largest asymmetry of W that is rounding, over its largest entry."""
_DENSE, _BLOCKS, _COMPRESSED = "0", "1", "2"


class Friction(NamedTuple):
    """u = W r + q with mu, as stored: local axes (normal, tangent 1, tangent 2 where `dimension` is 3)."""

    dimension: int
    W: np.ndarray
    q: np.ndarray
    mu: np.ndarray

    def asymmetry(self) -> float:
        """Largest |W - W^T| over the largest |W|."""
        return float(np.max(np.abs(self.W - self.W.T)) / max(np.max(np.abs(self.W)), 1e-300))


def read_contacts(path: Path, asymmetry: float = ROUNDING) -> ContactProblem:
    """The problem with local axes for world axes: normals x, tangents y and z, no gaps.

    A planar problem has zeros in the rows and columns of tangent 2. W is made symmetric; `ValueError` where its
    asymmetry is above the given part of its largest entry.
    """
    stored = read_friction(path)
    if stored.asymmetry() > asymmetry:
        raise ValueError(f"{path}: W is not symmetric: {stored.asymmetry():.1e} of its largest entry")
    count = len(stored.mu)
    rows = (3 * np.arange(count)[:, None] + np.arange(stored.dimension)).reshape(-1)
    coupling, free = np.zeros((3 * count, 3 * count)), np.zeros(3 * count)
    coupling[np.ix_(rows, rows)] = (stored.W + stored.W.T) / 2
    free[rows] = stored.q
    frames = np.repeat(np.eye(3)[None], count, axis=0)
    return ContactProblem(coupling, free, np.zeros(count), frames, stored.mu, np.ones(count, bool))


def read_friction(path: Path) -> Friction:
    """A friction problem of a text file (.dat) or of an FCLIB file (.hdf5), its local form; `ValueError` otherwise."""
    try:
        stored = _fclib(path) if path.suffix == ".hdf5" else _text(path)
    except (KeyError, IndexError, OSError, RuntimeError, ValueError) as error:
        raise ValueError(f"{path}: {error}") from error
    dimension, W, q, mu = stored
    size = dimension * len(mu)
    if dimension not in (2, 3) or W.shape != (size, size) or q.shape != (size,) or size == 0:
        found = f"W {W.shape}, q {q.shape}, mu {mu.shape}"
        raise ValueError(f"{path}: shapes do not agree in {dimension} dimensions: {found}")
    _finite(path, W, q, mu)
    if np.any(mu < 0):
        raise ValueError(f"{path}: negative friction: {np.min(mu)}")
    return stored


def read_lcp(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """M by rows and q of z >= 0, M z + q >= 0, z^T (M z + q) = 0; `ValueError` for what is no such file."""
    try:
        tokens = iter(path.read_text().split())
        size = int(next(tokens))
        M = _matrix(tokens)
        q = _numbers(tokens, size)
    except (IndexError, OSError, StopIteration, ValueError) as error:
        raise ValueError(f"{path}: {error or 'ends too early'}") from error
    if M.shape != (size, size):
        raise ValueError(f"{path}: M has shape {M.shape} and q {q.shape}")
    _finite(path, M, q)
    return M, q


def _finite(path: Path, *arrays: np.ndarray) -> None:
    if not all(np.all(np.isfinite(array)) for array in arrays):
        raise ValueError(f"{path}: NaN or infinite numbers")


def _text(path: Path) -> Friction:
    tokens = iter(path.read_text().split())
    try:
        dimension, count = int(next(tokens)), int(next(tokens))
        W = _matrix(tokens)
        return Friction(dimension, W, _numbers(tokens, dimension * count), _numbers(tokens, count))
    except StopIteration:
        raise ValueError("ends too early") from None


def _numbers(tokens: Iterator[str], count: int, kind: type = float) -> np.ndarray:
    found = np.array([kind(token) for token in islice(tokens, count)], kind)
    if len(found) != count:
        raise ValueError(f"{len(found)} numbers where {count} are due")
    return found


def _matrix(tokens: Iterator[str]) -> np.ndarray:
    kind = next(tokens)
    shape = int(next(tokens)), int(next(tokens))
    if kind == _DENSE:
        if (int(next(tokens)), int(next(tokens))) != shape:
            raise ValueError("two shapes of one matrix")
        return _numbers(tokens, shape[0] * shape[1]).reshape(shape)
    if kind == _BLOCKS:
        return _blocks(tokens, shape)
    if kind == _COMPRESSED:
        return _compressed(tokens, shape)
    raise ValueError(f"unknown storage {kind}")


def _blocks(tokens: Iterator[str], shape: tuple[int, int]) -> np.ndarray:
    """Compressed rows of blocks, the numbers of a block by columns."""
    blocks, rows, columns = _numbers(tokens, 3, int)
    row_ends, column_ends = _numbers(tokens, rows, int), _numbers(tokens, columns, int)
    filled_starts, filled = _numbers(tokens, 2, int)
    starts, places = _numbers(tokens, filled_starts, int), _numbers(tokens, filled, int)
    if filled != blocks or (row_ends[-1], column_ends[-1]) != shape:
        raise ValueError("numbers of blocks do not agree")
    row_starts, column_starts = np.append(0, row_ends), np.append(0, column_ends)
    matrix = np.zeros(shape)
    for row in range(filled_starts - 1):
        for number in range(starts[row], starts[row + 1]):
            if int(next(tokens)) != number:
                raise ValueError(f"block {number} is missing")
            i = slice(row_starts[row], row_starts[row + 1])
            j = slice(column_starts[places[number]], column_starts[places[number] + 1])
            block = matrix[i, j]
            block[:] = _numbers(tokens, block.size).reshape(block.shape, order="F")
    return matrix


def _compressed(tokens: Iterator[str], shape: tuple[int, int]) -> np.ndarray:
    """What `cs_print` prints: `col j : locations a to b`, then lines `i : value`."""
    for token in tokens:
        if token == "nnz:":
            break
    filled = int(next(tokens).rstrip(","))
    _skip(tokens, 2)
    matrix, column, found = np.zeros(shape), 0, 0
    while found < filled:
        token = next(tokens)
        if token == "col":
            column = int(next(tokens))
            _skip(tokens, 5)
        elif re.fullmatch(r"\d+", token) and next(tokens) == ":":
            matrix[int(token), column] += float(next(tokens))
            found += 1
        else:
            raise ValueError(f"unexpected {token!r} in a compressed matrix")
    return matrix


def _skip(tokens: Iterator[str], count: int) -> None:
    for _ in range(count):
        next(tokens)


def _fclib(path: Path) -> Friction:
    with h5py.File(path) as file:
        root = "fclib_local" if "fclib_local" in file else "fclib_global"
        dimension = _integer(file, f"{root}/spacedim")
        mu = np.asarray(file[f"{root}/vectors/mu"])
        if root == "fclib_local":
            return Friction(dimension, _sparse(file, f"{root}/W").toarray(), np.asarray(file[f"{root}/vectors/q"]), mu)
        M, H = _sparse(file, f"{root}/M"), _sparse(file, f"{root}/H")
        f, w = (np.asarray(file[f"{root}/vectors/{name}"]) for name in "fw")
    factor = splu(M)
    W = np.asarray(H.T @ factor.solve(H.toarray()))
    return Friction(dimension, W, np.asarray(H.T @ factor.solve(f)) + w, mu)


def _integer(file: h5py.File, name: str) -> int:
    return int(np.asarray(file[name])[0])


def _sparse(file: h5py.File, name: str) -> sparse.csc_matrix:
    """Compressed rows where nz is -2, compressed columns where it is -1, else rows i and columns p of nz entries."""
    rows, columns, kind = (_integer(file, f"{name}/{what}") for what in ("m", "n", "nz"))
    i, p, x = (np.asarray(file[f"{name}/{what}"]) for what in "ipx")
    if kind == -2:
        return sparse.csc_matrix(sparse.csr_matrix((x, i, p), (rows, columns)))
    if kind == -1:
        return sparse.csc_matrix((x, i, p), (rows, columns))
    return sparse.csc_matrix(sparse.coo_matrix((x[:kind], (i[:kind], p[:kind])), (rows, columns)))
