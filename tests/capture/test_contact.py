"""Contact from force: sensor calibration, the meeting of the clocks, onset and release, centre of pressure."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from icjax.capture._contact_point import centre_of_pressure, contact_points
from icjax.capture._events import contact_events, force_course
from icjax.capture._sensors import SensorWrench, sensor_wrench
from icjax.capture._spec import ContactSpec, SourceSpec, SurfaceSpec, TrialSpec
from icjax.capture._synchronise import on_marker_clock
from icjax.files import FileError, MotionFile

RATE = 1000.0
EXACT = 1e-12
"""Sums of products of numbers near one."""

FLOOR = SurfaceSpec(point=(0.0, 0.0, 0.0), normal=(0.0, 0.0, 1.0))
TURN = ((0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, -1.0))
SESSION = Path("session.toml")
TRIAL = TrialSpec("t", "trial", (), Path("t.c3d"), None, (("plate", "pad"),), None, None)
SOURCE = SourceSpec(
    name="plate",
    kind="six_axis",
    channels=("Fx", "Fy", "Fz", "Tx", "Ty", "Tz"),
    plate=None,
    position=(0.1, -0.2, -0.03),
    rotation=TURN,
    sign="on_environment",
    surface=FLOOR,
    tare=((0.0, 0.2),),
)


def recorded(channels):
    time = np.arange(len(channels)) / RATE
    return MotionFile(
        path="t.c3d",
        marker_names=(),
        marker_rate=float("nan"),
        marker_time=np.zeros(0),
        markers=np.zeros((0, 0, 3)),
        marker_unit="",
        analog_names=SOURCE.channels,
        analog_units=("N",) * 3 + ("Nm",) * 3,
        analog_rate=RATE,
        analog_time=time,
        analog=channels,
    )


def some_wrench():
    """A wrench on the subject in world axes about the world origin, unloaded for 0.3 s at both ends."""
    wrench = np.random.default_rng(0).normal(size=(1000, 6))
    wrench[:300] = 0
    wrench[-300:] = 0
    return wrench


def as_sensed(wrench):
    """What a sensor at SOURCE's pose, measuring the reaction, reads: the inverse of the calibration, by hand."""
    R, p = np.array(TURN), np.array(SOURCE.position)
    force = -wrench[:, 3:]
    moment = -wrench[:, :3] - np.cross(p[None, :], force)
    return np.concatenate([force @ R, moment @ R], axis=1)


def test_channels_become_the_wrench_on_the_subject():
    wrench = some_wrench()
    sensor = sensor_wrench(recorded(as_sensed(wrench) + 0.7), TRIAL, SOURCE, SESSION)
    np.testing.assert_allclose(sensor.wrench, wrench, atol=EXACT)
    assert sensor.unloaded.sum() == 201
    flipped = sensor_wrench(
        recorded(-as_sensed(wrench)), TRIAL, dataclasses.replace(SOURCE, sign="on_subject"), SESSION
    )
    np.testing.assert_allclose(flipped.wrench, wrench, atol=EXACT)


def test_several_tare_windows_follow_a_drifting_baseline():
    wrench = some_wrench()
    drift = np.linspace(0.0, 1.0, 1000)[:, None] * np.array([1.0, -2.0, 0.5, 0.1, 0.2, -0.3])
    twice = dataclasses.replace(SOURCE, tare=((0.8, 0.95), (0.05, 0.2)))
    sensor = sensor_wrench(recorded(as_sensed(wrench) + drift), TRIAL, twice, SESSION)
    between = slice(125, 875)
    np.testing.assert_allclose(sensor.wrench[between], wrench[between], atol=EXACT)


def test_a_tare_window_outside_the_recording_is_an_error():
    late = dataclasses.replace(SOURCE, tare=((5.0, 6.0),))
    with pytest.raises(FileError, match=r"source 'plate': the tare window 5 to 6 s is outside the recording t\.c3d"):
        sensor_wrench(recorded(np.zeros((1000, 6))), TRIAL, late, SESSION)


def test_a_missing_channel_is_named():
    other = dataclasses.replace(SOURCE, channels=("Fx", "Fy", "Fz", "Mx", "Ty", "Tz"))
    with pytest.raises(FileError, match="has no analog channel 'Mx'"):
        sensor_wrench(recorded(np.zeros((1000, 6))), TRIAL, other, SESSION)


