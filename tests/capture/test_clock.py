"""The clock of a separate force acquisition: pulses, contacts, and what cannot be told."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from icjax.capture import check, read_session
from icjax.capture._clock import Clock, clock_from_pulses
from icjax.capture._contact_lag import Signal, clock_from_contacts
from icjax.capture._events import contact_events, force_course
from icjax.capture._load import load_trial
from icjax.capture._pulses import rising_edges
from icjax.capture._sensors import sensor_wrench
from icjax.files import FileError

SESSION = Path(__file__).resolve().parents[2] / "experiments" / "sessions" / "virtual_explore_daq.toml"

ALIGNED = 0.0005
"""s; what a pulse train sampled at 1 kHz must give over a trial of some seconds."""

DRIFT = 5e-6
"""Over two minutes of pulses; a line through errors below half a sample allows 1 ms / 120 s = 8e-6 at most."""


def channel(time, offset, drift, period=1.0, width=0.02, rise=0.0, noise=0.0, seed=0):
    """A pulse train as an acquisition with its own clock samples it; `rise` s of a ramp at each edge."""
    since = (time / (1 + drift) - offset) % period
    running = time / (1 + drift) >= offset - 0.5 * rise
    up = np.clip(since / rise + 0.5, 0, 1) if rise else (since >= 0).astype(float)
    before = np.clip((since - period) / rise + 0.5, 0, 1) if rise else 0.0
    value = 5.0 * running * (np.where(since < width, up, 0.0) + before)
    return value + noise * np.random.default_rng(seed).normal(size=len(time))


def pulses(duration, offset, drift, **options):
    time = np.arange(int(1000 * duration)) * 1e-3
    edges = rising_edges(channel(time, offset, drift, **options), time)
    return clock_from_pulses(edges, np.arange(np.floor(duration - offset) + 1), 1e-3, 5e-5)


@pytest.mark.parametrize("seed", range(4))
def test_a_long_pulse_train_gives_offset_and_drift(seed):
    rng = np.random.default_rng(seed)
    offset, drift = rng.uniform(0.05, 0.95), rng.normal(0, 4e-5)
    clock = pulses(121.0, offset, drift)
    assert abs(clock.offset - offset) < ALIGNED
    assert abs(clock.drift - drift) < DRIFT
    # Standard errors are those of a flat distribution, which ends at 2.5 of them or so.
    assert abs(clock.drift - drift) < 4 * clock.drift_sd
    assert abs(clock.offset - offset) < 4 * clock.offset_sd


def test_an_edge_with_samples_in_it_is_found_between_them():
    """A ramp of 4 ms and 10 mV of noise on 5 V: edges to 10 us, drift to 5 ppm within seven seconds."""
    clock = pulses(8.0, 0.3037, 3e-5, rise=0.004, noise=0.01)
    assert abs(clock.offset - 0.3037) < 5e-5
    assert abs(clock.drift - 3e-5) < DRIFT
    assert clock.time_sd < 5e-5


def test_missing_spurious_and_late_pulses_do_not_move_the_line():
    time = np.arange(31_000) * 1e-3
    value = channel(time, 0.2503, 2e-5)
    value[(time > 7.2) & (time < 7.4)] = 0.0
    for at in (3.611, 9.87, 20.402):
        value[int(1000 * at) : int(1000 * at) + 20] = 5.0
    late = (time > 12.2) & (time < 12.3)
    value[late] = np.roll(value[late], 8)
    clock = clock_from_pulses(rising_edges(value, time), np.arange(31.0), 1e-3, 5e-5)
    assert abs(clock.offset - 0.2503) < ALIGNED
    assert abs(clock.drift - 2e-5) < 4 * clock.drift_sd
    assert "29 sync pulses, 4 left out" in clock.method


def test_a_shared_irregular_train_needs_no_approximate_offset_and_a_regular_one_does():
    rng = np.random.default_rng(5)
    known = np.cumsum(rng.uniform(0.5, 1.5, size=20))
    time = np.arange(40_000) * 1e-3
    value = np.zeros(len(time))
    for pulse in known[2:]:
        start = (pulse + 3.4) * (1 + 2e-5)
        value[(time >= start) & (time < start + 0.02)] = 5.0
    clock = clock_from_pulses(rising_edges(value, time), known, 1e-3, 5e-5, periodic=False)
    assert abs(clock.offset - 3.4) < ALIGNED
    edges = rising_edges(channel(np.arange(9000) * 1e-3, 0.2503, 0.0), np.arange(9000) * 1e-3)
    with pytest.raises(ValueError, match=r"pair up equally well .* 'offset' of \[clock\]"):
        clock_from_pulses(edges, np.arange(20.0), 1e-3, 5e-5, periodic=False)
    clock = clock_from_pulses(edges, np.arange(20.0), 1e-3, 5e-5, offset=-3.6, periodic=False)
    assert abs(clock.offset + 3.7497) < ALIGNED


def test_a_channel_without_pulses_is_refused():
    time = np.arange(3000) * 1e-3
    with pytest.raises(ValueError, match="never changes"):
        rising_edges(np.zeros(3000), time)
    with pytest.raises(ValueError, match="no two levels"):
        rising_edges(np.random.default_rng(0).normal(size=3000), time)


def presses(period=None, seed=1):
    """Depth of a pad of 8 mm in four presses, and a force 0.7 s later on its own clock that is 800 N/m of it."""
    rng = np.random.default_rng(seed)
    time = np.arange(4000) / 500.0
    starts = np.array([1.0, 2.3, 4.5, 6.4]) if period is None else 0.7 + period * np.arange(int(6.5 / period))
    height = np.full(len(time), 0.02)
    for start in starts:
        height -= 0.015 * np.exp(-(((time - start) / 0.08) ** 2))
    force = 800 * np.maximum(0.008 - height, 0.0)
    fine = np.arange(9000) * 1e-3
    later = np.interp(fine - 0.7, time, force)
    heights = height + 5e-5 * rng.normal(size=len(time))
    return Signal(time, heights), Signal(fine, later + 0.01 * rng.normal(size=len(fine)))


def test_contacts_alone_give_the_offset_within_its_error():
    height, force = presses()
    clock = clock_from_contacts(height, 0.008, force, 0.0, 1.0, 5e-5)
    assert abs(clock.offset - 0.7) < 2 * clock.offset_sd
    assert clock.offset_sd < 0.004
    assert clock.drift == 0.0
    assert clock.drift_sd == 5e-5


def test_presses_at_equal_intervals_are_ambiguous():
    height, force = presses(period=0.5)
    with pytest.raises(ValueError, match="the offset is ambiguous"):
        clock_from_contacts(height, 0.008, force, 0.0, 1.0, 5e-5)
    clock = clock_from_contacts(height, 0.008, force, 0.65, 0.15, 5e-5)
    assert abs(clock.offset - 0.7) < 2 * clock.offset_sd


def test_force_that_has_nothing_to_do_with_the_pad_is_refused():
    height, force = presses()
    noise = np.random.default_rng(0).normal(size=len(force.time))
    with pytest.raises(ValueError, match="correlate by"):
        clock_from_contacts(height, 0.008, force._replace(value=noise), 0.0, 1.0, 5e-5)


@pytest.fixture
def daq(shared_data, monkeypatch):
    monkeypatch.setenv("ICJAX_SHARED_DATA", str(shared_data))
    return read_session(SESSION)


def test_the_simulated_acquisition_is_aligned_within_half_a_millisecond(daq, shared_data):
    """Drift: seven pulses at whole seconds, sampled every ms, leave it open between 0 and 250 ppm; it is stated so."""
    offset, drift = np.load(shared_data / "virtual_sessions" / "explore" / "trial00_truth.npz")["clock"]
    clock = load_trial(daq, daq.trials[0]).metadata["clock"]
    assert isinstance(clock, Clock)
    when = np.linspace(0.0, 6.72, 50)
    np.testing.assert_allclose(clock.on_marker_clock((when + offset) * (1 + drift)), when, atol=ALIGNED)
    assert abs(clock.offset - offset) < 3 * clock.offset_sd
    assert abs(clock.drift - drift) < 3 * clock.drift_sd
    text = "\n".join(check(daq))
    assert "forces have a clock of their own: offset 102.9" in text
    # Two frames of the markers: what the physics of a soft pad was seen to allow.
    found = dataclasses.replace(daq, clock=dataclasses.replace(daq.clock, sync=None, period=None, correlate="plate"))
    alone = load_trial(found, found.trials[0]).metadata["clock"]
    assert abs(alone.offset - offset) < 0.004


def test_contacts_of_the_separate_acquisition_are_those_of_the_shared_one(daq):
    """The same trial with the force on the marker clock: onsets agree to the alignment and the noise."""
    shared = read_session(SESSION.with_name("virtual_explore.toml"))
    found = []
    for spec in (daq, shared):
        trial = spec.trials[0]
        sensor = sensor_wrench(load_trial(spec, trial), trial, spec.source("plate"), spec.path)
        found.append(contact_events(force_course(sensor, 150.0, spec.contact), spec.contact))
    np.testing.assert_allclose(found[0], found[1], atol=2 * ALIGNED)


def test_check_says_how_far_the_pulses_of_a_shared_acquisition_are_off(daq, shared_data):
    shared = read_session(SESSION.with_name("virtual_explore.toml"))
    spec = dataclasses.replace(shared, clock=daq.clock, trials=shared.trials[:1])
    text = "\n".join(check(spec))
    assert "sync pulses, at most -0.50 ms off the marker clock (one sample is 1 ms)" in text
    assert "are the clocks shared?" not in text
    late = dataclasses.replace(spec, clock=dataclasses.replace(daq.clock, start=0.01))
    assert "are the clocks shared?" in "\n".join(check(late))


def test_an_absent_sync_channel_is_named(daq):
    spec = dataclasses.replace(daq, clock=dataclasses.replace(daq.clock, sync="PULSE"))
    with pytest.raises(FileError, match=r"trial00_force_daq\.csv: has no analog channel 'PULSE'"):
        load_trial(spec, spec.trials[0])


def test_a_channel_that_begins_within_a_pulse_needs_an_offset(daq, tmp_path):
    trial = daq.trials[0]
    header, *rows = trial.forces.read_text().splitlines()
    values = np.array([[float(cell) for cell in row.split(",")] for row in rows])
    sync = values[:, header.split(",").index("SYNC")]
    first = int(np.flatnonzero(sync > 0.5 * sync.max())[0]) + 5
    cut = values[first:].copy()
    cut[:, 0] -= cut[0, 0]
    path = tmp_path / "cut.csv"
    path.write_text("\n".join([header, *(",".join(map(repr, map(float, row))) for row in cut)]))
    short = dataclasses.replace(trial, forces=path, tare=((1.0, 1.1),))
    with pytest.raises(FileError, match=r"'SYNC' begins within a pulse, .* the key 'offset' of \[clock\]"):
        load_trial(daq, short)
    # The file begins 5 ms after the rise of the first pulse, which is at 0 on the marker clock.
    told = dataclasses.replace(daq, clock=dataclasses.replace(daq.clock, offset=0.0))
    assert abs(load_trial(told, short).metadata["clock"].offset + 0.005) < 0.001
