"""One small recorded session for all tests of the laboratory."""

from pathlib import Path

import pytest

from icjax.laboratory import Paths, record


@pytest.fixture(scope="session")
def recorded(tmp_path_factory) -> tuple[Path, Paths]:
    """One trial of a tap and a stroke, and its catch trial."""
    folder = tmp_path_factory.mktemp("laboratory") / "session"
    return folder, record(folder, seed=7, trials=1, contacts=2, catch=1)
