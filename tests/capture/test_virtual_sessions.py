"""Capture against the truth of sessions that other physics simulated; figures of experiments/capture_accuracy.py."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]

ANGLE = (0.15, 0.40, 0.70, 0.90)
"""Degrees RMS, wrist to DIP, after one offset a joint: what an independent estimator reached, rounded up."""

TORQUE = 5.0
"""Percent of the torque's RMS, where it exceeds 10 mNm."""

ONSET_LARGEST, ONSET_MEDIAN = 4.0, 2.0
"""ms; the truth is sampled every 2 ms."""

OFFSET_Z = 3.0
"""Of four correlated offsets, one draw a subject."""

COVERAGE_Z = (0.8, 1.25)
"""RMS error over stated standard deviation; slow marker noise (0.05 mm) is not known to better than this."""

SESSIONS = {
    "explore": (*(f"trial{i:02}" for i in range(6)), "catch01", "catch04_2"),
    "scratch": (*(f"trial{i:02}" for i in range(6)), "catch00_2", "catch03"),
    "explore_cruise": tuple(f"trial{i:02}" for i in range(4)),
}


@pytest.fixture(scope="module")
def experiment():
    spec = importlib.util.spec_from_file_location("capture_accuracy", ROOT / "experiments" / "capture_accuracy.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("name", SESSIONS)
def test_capture_is_as_close_to_the_truth_as_promised(experiment, shared_data, name, monkeypatch):
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    found = experiment.judge(name, shared_data, SESSIONS[name])
    assert found["trials"] == len(SESSIONS[name])
    assert found["contacts"] == 4 * sum("trial" in item for item in SESSIONS[name])
    assert (found["missed"], found["invented"]) == (0, 0)
    assert np.all(np.array(found["angle_rms_deg"]) <= ANGLE), found
    assert np.all(np.abs(found["offset_z"]) <= OFFSET_Z), found
    assert np.all(np.array(found["coverage_z"]) >= COVERAGE_Z[0]), found
    assert np.all(np.array(found["coverage_z"]) <= COVERAGE_Z[1]), found
    assert np.all(np.array(found["torque_nrmse_percent"]) <= TORQUE), found
    assert found["onset_error_ms_largest"] <= ONSET_LARGEST, found
    assert found["onset_error_ms_median_abs"] <= ONSET_MEDIAN, found
    assert found["valid_percent"] == 100.0
