"""Small recorded sessions for all tests of the laboratory."""

from pathlib import Path

import pytest

from icjax.laboratory import FreeObject, Lift, Paths, grasp_session, record


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> tuple[Path, Paths]:
    """One trial of a tap and a stroke, and its catch trial."""
    folder = tmp_path_factory.mktemp("laboratory") / "session"
    return folder, record(folder, seed=7, trials=1, contacts=2, catch=1)


SHORT = Lift(rest=0.3, close=0.4, settle=0.15, rise=0.4, hold=0.25)
"""1.5 s, at rest at its end within the tremor."""

COARSE = 0.0005
"""Step of the simulation, s; forces differ from those at half of it by less than a hundredth (`test_hand`)."""


@pytest.fixture(scope="session")
def grasped(tmp_path_factory) -> tuple[Path, Paths]:
    """One recorded lift of a light box."""
    folder = tmp_path_factory.mktemp("laboratory") / "grasp"
    return folder, grasp_session(folder, seed=5, objects=[FreeObject("box")], lift=SHORT, timestep=COARSE)