def sensor_of(force_z, time=None, tare=0.2):
    time = np.arange(len(force_z)) / RATE if time is None else time
    wrench = np.zeros((len(force_z), 6))
    wrench[:, 5] = force_z
    return SensorWrench("plate", time, RATE, wrench, time <= tare, FLOOR)


def test_force_meets_the_marker_clock_without_delay():
    time = np.arange(3000) / RATE
    marker_time = 0.1003 + np.arange(1300) / 480.0
    sensor = sensor_of(np.sin(2 * np.pi * 5 * time))
    found = on_marker_clock(sensor, marker_time, 60.0)[:, 5]
    inside = marker_time < time[-1] - 0.1
    # |H|^2 of the filter at 5 Hz is 1 - (5 / 74.8)^4; the spline's error is smaller still.
    np.testing.assert_allclose(found[inside], np.sin(2 * np.pi * 5 * marker_time[inside]), atol=1e-4)


def test_frames_without_force_are_nan():
    marker_time = np.arange(-100, 2000) / 500.0
    found = on_marker_clock(sensor_of(np.zeros(1000)), marker_time, 60.0)
    np.testing.assert_array_equal(np.isfinite(found[:, 5]), (marker_time > -0.0006) & (marker_time < 0.9996))


def ramps(onsets, releases, slope, size, length=6.0, noise=0.01, seed=0):
    """Forces that rise from exact onset times with a slope (N/s) to a size and fall again; white noise."""
    time = np.arange(int(length * RATE)) / RATE
    force = np.zeros(len(time))
    for onset, release in zip(onsets, releases, strict=True):
        force += np.clip(np.minimum((time - onset) * slope, (release - time) * slope), 0.0, size)
    return time, force + noise * np.random.default_rng(seed).normal(size=len(time))


@pytest.mark.parametrize("slope", [20.0, 80.0, 400.0])
def test_onset_and_release_lie_between_samples(slope):
    rng = np.random.default_rng(4)
    onsets = np.array([0.7, 1.9, 3.1, 4.3]) + rng.uniform(0, 0.01, 4)
    releases = onsets + 0.4 + rng.uniform(0, 0.01, 4)
    time, force = ramps(onsets, releases, slope, 1.0)
    spec = ContactSpec()
    found = np.array(contact_events(force_course(sensor_of(force, time), 150.0, spec), spec))
    # The thresholds (0.05 and 0.025 N) are crossed at 20 N/s with an uncertainty of 5.5 mN / 20 N/s = 0.3 ms, doubled
    # by the extrapolation; a steep ramp is widened by the filter by half its rise time, about 1.5 ms.
    np.testing.assert_allclose(found, np.stack([onsets, releases], axis=1), atol=0.002)


def test_chatter_is_one_contact_and_a_spike_is_none():
    time, force = ramps([1.0, 1.512, 3.0], [1.5, 1.6, 3.006], 200.0, 1.0)
    spec = ContactSpec()
    found = contact_events(force_course(sensor_of(force, time), 150.0, spec), ContactSpec(shortest=0.02))
    assert len(found) == 1
    np.testing.assert_allclose(found[0], (1.0, 1.6), atol=0.002)
    every = ContactSpec(gap=0.001, shortest=0.001)
    assert len(contact_events(force_course(sensor_of(force, time), 150.0, spec), every)) == 3


@pytest.mark.parametrize("seed", range(5))
def test_noise_and_drift_are_no_contact(seed):
    time, force = ramps([], [], 1.0, 1.0, length=60.0, seed=seed)
    force += 0.010 * np.sin(2 * np.pi * time / 40)
    spec = ContactSpec()
    assert contact_events(force_course(sensor_of(force, time), 150.0, spec), spec) == []


def test_a_recording_may_end_or_begin_in_contact():
    time, force = ramps([1.0], [9.0], 100.0, 1.0)
    spec = ContactSpec()
    [(onset, release)] = contact_events(force_course(sensor_of(force, time), 150.0, spec), spec)
    assert abs(onset - 1.0) < 0.002
    assert np.isnan(release)
    stated = ContactSpec(onset=0.1, release=0.05)
    [(onset, _)] = contact_events(force_course(sensor_of(force[2000:], time[2000:]), 150.0, stated), stated)
    assert onset == time[2000]


