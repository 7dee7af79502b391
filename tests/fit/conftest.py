"""One recorded session and its fit, shared by the tests that look at it."""

import pytest

from icjax.capture import capture, read_session
from icjax.fit import fit_session
from icjax.laboratory import record


@pytest.fixture(scope="session")
def session(tmp_path_factory):
    """Four trials of three contacts, two catch trials each."""
    paths = record(tmp_path_factory.mktemp("lab"), seed=11, trials=4, contacts=3, catch=2)
    return capture(read_session(paths.session))


@pytest.fixture(scope="session")
def fit(session):
    return fit_session(session)
