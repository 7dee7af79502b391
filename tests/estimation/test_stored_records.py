"""The validator of record files: a sound file passes, each fault is named, the file's form before its meaning."""

import dataclasses

import equinox as eqx
import h5netcdf
import numpy as np
import pytest
from hand_made import pressing, session

from icjax.capture import check_recording
from icjax.cli import main
from icjax.estimation import check_interaction, estimate
from icjax.files import layout, layout_problems
from icjax.interaction import Interaction
from icjax.recording import ContactEvents, Recording, Session


@pytest.fixture(scope="module")
def recorded():
    return session(eqx.tree_at(lambda r: r.q_covariance, pressing()[0], replace_fn=lambda x: x + 1e-8 * np.eye(3)))


@pytest.fixture(scope="module")
def interaction(recorded):
    return estimate(recorded)[0]


def faults(lines):
    return [line for line in lines if line.startswith("error: ")]


def changed(recorded, **fields):
    return dataclasses.replace(recorded, recordings=(dataclasses.replace(recorded.recordings[0], **fields),))


def test_sound_records_pass(recorded, interaction):
    lines = check_recording(recorded)
    assert faults(lines) == []
    assert "801 frames" in lines[1]
    assert faults(check_interaction(interaction)) == []


def test_every_fault_of_a_recording_is_named(recorded):
    recording = recorded.recordings[0]
    on = int(np.argmax(recording.touching[:, 0]))
    backward = np.array(recording.time)
    backward[5] = backward[3]
    loose = np.array(recording.contact_force)
    loose[0, 0] = 1.0
    lost = np.array(recording.contact_point)
    lost[on] = np.nan
    unknown = np.array(recording.q)
    unknown[7] = np.nan
    late = ContactEvents(onset=np.array([99.0]), release=np.array([100.0]), contact=np.array([0]))
    foreign = ContactEvents(onset=np.array([0.4]), release=np.array([0.5]), contact=np.array([3]))
    crooked = dataclasses.replace(recording.model, body_rotation=2.0 * np.asarray(recording.model.body_rotation))
    for fields, expected in (
        ({"time": backward}, "time does not increase after frame 5"),
        ({"role": "rehearsal"}, "role 'rehearsal' is none of"),
        ({"catch_of": "trial00"}, "catch_of must be stated exactly when"),
        ({"contact_bodies": ("elbow",)}, "'elbow', neither a body nor a pad"),
        ({"contact_force": loose}, "contact_force of 'plate0' is not zero while nothing touches"),
        ({"contact_point": lost}, "contact_point of 'plate0' is unknown in 1 frames"),
        ({"q": unknown}, "q is not finite in 1 valid frames"),
        ({"q_covariance": -np.asarray(recording.q_covariance)}, "q_covariance is not symmetric"),
        ({"events": late}, "event 1 lasts from 99 to 100 s"),
        ({"events": foreign}, "event 1 is of contact 3, of 1"),
        ({"model": crooked}, "body_rotation of 'world' is no rotation matrix"),
    ):
        assert any(expected in line for line in faults(check_recording(changed(recorded, **fields)))), expected


def test_what_is_possible_but_odd_is_suspicious(recorded):
    recording = recorded.recordings[0]
    heavy = 1e5 * np.asarray(recording.contact_force)
    lines = check_recording(changed(recorded, contact_force=heavy))
    assert any(line.startswith("suspicious: ") and "exceeds 5000 N" in line for line in lines)
    wide = np.tile(np.eye(3), (len(recording.time), 1, 1))
    lines = check_recording(changed(recorded, q_covariance=wide))
    assert any("57.3 degrees" in line for line in lines)


def test_an_interaction_must_obey_its_equation(interaction):
    bent = np.array(interaction.reference)
    touched = int(np.argmax(np.abs(interaction.torque[:, 0])))
    bent[touched, 1] += 1e-3
    told = faults(check_interaction(dataclasses.replace(interaction, reference=bent)))
    assert len(told) == 1
    assert "theta = theta_r + C tau fails by 0.001" in told[0]
    negative = -np.asarray(interaction.compliance)
    assert any(
        "is negative" in x for x in faults(check_interaction(dataclasses.replace(interaction, compliance=negative)))
    )


def test_layout_names_every_entry_with_its_unit():
    entries = {entry.path: entry for entry in layout(Session)}
    force = entries["recordings/*/contact_force"]
    assert (force.sort, force.dims, force.unit) == ("variable", ("time", "contact", "axis"), "N")
    assert entries["recordings/*/events/onset"].doc == "first touch, between samples"
    assert entries["recordings/*/marker_names"].dims == ("marker",)
    assert {entry.path for entry in layout(Recording)} < {
        entry.path.removeprefix("recordings/*/") for entry in layout(Session)
    }


@pytest.mark.parametrize(
    ("spoil", "expected"),
    [
        (lambda file: file.attrs.__setitem__("version", 99), "the file attribute 'version' is '99'; it must be '1'"),
        (lambda file: file["torque"].attrs.__setitem__("units", "Nmm"), "'torque' has the unit 'Nmm'; it must be 'Nm'"),
        (lambda file: file["torque"].attrs.__setitem__("kind", "banana"), "'torque' has the attribute kind = 'banana'"),
        (
            lambda file: file.create_variable("torq", ("time",), dtype=float),
            "'torq' is no part of the record Interaction",
        ),
        (lambda file: file.attrs.__setitem__("friction", "rough"), "attribute 'friction' is 'rough', not JSON"),
    ],
)
def test_the_form_of_a_file_is_checked_first(interaction, tmp_path, capsys, spoil, expected):
    path = tmp_path / "interaction.nc"
    interaction.save(path)
    assert layout_problems(path, Interaction) == []
    assert main(["check", str(path)]) == 0
    with h5netcdf.File(path, "a") as file:
        spoil(file)
    capsys.readouterr()
    assert main(["check", str(path)]) == 2
    told = capsys.readouterr()
    assert expected in told.out
    assert told.err.startswith(f"icjax: {path}: 1 of the lines above")
