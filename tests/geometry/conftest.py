"""A folder for grids, so that tests leave nothing in the cache of the user."""

import pytest


@pytest.fixture(scope="session")
def grids(tmp_path_factory):
    return tmp_path_factory.mktemp("grids")
