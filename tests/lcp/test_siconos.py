"""Siconos' collection: its textbook problems in blocks, its frictional contact problems, and the readers of both."""

import importlib.util
import os
import shutil
from pathlib import Path

import h5py
import jax
import numpy as np
import pytest

from icjax import lcp
from icjax.contact import ContactProblem, assemble, dimensionless
from icjax.results import RESULTS

ROOT = Path(__file__).resolve().parents[2]
SHARED = Path(os.environ.get("ICJAX_SHARED_DATA", ROOT.parent / "shared" / "data"))
SLOTS = 20
"""Contacts of the largest problem that is solved; all are filled up with masked slots to one shape."""
FACETS = 2
LARGE = 900
"""Rows of W above which its eigenvalues are not looked at, for time."""

ROUNDING = 1e-12
REACHED = 1e-10
"""Dimensionless residual that counts as solved."""
PRINTED = 1e-7
"""Blocks are printed with seven digits: W has eigenvalues of about minus this part of the largest."""
GYROSCOPIC = 3e-3
"""Asymmetry of W in the collection, over its largest entry, from gyroscopic terms in Siconos' implicit step."""

BLOCKS = {
    "lcp_deudeu_block": [4 / 3, 7 / 3],
    "lcp_ortiz_block": [2 / 3, 0, 1 / 3, 0],
    "lcp_trivial_block": 1 / np.r_[1:10],
}


