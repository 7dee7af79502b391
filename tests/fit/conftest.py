"""One recorded session and its fit, shared by the tests that look at it."""

import dataclasses

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


@pytest.fixture(scope="session")
def mixed(session):
    """The first trial has lost its catch trials."""
    first = session.trials()[0]
    kept = tuple(item for item in session.recordings if item.catch_of != first.name)
    return fit_session(dataclasses.replace(session, recordings=kept))
