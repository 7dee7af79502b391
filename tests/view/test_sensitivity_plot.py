"""The sensitivity figure draws what the record holds."""

import equinox as eqx
import numpy as np
import pytest

from icjax import view
from icjax.estimation import Sensitivity

TRUTH = {"wrist": 0.3}


@pytest.fixture
def found() -> Sensitivity:
    """Three events, two joints, windows of 100 and 40 ms (and a pair of both), two degrees; MP only bounded."""
    shape = (3, 2, 3, 2)
    values = 0.3 + 0.01 * np.arange(np.prod(shape), dtype=float).reshape(shape)
    pooled = np.array([0.4, np.nan])[:, None, None] * np.ones((2, 3, 2))
    return Sensitivity(
        recording=("trial00",) * 3,
        joint_names=("wrist", "MP"),
        onset=np.arange(3.0),
        window=np.array([[0.1, 0.1], [0.04, 0.1], [0.04, 0.04]]),
        degree=np.array([1, 2], dtype=np.int32),
        compliance=values,
        standard_error=np.full(shape, 0.1),
        status=np.zeros(shape, dtype=np.int32),
        pooled=pooled,
        lower=np.where(np.isnan(pooled), 0.0, 0.2),
        upper=np.full((2, 3, 2), 0.6),
        stable=np.array([[True, False]] * 3),
        reason=(("", ""),) * 3,
    )


def test_it_draws_events_pooled_values_bounds_and_truth(found):
    wrist, knuckle = view.plot_sensitivity(found, TRUTH).axes
    courses = [line for line in wrist.lines if line.get_linewidth() == 0.7 and len(line.get_xdata()) == 2]
    drawn = [line for line in courses if list(line.get_xdata()) == [40.0, 100.0]]
    assert len(drawn) == 3 * 2  # events times degrees, shortest window first, the unequal pair left out
    np.testing.assert_allclose(drawn[0].get_ydata(), found.compliance[0, 0, [2, 0], 0])
    assert drawn[0].get_alpha() > knuckle.lines[1].get_alpha()  # stable darker
    thick = [line for line in wrist.lines if line.get_linewidth() == 2.2]
    np.testing.assert_allclose(thick[0].get_ydata(), [0.4, 0.4])
    assert any(list(line.get_ydata()) == [0.3, 0.3] for line in wrist.lines if line.is_dashed())
    bounds = [line for line in knuckle.lines if line.get_linestyle() == ":"]
    np.testing.assert_allclose(bounds[0].get_ydata(), [0.6, 0.6])
    low, high = wrist.get_ylim()
    assert low < 0 < 0.4 < high
    assert wrist.get_title(loc="left") == "wrist"


def test_only_unequal_windows_are_refused(found):
    unequal = eqx.tree_at(lambda item: item.window, found, np.array([[0.1, 0.2], [0.04, 0.1], [0.04, 0.05]]))
    with pytest.raises(ValueError, match="no choice has windows of equal length"):
        view.plot_sensitivity(unequal)
