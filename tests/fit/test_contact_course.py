"""What recordings of one box have in common: experiments/inverse_problems/contact_fit_problem.py."""

import importlib.util
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

FOLDER = Path(__file__).resolve().parents[2] / "experiments" / "inverse_problems"
TIME = 0.002 * np.arange(1801)
JOINTS = ("wrist", *(f"{finger}_{part}" for finger in ("thumb", "index") for part in ("0", "abd", "1", "2")))


@pytest.fixture(scope="module")
def problem():
    path = list(sys.path)
    try:
        spec = importlib.util.spec_from_file_location("contact_fit_problem", FOLDER / "contact_fit_problem.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path[:] = path
    return module


def trial(released, yields=0.01):
    """Angles of a movement, less what yields in contact, from 1 s to the release; the forearm rises from 1.5 s."""
    touching = np.tile(((TIME >= 1.0) & (released > TIME))[:, None], (1, 5))
    q = np.zeros((TIME.size, 3 + len(JOINTS)))
    q[:, 2] = np.clip(TIME - 1.5, 0.0, None)
    q[:, 3:] = np.sin(TIME)[:, None] - yields * touching[:, :1]
    force = np.zeros((TIME.size, 5, 3))
    force[..., 0] = 0.5 * touching
    return SimpleNamespace(time=TIME + 7.0, q=q, touching=touching, contact_force=force)


def test_reference_of_the_trial_that_lost_the_box(problem):
    course = problem.Course((trial(9.0), trial(1.8)))
    assert course.lift == pytest.approx(1.502)
    free = np.sin(TIME)[:, None]
    before, held, after = TIME < 1.0, (TIME > 1.0) & (TIME < 1.8), TIME > 1.96
    np.testing.assert_allclose(course.q[before | after], np.tile(free, (1, len(JOINTS)))[before | after], atol=1e-12)
    np.testing.assert_allclose((course.q - free)[held], -0.01, atol=1e-12)
    assert np.all(course.basis[before | after] == 0.0)
    np.testing.assert_allclose(course.basis[held][:, :5], 1.0)
    assert course.basis.shape == (TIME.size, 15)


def test_without_loss_the_reference_deviates_to_the_end(problem):
    course = problem.Course((trial(9.0),))
    np.testing.assert_allclose(course.q[:, 0], trial(9.0).q[:, 3])
    np.testing.assert_allclose(course.basis[-1], 1.0)


def test_deviations_have_the_shape_of_the_own_finger(problem):
    placed = problem.Course((trial(9.0),)).places(JOINTS)
    x = np.arange(1.0, 1.0 + 3 * len(JOINTS))
    value = np.asarray(placed.value(x))
    assert value.shape == (15, len(JOINTS))
    np.testing.assert_array_equal(np.asarray(placed.free(value)), x)
    np.testing.assert_array_equal(np.flatnonzero(value[:, 5]), [1, 6, 11])  # index_0: the second finger
    np.testing.assert_array_equal(np.flatnonzero(value[:, 0]), [0, 5, 10])  # the wrist goes with the thumb