def test_without_a_tare_window_the_noise_comes_from_the_differences():
    _, force = ramps([1.0], [3.0], 100.0, 1.0)
    with_tare = force_course(sensor_of(force), 150.0, ContactSpec())
    without = force_course(sensor_of(force, tare=-1.0), 150.0, ContactSpec())
    # 200 filtered samples at 150 Hz hold some 60 independent ones: their deviation is known to 9 %.
    assert abs(without.noise / with_tare.noise - 1) < 0.3


@pytest.mark.parametrize("size", [0.5, 5.0, 500.0])
@pytest.mark.parametrize("tare", [0.2, -1.0])
def test_a_plate_that_reads_exactly_zero_unloaded(size, tare):
    """No noise to judge by, and between two contacts nothing but the ringing of the filter: thresholds have a floor."""
    time, force = ramps([1.0, 3.0], [2.0, 4.0], 100.0 * size, size, noise=0.0)
    course = force_course(sensor_of(force, time, tare=tare), 150.0, ContactSpec())
    assert course.onset >= max(1e-3, 1e-3 * size)
    assert course.onset > course.release > 0
    # A ramp of 10 ms is widened by the filter by half its rise time, 1.5 ms, and by its ringing at 0.1 % of the size.
    np.testing.assert_allclose(contact_events(course, ContactSpec()), [(1.0, 2.0), (3.0, 4.0)], atol=0.004)


def test_a_plate_that_is_never_loaded_has_no_contact():
    course = force_course(sensor_of(np.zeros(3000)), 150.0, ContactSpec())
    assert contact_events(course, ContactSpec()) == []


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_force_that_is_not_known_is_an_error(bad):
    """As a zero it would end the contact and begin another one."""
    channels = np.zeros((1000, 6))
    channels[600:650, 2] = bad
    expected = r"t\.c3d: channel 'Fz' of source 'plate' is not a finite number at 0\.6 s; 50 of 1000 samples"
    with pytest.raises(FileError, match=expected):
        sensor_wrench(recorded(channels), TRIAL, SOURCE, SESSION)


def tilted():
    n = np.array([0.1, -0.3, 0.9])
    return SurfaceSpec(point=(0.2, 0.1, -0.4), normal=tuple((n / np.linalg.norm(n)).tolist()))


def test_centre_of_pressure_is_where_the_force_acts():
    rng = np.random.default_rng(5)
    surface = tilted()
    n, p0 = np.array(surface.normal), np.array(surface.point)
    point = rng.normal(size=(50, 3))
    point -= ((point - p0) @ n)[:, None] * n
    force = rng.normal(size=(50, 3)) + 3 * n
    twist = rng.normal(size=50)
    moment = np.cross(point, force) + twist[:, None] * n
    found, free = centre_of_pressure(moment, force, surface)
    np.testing.assert_allclose(found, point, atol=1e-11)
    np.testing.assert_allclose(free, twist[:, None] * n, atol=1e-11)


def test_a_weak_force_acts_at_the_foot_of_the_pad():
    wrench = np.zeros((3, 6))
    wrench[:, 5] = [0.01, 1.0, 1.0]
    wrench[:, 0] = [0.0, 0.02, 0.02]
    centre = np.tile([0.3, 0.1, 0.007], (3, 1))
    touching = np.array([True, True, False])
    point, free = contact_points(wrench, touching, FLOOR, centre, 0.0075, least=0.1)
    np.testing.assert_allclose(point[0], [0.3, 0.1, 0.0], atol=EXACT)
    np.testing.assert_allclose(point[1], [0.0, 0.02, 0.0], atol=EXACT)
    assert np.isnan(point[2]).all()
    np.testing.assert_array_equal(free, 0.0)


def test_without_a_surface_the_force_pushes_on_the_pad():
    wrench = np.array([[0, 0, 0, 0, 3.0, 4.0]])
    point, _ = contact_points(wrench, np.array([True]), None, np.zeros((1, 3)), 0.01, 0.1)
    np.testing.assert_allclose(point[0], [0, -0.006, -0.008], atol=EXACT)
    with pytest.raises(ValueError, match="needs a surface of the source or a pad"):
        contact_points(wrench, np.array([True]), None, None, 0.01, 0.1)
