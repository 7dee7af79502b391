"""What low-pass filters do to the estimate at contact: the figures of docs/estimator.md."""

import numpy as np
import pytest

from icjax.capture._check_recording import SMEARING
from icjax.capture._filters import lowpass
from icjax.estimation._fit import fit_rise, fit_slope_change

RATE, WINDOW, FORCES, TRUE = 500.0, 0.1, 60.0, 0.5


def share(cutoff):
    """Estimated over true compliance of a joint that yields to a torque without noise: theta = planned + C tau."""
    time = np.arange(-1.0, 1.0, 1.0 / RATE)
    torque = np.where(time > 0, 2.0 * time - 3.0 * time**2, 0.0)
    angle = lowpass(TRUE * torque + 0.1 * time + 0.5 * time**2, RATE, cutoff)
    torque = lowpass(torque, RATE, FORCES)
    before, after = (time <= 0) & (time > -WINDOW), (time > 0) & (time <= WINDOW)
    change = fit_slope_change(time[before], angle[before], time[after], angle[after], 2)
    return change.change / fit_rise(time[after], torque[after], 2).slope / TRUE


@pytest.mark.parametrize(("cutoff", "expected"), [(60.0, 1.0), (20.0, 0.97), (10.0, 0.82), (6.0, 0.52)])
def test_a_low_cut_off_of_the_markers_makes_joints_look_stiffer(cutoff, expected):
    assert share(cutoff) == pytest.approx(expected, abs=0.015)


def test_the_warning_begins_where_a_tenth_is_lost():
    assert share(SMEARING) > 0.9 > share(SMEARING - 4.0)
