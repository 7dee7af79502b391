"""The files of the virtual studio: what a reader finds in them against the truth kept apart."""

import dataclasses
import tomllib

import jax
import numpy as np
import pytest

from icjax.capture import read_session
from icjax.files import FileError, read_c3d
from icjax.laboratory import Bump, Noise, Subject, record, replay
from icjax.laboratory._instruments import cameras
from icjax.laboratory._replay import load_truth
from icjax.model import index_finger, site_positions

TARE = 200  # analog samples: the first 0.2 s


def finger_force(path, session):
    """Force on the finger in world axes and moment about the world origin, from the file and the session alone."""
    with open(session, "rb") as file:
        source = tomllib.load(file)["source"][0]
    motion = read_c3d(path)
    columns = [motion.analog_names.index(name) for name in source["channels"]]
    wrench = motion.analog[:, columns]
    wrench = wrench - wrench[:TARE].mean(axis=0)
    rotation, position = np.asarray(source["rotation"], dtype=float), np.asarray(source["position"])
    assert source["sign"] == "on_environment"
    force, moment = -wrench[:, :3] @ rotation.T, -wrench[:, 3:] @ rotation.T
    return force, moment + np.cross(position, force)


def test_same_seed_same_data(tmp_path):
    first = record(tmp_path / "a", seed=3, trials=1, contacts=1, catch=0)
    second = record(tmp_path / "b", seed=3, trials=1, contacts=1, catch=0)
    other = record(tmp_path / "c", seed=4, trials=1, contacts=1, catch=0)
    assert first.trials[0].read_bytes() == second.trials[0].read_bytes()
    assert first.truth[0].read_bytes() == second.truth[0].read_bytes()
    assert first.trials[0].read_bytes() != other.trials[0].read_bytes()


def test_files_written(recorded):
    folder, paths = recorded
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {
        "session.toml",
        "trial00.c3d",
        "catch00.c3d",
        "truth/trial00.npz",
        "truth/catch00.npz",
        "truth/subject.json",
    }
    assert paths.session == folder / "session.toml"
    assert paths.trials == (folder / "trial00.c3d",)
    assert paths.catches == (folder / "catch00.c3d",)


def test_session_file_is_understood_by_the_capture(recorded):
    _, paths = recorded
    spec = read_session(paths.session)
    assert [(trial.name, trial.role, trial.catch_of) for trial in spec.trials] == [
        ("trial00", "trial", ()),
        ("catch00", "catch", ("trial00",)),
    ]
    assert all(trial.touches == (("plate", "fingertip"),) for trial in spec.trials)


def test_units_rates_and_labels(recorded):
    _, paths = recorded
    motion = read_c3d(paths.trials[0])
    assert motion.marker_unit == "mm"
    assert motion.marker_rate == 500.0
    assert motion.analog_rate == 1000.0
    assert motion.analog_names == ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz", "SYNC")
    assert motion.analog_units == ("N", "N", "N", "Nm", "Nm", "Nm", "V")
    assert motion.events == ()
    assert set(motion.marker_names) == set(Subject().markers()) | {"PL1", "PL2", "PL3", "PL4"}
    assert 0.0 < np.isnan(motion.markers).mean() < 0.03
    sync = motion.analog[:, 6]
    rises = np.flatnonzero(np.diff(sync) > 2.5) + 1
    np.testing.assert_allclose(motion.analog_time[rises], np.arange(1, len(rises) + 1), atol=1e-9)


def test_sensor_wrench_is_the_contact_force(recorded):
    """Mapped by the stated pose. Noise 10 mN, drift about 10 mN, mount ringing below: 15 mN RMS, 1 mNm."""
    folder, paths = recorded
    truth = load_truth(folder / "truth" / "trial00.npz")
    force, moment = finger_force(paths.trials[0], paths.session)
    force, moment = force[::2], moment[::2]
    error = force - truth.f_contact
    assert np.sqrt(np.mean(error**2, axis=0)).max() < 0.025
    # Centre of pressure on the plate, from the moment about the world origin: x = -M_y / F_z at z = 0.
    pressed = truth.f_contact[:, 2] > 0.4
    assert pressed.sum() > 100
    pressure = -moment[pressed, 1] / force[pressed, 2]
    assert np.abs(np.median(pressure - truth.pad[pressed, 0])) < 1e-3
    assert np.sqrt(np.mean((pressure - truth.pad[pressed, 0]) ** 2)) < 2e-3


