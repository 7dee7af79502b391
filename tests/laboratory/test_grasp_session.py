"""The files of a grasp session: what a reader finds in them against the truth kept apart."""

import dataclasses
import json

import jax
import numpy as np
import pytest

from icjax.capture import capture, read_session
from icjax.files import FileError, read_c3d
from icjax.laboratory import HAND_JOINTS, FreeObject, Hand, Lift, Noise, grasp_session, load_grasp, regrasp
from icjax.laboratory._hand import FINGERS
from icjax.model import site_positions

SHORT = Lift(rest=0.3, close=0.3, settle=0.1, rise=0.2, hold=0.1)
COARSE = 0.0005


def test_same_seed_same_data(tmp_path):
    first, second, other = (
        grasp_session(tmp_path / name, seed=seed, objects=[FreeObject("box")], lift=SHORT, timestep=COARSE)
        for name, seed in (("a", 3), ("b", 3), ("c", 4))
    )
    assert first.trials[0].read_bytes() == second.trials[0].read_bytes()
    assert first.truth[0].read_bytes() == second.truth[0].read_bytes()
    assert first.trials[0].read_bytes() != other.trials[0].read_bytes()


def test_files_written(grasped):
    folder, paths = grasped
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    assert names == {"session.toml", "hand.xml", "box.c3d", "truth/box.npz", "truth/hand.json"}
    assert paths.trials == (folder / "box.c3d",)
    assert paths.catches == ()
    assert paths.truth == (folder / "truth" / "box.npz", folder / "truth" / "hand.json")


def test_units_rates_and_labels(grasped):
    _, paths = grasped
    motion = read_c3d(paths.trials[0])
    assert (motion.marker_unit, motion.marker_rate, motion.analog_rate) == ("mm", 500.0, 1000.0)
    assert motion.analog_names == tuple(f"Fn_{finger}" for finger in FINGERS)
    assert motion.analog_units == ("N",) * 5
    assert set(motion.marker_names) == set(Hand().markers())
    assert len(motion.marker_names) == 3 * 17
    assert 0.0 < np.isnan(motion.markers).mean() < 0.03


def test_film_sensors_read_the_normal_force_with_their_gain(grasped):
    """No negative force; white noise of 15 mN, so 400 samples leave 1 mN of a few hundred; the session's gain."""
    folder, paths = grasped
    truth = load_grasp(folder / "truth" / "box.npz")
    gain = json.loads((folder / "truth" / "hand.json").read_text())["film_gain"]
    measured = read_c3d(paths.trials[0]).analog
    assert measured.min() == 0.0
    held = slice(-200, None)
    found = measured[2 * held.start :].mean(axis=0) / truth.f_normal[held].mean(axis=0)
    np.testing.assert_allclose(found, gain, atol=0.01)
    assert 0.001 < np.abs(np.asarray(gain) - 1.0).max() < 0.15


def test_capture_finds_angles_forces_and_contacts(grasped):
    """End to end. Placement errors of 0.3 mm on segments of 20 mm leave a constant degree at the worst joint, the
    white noise and the filter about 0.2 degrees; the films' normal is the world's x, the box tilts by up to 10 degrees.
    """
    folder, paths = grasped
    truth = load_grasp(folder / "truth" / "box.npz")
    spec = read_session(paths.session)
    assert [(trial.name, trial.friction) for trial in spec.trials] == [("box", 0.8)]
    recording = capture(spec).recordings[0]
    model = recording.model
    assert tuple(model.dof_names) == ("forearm_x", "forearm_y", "forearm_z", *HAND_JOINTS)
    assert tuple(model.pad_names) == FINGERS
    error = np.degrees(np.asarray(recording.q)[:, 3:] - truth.theta)
    assert np.sqrt(np.mean(error**2)) < 1.0
    assert np.sqrt(np.mean((error - error.mean(axis=0)) ** 2)) < 0.35
    onset = np.array([truth.t[np.flatnonzero(truth.f_normal[:, finger])[0]] for finger in range(5)])
    events = recording.events
    assert sorted(np.asarray(events.contact).tolist()) == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(np.asarray(events.onset)[np.argsort(events.contact)], onset, atol=0.02)
    force = np.asarray(recording.contact_force)
    found = np.linalg.norm(force, axis=2)[-100:].mean(axis=0)
    np.testing.assert_allclose(found, truth.f_normal[-100:].mean(axis=0), rtol=0.12)
    assert np.all(force[-100:, 0, 0] < 0.0)
    assert np.all(force[-100:, 1:, 0] > 0.0)
    # On the sphere's surface: a radius from the undeformed pad, on the object's side.
    place = np.asarray(recording.contact_point)[-1] - truth.bone[-1]
    radius = [Hand().pad(finger)[1] for finger in FINGERS]
    np.testing.assert_allclose(place[:, 0], np.multiply(radius, [1, -1, -1, -1, -1]), atol=1e-3)


