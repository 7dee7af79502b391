"""A session with [calibration] from files to a recording: the model that was wrong on purpose, through the verb."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.capture import CalibrationOptions
from icjax.capture._calibration_parameters import calibration_parameters, changed_model
from icjax.cli import main
from icjax.cli._capture import LONG
from icjax.files import write_trc
from icjax.model import index_finger, integrate, neutral, site_positions
from icjax.recording import Session

RATE, NOISE, LENGTH = 200.0, 1e-4, 0.19
MODEL = index_finger(LENGTH, "free")
SITES = MODEL.site_names


def larger():
    """A subject 8 % larger than the model, with a middle phalanx that is 5 % longer still."""
    numbers = tuple(range(len(SITES)))
    options = CalibrationOptions(("rom",), size=0.1, lengths=0.05, axes=None, placement=False)
    parameters = calibration_parameters(MODEL, numbers, 0.001, options)
    wanted = np.zeros(len(parameters.names))
    wanted[parameters.names.index("size")] = 0.08
    wanted[parameters.names.index("length middle")] = 0.05
    return jax.tree.map(
        np.asarray, changed_model(MODEL, numbers, parameters, jnp.asarray(wanted / parameters.prior_sd))
    )


def movement(frames, seed):
    """Strokes of all joints on a forearm that turns; coordinates of a model on a free root."""
    time = np.arange(frames) / RATE
    dq = np.zeros((frames, MODEL.nv))
    dq[:, :3] = 0.1 * np.sin(time)[:, None]
    phases = (2 + 0.2 * seed) * time[:, None] * np.array([1, 1.3, 1.7, 2.1]) + np.arange(4) + seed
    dq[:, 6:] = np.array([0, 0.3, 0.6, 0.4]) + np.array([0.6, 0.5, 0.5, 0.4]) * np.sin(phases)
    return np.asarray(jax.jit(jax.vmap(lambda d: integrate(MODEL, neutral(MODEL), d)))(jnp.asarray(dq)))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two movements of a hand that is 8 % larger than the session says."""
    folder = tmp_path_factory.mktemp("calibrated")
    subject = larger()
    for seed, name in enumerate(("rom", "other")):
        places = jax.jit(jax.vmap(lambda q: site_positions(subject, q)))(jnp.asarray(movement(800, seed)))
        noise = NOISE * np.random.default_rng(seed).normal(size=places.shape)
        places, time = np.asarray(places) + noise, np.arange(800) / RATE
        write_trc(folder / f"{name}.trc", marker_names=SITES, markers=places, time=time, rate=RATE)
    lines = ["[model]", 'builtin = "index_finger"', f"hand_length = {LENGTH}", 'root = "free"', "[calibration]"]
    lines += ['trials = ["rom"]', "size = 0.1", "placement = false", "axes = false", "[markers]"]
    lines += [f'{site} = "{site}"' for site in SITES]
    for name in ("rom", "other"):
        lines += ["[[trial]]", f'name = "{name}"', f'file = "{name}.trc"', 'role = "range_of_motion"']
    (folder / "session.toml").write_text("\n".join(lines) + "\n")
    return folder


def captured(folder, out):
    assert main(["capture", str(folder / "session.toml"), "--out", str(folder / out)]) == 0
    return Session.load(folder / out / "recording.nc")


def test_the_calibrated_model_is_in_every_recording_and_fits(folder, capsys):
    session = captured(folder, "out")
    told = capsys.readouterr().out
    assert "calibrat" in told
    true = larger().site_position
    plain = (folder / "session.toml").read_text()
    (folder / "plain.toml").write_text(plain[: plain.index("[calibration]")] + plain[plain.index("[markers]") :])
    assert main(["capture", str(folder / "plain.toml"), "--out", str(folder / "plain")]) == 0
    before = Session.load(folder / "plain" / "recording.nc")
    for index, recording in enumerate(session.recordings):
        rms = np.sqrt(np.mean(np.asarray(recording.marker_residual) ** 2))
        wrong = np.sqrt(np.mean(np.asarray(before.recordings[index].marker_residual) ** 2))
        # What is left is noise: 3 sqrt(1 - 10 / 48) of it a marker, the filter does not change the distance to raw.
        assert rms < 2.5 * NOISE < 0.5 * wrong
        assert json.loads(recording.provenance)["calibration"]["converged"]
        joints = np.asarray(recording.q)[:, 7:] - movement(800, index)[:, 7:]
        assert np.degrees(np.sqrt(np.mean(joints**2))) < 0.5
        np.testing.assert_allclose(np.asarray(recording.model.site_position), true, atol=5e-4)


def test_two_processes_write_what_one_writes(folder, monkeypatch):
    one = captured(folder, "out")
    monkeypatch.setattr("icjax.cli._capture.LONG", 1000)
    two = captured(folder, "shared")
    assert LONG > 1_000_000
    for a, b in zip(one.recordings, two.recordings, strict=True):
        for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
            np.testing.assert_array_equal(x, y)


def test_an_error_in_the_other_process_is_one_line(folder, capsys, monkeypatch):
    monkeypatch.setattr("icjax.cli._capture.LONG", 1000)
    bad = folder / "bad"
    bad.mkdir()
    for name in ("rom", "other"):
        (bad / f"{name}.trc").write_text((folder / f"{name}.trc").read_text())
    text = (folder / "session.toml").read_text()
    (bad / "session.toml").write_text(text[: text.index("[calibration]")] + text[text.index("[markers]") :])
    lines = (bad / "rom.trc").read_text().splitlines()
    (bad / "rom.trc").write_text("\n".join([*lines[:20], lines[20].replace(".", "?", 1), *lines[21:]]) + "\n")
    assert main(["capture", str(bad / "session.toml"), "--out", str(bad / "out")]) == 2
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("icjax: ")]
    assert len(told) == 1
    assert "rom.trc" in told[0]
    assert not (bad / "out" / "recording.nc").exists()
