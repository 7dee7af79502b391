"""What cannot be meant is said: a sound session made wrong in one respect at a time."""

import dataclasses
import json

import numpy as np
import pytest

from icjax.capture import capture, check_recording, read_session
from icjax.cli import main
from icjax.files import read_c3d, write_c3d
from icjax.laboratory import record
from icjax.recording import Session


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studio")
    record(folder, seed=3, trials=1, contacts=2)
    return folder


@pytest.fixture(scope="module")
def sound(studio):
    return capture(read_session(studio / "session.toml"))


def suspicions(session):
    return [line for line in check_recording(session) if line.startswith(("suspicious: ", "error: "))]


def changed(session, **fields):
    """The session with fields of its first recording replaced."""
    first, *others = session.recordings
    return dataclasses.replace(session, recordings=(dataclasses.replace(first, **fields), *others))


def again(studio, old, new):
    """The trial captured once more from a session file with one change."""
    text = (studio / "session.toml").read_text()
    assert old in text
    path = studio / "changed.toml"
    path.write_text(text.replace(old, new))
    return capture(read_session(path), trials=("trial00",))


def moved(recording, name, offset, rows=slice(None)):
    markers = np.array(recording.markers)
    markers[rows, recording.marker_names.index(name)] += offset
    return markers


def test_a_sound_session_gives_no_cause(sound):
    assert suspicions(sound) == []


def test_any_point_names_the_same_plane(studio, sound):
    far = again(studio, "point = [0.0, 0.0, 0.0]", "point = [0.5, -0.3, 0.0]")
    first, second = sound.recordings[0], far.recordings[0]
    np.testing.assert_array_equal(second.touching, first.touching)
    on = np.asarray(first.touching)[:, 0]
    np.testing.assert_allclose(second.contact_point[on], first.contact_point[on], atol=1e-9)
    np.testing.assert_allclose(second.contact_point_sd[on], first.contact_point_sd[on], rtol=1e-6)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("position = [0.0, 0.0, -0.03]", "position = [0.5, 0.0, -0.03]"),
        ("position = [0.0, 0.0, -0.03]", "position = [0.015, 0.0, -0.03]"),
        ("point = [0.0, 0.0, 0.0]", "point = [0.0, 0.0, 0.02]"),
    ],
)
def test_a_plate_in_the_wrong_place_is_beside_the_pad(studio, old, new):
    told = suspicions(again(studio, old, new))
    assert any("mm off the surface of the pad of distal" in line for line in told), told


def test_without_a_surface_the_force_must_still_pass_through_the_contact(studio, sound):
    surface = "surface = { point = [0.0, 0.0, 0.0], normal = [0.0, 0.0, 1.0] }\n"
    assert suspicions(again(studio, surface, "")) == []
    text = "position = [0.0, 0.0, -0.03]"
    path = studio / "changed.toml"
    path.write_text(
        (studio / "session.toml").read_text().replace(surface, "").replace(text, text.replace("0.03", "30"))
    )
    told = suspicions(capture(read_session(path), trials=("trial00",)))
    assert any("passes" in line and "beside its contact point" in line for line in told), told


def test_a_body_that_is_not_there_did_not_touch(sound):
    told = suspicions(changed(sound, contact_bodies=("forearm",)))
    assert any("mm off forearm" in line and "does that body touch it" in line for line in told), told


def test_a_force_in_millinewtons_presses_the_pad_flat(sound):
    recording = sound.recordings[0]
    told = suspicions(changed(sound, contact_force=1e3 * np.asarray(recording.contact_force)))
    assert any("would compress the pad of distal" in line for line in told), told


def test_a_centre_of_pressure_that_is_hardly_used_is_told(sound):
    provenance = json.loads(sound.recordings[0].provenance)
    assert provenance["contact_thresholds_n"]["plate"]["centre_of_pressure_share"] > 0.8
    provenance["contact_thresholds_n"]["plate"]["centre_of_pressure_share"] = 0.2
    told = suspicions(changed(sound, provenance=json.dumps(provenance)))
    assert any("too uncertain in 80%" in line for line in told), told


def test_markers_that_are_held_zero_double_or_swapped_are_told(sound):
    recording = sound.recordings[0]
    held = np.array(recording.markers)
    held[400:480] = held[400]
    assert any("stand exactly still: 'FA1' for 0.16 s" in line for line in suspicions(changed(sound, markers=held)))
    zero = np.array(recording.markers)
    zero[50:60, 3] = 0.0
    assert any("'HA1' is exactly at the origin in 10" in line for line in suspicions(changed(sound, markers=zero)))
    double = np.array(recording.markers)
    double[:, 5] = double[:, 4]
    assert any("'HA2' and 'HA3' are at the same place" in line for line in suspicions(changed(sound, markers=double)))
    residual = np.array(recording.marker_residual)
    residual[:, 13:15] = 0.0136
    told = suspicions(changed(sound, marker_residual=residual))
    assert any("single markers lie far from their sites ('DP1' 14 mm, 'DP2' 14 mm RMS)" in line for line in told), told