def test_perfect_studio_agrees_with_the_described_hand(tmp_path):
    """Markers from the true angles through `icjax.model` and `hand.xml`: what remains is rounding, half of 0.01 mm."""
    folder = tmp_path / "s"
    paths = grasp_session(
        folder,
        seed=1,
        objects=[FreeObject("box")],
        lift=SHORT,
        noise=Noise.none(),
        timestep=COARSE,
        hand=Hand(hand_length=0.2),
    )
    truth = load_grasp(folder / "truth" / "box.npz")
    motion = read_c3d(paths.trials[0])
    model = read_session(paths.session).model
    positions = jax.jit(lambda q: site_positions(model, q))
    for frame in (0, 250, len(truth.t) - 1):
        slid = truth.root[frame] - truth.root[0]  # from the wrist's place in the model
        sites = np.asarray(positions(np.concatenate([slid, truth.theta[frame]])))
        found = np.stack([motion.markers[frame, motion.marker_names.index(name)] for name in model.site_names])
        np.testing.assert_allclose(found, sites, atol=7e-6)


def test_grasping_the_recorded_object_again_is_the_recorded_truth(grasped):
    folder, _ = grasped
    truth = load_grasp(folder / "truth" / "box.npz")
    again = regrasp(folder, "box", FreeObject("box"))
    np.testing.assert_array_equal(again.theta, truth.theta)
    np.testing.assert_array_equal(again.f_contact, truth.f_contact)
    wider = regrasp(folder, "box", FreeObject("wide", size=(0.040, 0.070, 0.052)))
    np.testing.assert_array_equal(wider.theta_free, truth.theta_free)
    assert wider.f_normal[-1].sum() > 1.2 * truth.f_normal[-1].sum()


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"seed": -1}, "seed"),
        ({"objects": []}, "objects"),
        ({"objects": [FreeObject("a"), FreeObject("a", mass=0.1)]}, "'a' twice"),
        ({"objects": [FreeObject("a", size=(0.06, 0.05, 0.05))]}, "0.06 m wide"),
        ({"timestep": 0.0003}, "timestep"),
        ({"timestep": 0.001}, "timestep"),
        ({"timestep": -1.0}, "timestep"),
        ({"lift": Lift(open=0.1)}, "cannot reach"),
    ],
)
def test_bad_arguments_name_themselves_and_write_nothing(tmp_path, arguments, word):
    with pytest.raises(ValueError, match=word) as caught:
        grasp_session(tmp_path / "s", **{"seed": 0, **arguments})
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "s").exists()


def test_bad_film_noise():
    with pytest.raises(ValueError, match="film_gain"):
        dataclasses.replace(Noise(), film_gain=0.5)


def test_truth_must_be_there(tmp_path):
    with pytest.raises(FileError, match=r"hand\.json"):
        regrasp(tmp_path, "box", FreeObject("box"))
    with pytest.raises(FileError, match="does not exist"):
        load_grasp(tmp_path / "box.npz")
    (tmp_path / "box.npz").write_bytes(b"nothing")
    with pytest.raises(FileError, match="no truth"):
        load_grasp(tmp_path / "box.npz")
