"""Holes, ends and odd spacing of the times in a trial's files."""

import dataclasses

import numpy as np
import pytest

from icjax.capture._trial_time import check_even, common_time, even_markers
from icjax.files import FileError, MotionFile

RATE = 120.0


def trial(frames=600, decimals=3):
    time = np.round(np.arange(frames) / RATE, decimals)
    markers = np.random.default_rng(0).normal(size=(frames, 2, 3))
    return MotionFile(
        path="walk.trc",
        marker_names=("a", "b"),
        marker_rate=(frames - 1) / (time[-1] - time[0]),
        marker_time=time,
        markers=markers,
        marker_unit="mm",
        analog_time=np.arange(5 * frames) / (5 * RATE),
        analog=np.zeros((5 * frames, 6)),
    )


def without(motion, start, stop):
    kept = np.r_[0:start, stop : len(motion.marker_time)]
    time = motion.marker_time[kept]
    rate = (len(kept) - 1) / (time[-1] - time[0]) if len(kept) > 1 else float("nan")
    return dataclasses.replace(motion, marker_time=time, markers=motion.markers[kept], marker_rate=rate)


def samples(motion, kept):
    return dataclasses.replace(motion, analog_time=motion.analog_time[kept], analog=motion.analog[kept])


def test_even_times_stay_as_they_are(tmp_path):
    motion = trial()
    assert even_markers(motion, tmp_path / "walk.trc") is motion


def test_frames_that_a_file_leaves_out_come_back_as_gaps(tmp_path):
    whole = trial()
    found = even_markers(without(whole, 200, 350), tmp_path / "walk.trc")
    assert len(found.marker_time) == 600
    # Printed to a millisecond; the mean interval of 450 such times is good to a microsecond.
    np.testing.assert_allclose(found.marker_rate, RATE, rtol=2e-4)
    np.testing.assert_allclose(found.marker_time, whole.marker_time, atol=1.1e-3)
    assert np.isnan(found.markers[200:350]).all()
    np.testing.assert_array_equal(found.markers[350:], whole.markers[350:])
    assert "150 frames are missing in the times of walk.trc" in found.notes[-1]


def test_times_that_cannot_be_evened_out_are_refused(tmp_path):
    path = tmp_path / "walk.trc"
    motion = trial(decimals=6)
    shifted = motion.marker_time + np.where(np.arange(600) >= 300, 0.5 / RATE, 0.0)
    with pytest.raises(FileError, match=r"walk\.trc: times are not evenly spaced: .* after frame 300 \(2\.49"):
        even_markers(dataclasses.replace(motion, marker_time=shifted), path)
    with pytest.raises(FileError, match="leave 520 frames out, more than the 80"):
        even_markers(without(motion, 40, 560), path)
    with pytest.raises(FileError, match="holds 1 frame; two are needed"):
        even_markers(without(motion, 1, 600), path)


def test_a_hole_in_the_forces_is_refused(tmp_path):
    path = tmp_path / "walk.mot"
    motion = trial()
    check_even(motion.analog_time, path, "force")
    time = motion.analog_time
    with pytest.raises(FileError, match="force times are not evenly spaced: .* after sample 100 "):
        check_even(motion.analog_time[np.r_[0:100, 200 : len(time)]], path, "force")
    with pytest.raises(FileError, match="holds 1 force sample"):
        check_even(motion.analog_time[np.r_[0:1]], path, "force")


def test_frames_without_a_force_are_left_out(tmp_path):
    """An unknown force is no absence of contact: the trial ends where the forces end."""
    motion = trial()
    short = samples(motion, np.r_[0:1500])
    found = common_time(short, tmp_path / "walk.mot")
    assert abs(found.marker_time[-1] - short.analog_time[-1]) < 1.0 / RATE
    assert len(found.markers) == len(found.marker_time)
    assert "frames without a force are left out" in found.notes[-1]
    with pytest.raises(FileError, match="do not overlap"):
        common_time(dataclasses.replace(short, analog_time=short.analog_time + 60.0), tmp_path / "walk.mot")
