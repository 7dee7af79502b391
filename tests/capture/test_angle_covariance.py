"""The stated covariance of joint angles against their errors on simulated sessions; experiments/angle_covariance.py."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

CALIBRATED = (0.7, 1.3)
"""Error over stated deviation, RMS. Frame to frame and pooled over joints; the offset is a few draws, see below."""

OFFSET = (0.36, 1.67)
"""sqrt(chi-square / 4) of the four offsets of one subject: its 95 % range for a right covariance."""


@pytest.mark.slow
def test_angle_errors_are_as_large_as_stated(shared_data, monkeypatch):
    """One subject in four trials; the whole of the three sessions is in the results of the experiment."""
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    spec = importlib.util.spec_from_file_location("angle_covariance", ROOT / "experiments" / "angle_covariance.py")
    experiment = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(experiment)
    found = experiment.judge("explore_cruise", shared_data, ("trial00", "trial02"))
    frame = np.array([*found["frame_per_joint"], found["frame_joint"]])
    assert np.all((frame > CALIBRATED[0]) & (frame < CALIBRATED[1])), found
    assert OFFSET[0] < np.sqrt(found["offset_chi_square"] / 4) < OFFSET[1], found