def loaded():
    """The readers, as a file of the experiments."""
    path = ROOT / "experiments" / "benchmarks" / "siconos_problems.py"
    spec = importlib.util.spec_from_file_location("siconos_problems", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


READERS = loaded()


def small(path: Path) -> bool:
    """Whether a text file has a problem of at most `SLOTS` contacts."""
    with path.open() as file:
        return int((file.readline() + file.readline()).split()[1]) <= SLOTS


NAMES = sorted(path.name for path in SHARED.glob("siconos_fc_lcp/fc_*/*"))
SMALL = sorted(path.name for path in SHARED.glob("siconos_fc_lcp/fc_dat/*.dat") if small(path))


@pytest.fixture
def folder(shared_data) -> Path:
    return shared_data / "siconos_fc_lcp"


@jax.jit
def answer(problem: ContactProblem):
    """The problem in its own units, M, q and what Lemke's method makes of it."""
    scaled = dimensionless(problem, FACETS)[0]
    M, q = assemble(scaled, FACETS)
    return scaled, M, q, lcp.solve(M, q)


def textbook_answer(M: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, bool]:
    """z and whether it is called solved; filled up with rows whose z is zero, to compile once."""
    n, more = len(q), 9 - len(q)
    wide = np.eye(9)
    wide[:n, :n] = M
    solution = lcp.solve(wide, np.pad(q, (0, more), constant_values=1.0))
    return np.asarray(solution.value)[:n], bool(solution.result == RESULTS.solved)


def filled(problem: ContactProblem) -> ContactProblem:
    """The problem with masked slots up to `SLOTS`, their numbers NaN."""
    more = SLOTS - len(problem.gap)
    return ContactProblem(
        np.pad(problem.coupling, (0, 3 * more), constant_values=np.nan),
        np.pad(problem.free_displacement, (0, 3 * more), constant_values=np.nan),
        np.pad(problem.gap, (0, more), constant_values=np.nan),
        np.pad(problem.frames, ((0, more), (0, 0), (0, 0)), constant_values=np.nan),
        np.pad(problem.friction, (0, more), constant_values=np.nan),
        np.pad(problem.active, (0, more)),
    )


@pytest.mark.parametrize("name", BLOCKS)
def test_textbook_problem_in_blocks(folder, name):
    M, q = READERS.read_lcp(folder / "lcp" / f"{name}.dat")
    z, claimed = textbook_answer(M, q)
    assert claimed
    np.testing.assert_allclose(z, BLOCKS[name], rtol=ROUNDING, atol=ROUNDING)


def test_blocks_are_the_dense_matrix(folder):
    """Ortiz's problem is in blocks what it is dense read by columns, and has the same solution either way."""
    for name in ("deudeu", "trivial", "ortiz"):
        dense, blocks = (READERS.read_lcp(folder / "lcp" / f"lcp_{name}{kind}.dat") for kind in ("", "_block"))
        np.testing.assert_array_equal(dense[0].T, blocks[0])
        np.testing.assert_array_equal(dense[1], blocks[1])


@pytest.mark.parametrize("name", ["lcp_Pang_isolated_sol_perturbed", "lcp_inf_sol_perturbed"])
def test_perturbed_problems_of_pang_are_judged_truly(folder, name):
    """Both ways of reading M: solved means solved, and a ray is no solution."""
    M, q = READERS.read_lcp(folder / "lcp" / f"{name}.dat")
    for matrix in (M, M.T):
        z, claimed = textbook_answer(matrix, q)
        assert claimed == (np.max(np.abs(np.minimum(z, matrix @ z + q))) <= REACHED)


@pytest.mark.parametrize("name", SMALL)
def test_friction_problem_is_solved(folder, name):
    problem = READERS.read_contacts(folder / "fc_dat" / name, asymmetry=GYROSCOPIC)
    count = len(problem.gap)
    scaled, M, q, solution = answer(filled(problem))
    M, q, z = (np.asarray(array) for array in (M, q, solution.value))
    residual = np.max(np.abs(np.minimum(z, M @ z + q)))
    assert bool(solution.result == RESULTS.solved), residual
    assert residual <= REACHED * np.max(np.abs(q))

    beta = z[: SLOTS * (2 * FACETS + 1)].reshape(SLOTS, -1)
    assert not np.any(beta[count:])
    force = np.stack([beta[:, 0], beta[:, 1] - beta[:, 2], beta[:, 3] - beta[:, 4]], axis=1)[:count]
    coupling, free = (np.asarray(array) for array in (scaled.coupling, scaled.free_displacement))
    moved = (coupling[: 3 * count, : 3 * count] @ force.reshape(-1) + free[: 3 * count]).reshape(count, 3)
    close = REACHED * max(1.0, np.max(np.abs(force)))
    assert np.max(np.abs(np.minimum(force[:, 0], moved[:, 0]))) <= close
    strength = problem.friction * force[:, 0]
    assert np.all(np.sum(np.abs(force[:, 1:]), axis=1) <= strength + close)
    # The polygon's friction does all the work that it can against the slip.
    work = np.sum(force[:, 1:] * moved[:, 1:], axis=1)
    np.testing.assert_allclose(work, -strength * np.max(np.abs(moved[:, 1:]), axis=1), atol=close)


@pytest.mark.parametrize("name", NAMES)
def test_friction_problem_is_read(folder, name):
    """Storage is understood: W is symmetric but for gyroscopic terms, positive semidefinite, with a positive diagonal.

    Blocks read by rows would leave W symmetric, but not semidefinite.
    """
    path = folder / ("fc_hdf5" if name.endswith("hdf5") else "fc_dat") / name
    stored = READERS.read_friction(path)
    assert stored.asymmetry() < GYROSCOPIC
    assert np.all(np.diag(stored.W) > 0)
    if len(stored.q) > LARGE:
        return
    values = np.linalg.eigvalsh((stored.W + stored.W.T) / 2)
    assert values[0] >= -PRINTED * values[-1]


def test_hdf5_problems_against_their_own_figures(folder):
    """The rank that another program found, and a global problem reduced with dense matrices."""
    path = folder / "fc_hdf5" / "LMGC_100_PR_PerioBox-i00361-60-03000.hdf5"
    with h5py.File(path) as file:
        rank = int(np.asarray(file["fclib_local/W"].attrs["rank_dense"]))
    assert np.linalg.matrix_rank(READERS.read_friction(path).W, tol=1e-12) == rank
    path = folder / "fc_hdf5" / "Box_Stacks-i0122-82-5.hdf5"
    with h5py.File(path) as file:
        M, H = np.zeros((450, 450)), np.zeros((450, 246))
        for name, matrix in {"M": M, "H": H}.items():
            i, p, x = (np.asarray(file[f"fclib_global/{name}/{what}"]) for what in "ipx")
            np.add.at(matrix, (i, p), x)
        f, w = (np.asarray(file[f"fclib_global/vectors/{name}"]) for name in "fw")
    stored = READERS.read_friction(path)
    np.testing.assert_allclose(stored.W, H.T @ np.linalg.solve(M, H), atol=ROUNDING * np.max(np.abs(stored.W)))
    np.testing.assert_allclose(stored.q, H.T @ np.linalg.solve(M, f) + w, atol=ROUNDING * np.max(np.abs(stored.q)))


def test_planar_problem_has_zeros_along_the_second_tangent(folder):
    path = folder / "fc_dat" / "FrictionContactProblem00394.dat"
    stored, problem = READERS.read_friction(path), READERS.read_contacts(path)
    assert stored.dimension == 2
    assert not np.any(problem.coupling[2::3])
    assert not np.any(problem.coupling[:, 2::3])
    assert not np.any(problem.free_displacement[2::3])
    np.testing.assert_array_equal(problem.free_displacement.reshape(-1, 3)[:, :2].reshape(-1), stored.q)
    np.testing.assert_allclose(problem.coupling[3:5, 3:5], stored.W[2:4, 2:4], atol=ROUNDING)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("3 1 0 3 3 3 3 1 0 0 0 1", "numbers where 9 are due"),
        ("3 1 0 3 3 3 3 1 0 0 0 1 0 0 0 1 -1 0 0", "numbers where 1 are due"),
        ("3 1 7 3 3", "unknown storage 7"),
        ("3 1", "ends too early"),
        ("3 2 0 3 3 3 3 1 0 0 0 1 0 0 0 1 -1 0 0 0 0 0 1 1", "shapes do not agree"),
        ("3 1 0 3 3 3 3 nan 0 0 0 1 0 0 0 1 -1 0 0 1", "NaN"),
        ("3 1 0 3 3 3 3 1 0 0 0 1 0 0 0 1 -1 0 0 -1", "negative friction"),
        ("3 1 0 3 3 3 3 1 0.1 0 0 1 0 0 0 1 -1 0 0 1", "not symmetric: 1.0e-01"),
    ],
)
def test_damaged_text_is_refused(tmp_path, text, said):
    path = tmp_path / "damaged.dat"
    path.write_text(text)
    with pytest.raises(ValueError, match=f"damaged.dat: .*{said}"):
        READERS.read_contacts(path)


def test_damaged_hdf5_is_refused(folder, tmp_path):
    path = tmp_path / "damaged.hdf5"
    path.write_text("no HDF5")
    with pytest.raises(ValueError, match=r"damaged.hdf5: "):
        READERS.read_friction(path)
    shutil.copyfile(folder / "fc_hdf5" / "Box_Stacks-i0122-82-5.hdf5", path)
    with h5py.File(path, "a") as file:
        del file["fclib_global/vectors/mu"]
    with pytest.raises(ValueError, match=r"damaged.hdf5: "):
        READERS.read_friction(path)