def test_a_low_cut_off_and_a_movement_counted_twice_are_told(sound):
    provenance = json.loads(sound.recordings[0].provenance)
    provenance["filter_hz"]["markers"] = 6.0
    told = suspicions(changed(sound, provenance=json.dumps(provenance)))
    assert any("markers filtered at 6 Hz" in line for line in told), told
    twice = dataclasses.replace(sound.recordings[0], name="twin")
    told = suspicions(dataclasses.replace(sound, recordings=(*sound.recordings, twice)))
    assert any("'trial00' and 'twin' hold the same movement" in line for line in told), told


def test_coordinates_that_the_markers_leave_open_are_named_in_one_line(sound):
    recording = sound.recordings[0]
    wide = np.array(recording.q_covariance)
    wide[:, 9, 9], wide[:, 4, 4] = np.radians(8.0) ** 2, 0.05**2
    told = [line for line in suspicions(changed(sound, q_covariance=wide)) if "known poorly" in line]
    assert len(told) == 1
    assert "root_y 50 mm, DIP 8.0 degrees" in told[0]


def test_a_recording_that_is_unusable_is_refused(studio, sound, tmp_path, capsys):
    lost = changed(sound, valid=np.zeros(len(sound.recordings[0].time), bool))
    assert any(line.startswith("error: ") and "no frame has a pose" in line for line in suspicions(lost))
    lost.save(tmp_path / "recording.nc")
    assert main(["estimate", str(tmp_path / "recording.nc")]) == 2
    assert "is unusable: recording 'trial00': no frame has a pose" in capsys.readouterr().err
    assert not (tmp_path / "interaction.nc").exists()
    everything = (studio / "session.toml").read_text()
    (studio / "wrong.toml").write_text(
        everything.replace("hand_length = 0.19", "hand_length = 0.19\nplacement_sd = 1e-9")
    )
    assert main(["capture", str(studio / "wrong.toml"), "--out", str(tmp_path / "kept")]) in (0, 2)
    assert len(Session.load(tmp_path / "kept" / "recording.nc").recordings) == 2


def test_a_text_field_must_hold_text(sound):
    broken = sound.recordings[0]
    # As a damaged file would give it; the checks of types in these tests would stop a direct construction.
    object.__setattr__(copy := dataclasses.replace(broken), "provenance", 5)
    with pytest.raises(ValueError, match="provenance is 5, not text"):
        type(copy).__check_init__(copy)


def test_a_tare_window_within_a_contact_leaves_a_force_that_pulls(studio, sound):
    onset, release = (float(x[0]) for x in (sound.recordings[0].events.onset, sound.recordings[0].events.release))
    text = (studio / "session.toml").read_text()
    tare = next(line for line in text.splitlines() if line.startswith("tare = "))
    middle = 0.5 * (onset + release)
    told = suspicions(again(studio, tare, f"tare = [{middle:.3f}, {middle + 0.05:.3f}]"))
    assert any("the force of 'plate' pulls at the subject in" in line for line in told), told


def told_with_forces(studio, change):
    """What is suspicious once the forces of the trial are changed by `change(analog, motion)`."""
    motion = read_c3d(studio / "trial00.c3d")
    write_c3d(
        studio / "forces.c3d",
        marker_names=motion.marker_names,
        markers=motion.markers,
        marker_rate=motion.marker_rate,
        analog_names=motion.analog_names,
        analog_units=motion.analog_units,
        analog=change(np.array(motion.analog), motion),
        analog_rate=motion.analog_rate,
    )
    return suspicions(again(studio, 'file = "trial00.c3d"', 'file = "forces.c3d"'))


def test_a_clipped_force_is_still_doubted_in_the_recording(studio):
    """At half its peak it had made joints 40 % too compliant in a fit that did not warn."""

    def clipped(analog, motion):
        vertical = analog[:, motion.analog_names.index("Fz")]
        vertical[:] = np.clip(vertical, 0.5 * vertical.min(), 0.5 * vertical.max())
        return analog

    told = told_with_forces(studio, clipped)
    assert any("channel 'Fz' stays at its largest value" in line for line in told), told


@pytest.mark.parametrize("late", [-0.06, 0.1, 0.3])
def test_forces_on_another_clock_are_told(studio, late):
    told = told_with_forces(studio, lambda analog, motion: np.roll(analog, round(late * motion.analog_rate), axis=0))
    when = "before" if late < 0 else "after"
    found = [line for line in told if "the pad meets the surface" in line and when in line]
    assert found, told
    assert float(found[0].split("comes ")[1].split(" ")[0]) == pytest.approx(1e3 * abs(late), abs=8)