def test_catch_trial_touches_nothing(recorded):
    folder, paths = recorded
    truth = load_truth(folder / "truth" / "catch00.npz")
    assert not truth.f_contact.any()
    np.testing.assert_array_equal(truth.theta, truth.theta_free)
    force, _ = finger_force(paths.catches[0], paths.session)
    assert np.abs(force[::10].mean(axis=0)).max() < 0.02
    trial, catch = read_c3d(paths.trials[0]), read_c3d(paths.catches[0])
    plate = [trial.marker_names.index(f"PL{number}") for number in (1, 2, 3, 4)]
    lowered = np.nanmean(trial.markers[:, plate], axis=0) - np.nanmean(catch.markers[:, plate], axis=0)
    np.testing.assert_allclose(lowered, np.tile([0.0, 0.0, 0.12], (4, 1)), atol=1e-4)
    # The same movement, naturally varied: near the trial's reference and not equal to it.
    reference = load_truth(folder / "truth" / "trial00.npz").theta_free
    difference = np.abs(truth.theta - reference).max()
    assert np.radians(0.1) < difference < np.radians(6.0)


def test_perfect_studio_agrees_with_the_shipped_model(tmp_path):
    """Markers from the true joint angles through `icjax.model`: what remains is rounding, half of 0.01 mm in the
    marker and in the one that gives the origin, and a micrometre of the forearm on its rest."""
    paths = record(tmp_path / "s", seed=1, trials=1, contacts=1, catch=0, noise=Noise.none(), hand_length=0.2)
    truth = load_truth(tmp_path / "s" / "truth" / "trial00.npz")
    motion = read_c3d(paths.trials[0])
    model = index_finger(hand_length=0.2, root="fixed")
    positions = jax.jit(lambda theta: site_positions(model, theta))
    onset = int(np.flatnonzero(truth.f_contact[:, 2])[0])
    frames = [0, onset // 2, onset]  # before the contact moves the forearm on its sprung rest
    start = motion.markers[frames[0], motion.marker_names.index("FA1")]
    shift = start - np.asarray(positions(truth.theta[0]))[model.site("FA1")]
    for frame in frames:
        sites = np.asarray(positions(truth.theta[frame])) + shift
        for name in model.site_names:
            found = motion.markers[frame, motion.marker_names.index(name)]
            np.testing.assert_allclose(found, sites[model.site(name)], atol=1.5e-5, err_msg=name)


@pytest.mark.parametrize("level", [0.1e-3, 0.4e-3])
def test_marker_noise_is_as_asked(level):
    """White noise from second differences of a still marker: variance 6 sigma^2; 5 % is three standard errors."""
    noise = dataclasses.replace(Noise.none(), marker=level)
    measured = cameras(("FA1", "PL1"), np.zeros((4000, 2, 3)), noise, np.random.default_rng(0))
    sigma = np.diff(measured, n=2, axis=0).std() / np.sqrt(6.0)
    assert sigma == pytest.approx(level, rel=0.05)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"compliance": (0.3, -0.9, 0.5, 1.4)}, "compliance of MP"),
        ({"compliance": (0.3, float("nan"), 0.5, 1.4)}, "compliance of MP"),
        ({"trials": 0}, "trials"),
        ({"contacts": 0}, "contacts"),
        ({"catch": -1}, "catch"),
        ({"seed": -1}, "seed"),
        ({"friction": -0.1}, "friction"),
        ({"hand_length": 2.0}, "hand_length"),
        ({"height": -0.3}, "cannot reach"),
        ({"compliance": (60.0, 60.0, 60.0, 60.0)}, "cannot reach"),
    ],
)
def test_bad_arguments_name_themselves_and_write_nothing(tmp_path, arguments, word):
    with pytest.raises(ValueError, match=word) as caught:
        record(tmp_path / "s", **{"seed": 0, **arguments})
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "s").exists()


def test_bad_bump_and_noise():
    with pytest.raises(ValueError, match="plane y = 0"):
        Bump(centre=(0.0, 0.1, 0.0), radii=(0.01, 0.03, 0.003))
    with pytest.raises(ValueError, match="radii"):
        Bump(centre=(0.0, 0.0, 0.0), radii=(0.01, 0.03, -0.003))
    with pytest.raises(ValueError, match="marker"):
        Noise(marker=-1.0)


def test_replay_needs_the_truth(tmp_path):
    with pytest.raises(FileError, match=r"subject\.json"):
        replay(tmp_path)
