"""Film sensors against a reference: a curve that is not straight, hysteresis, drift, and what is refused."""

import numpy as np
import pytest

from icjax.capture import calibrate, fit_curve, read_curves, write_curves
from icjax.cli import main
from icjax.files import FileError

NOISE = 0.01
"""V and N; white."""


def pressed(seconds=60.0, rate=200.0, exponent=0.6, hysteresis=0.0, drift=0.0, seed=0):
    """Slow presses of growing and falling strength; voltage = F^0.6 of a saturating film, below it while it rises.

    `hysteresis`: share of full scale between the branches in the middle; `drift`: change of the gain a minute.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * rate)) / rate
    force = 3.0 * np.maximum(0.0, np.sin(2 * np.pi * time / 6.0 - 0.4)) ** 2 * (1 - 0.3 * np.cos(time / 5))
    full = force.max()
    rising = np.sign(np.gradient(force))
    felt = force - 0.5 * hysteresis * full * rising * np.sin(np.pi * force / full)
    felt = np.maximum(felt, 0.0) * (1 + drift * (time - time.mean()) / 60.0)
    voltage = 0.1 + felt**exponent + NOISE * rng.normal(size=len(time))
    return time, voltage, force, force + NOISE * rng.normal(size=len(time))


def test_a_curved_characteristic_is_recovered():
    time, voltage, force, reference = pressed()
    curve = fit_curve("FSR1", time, voltage, reference, NOISE)
    # 12 knots of F^0.6: the cubic between them is within 1 % of the range, the noise 10 mV (dF/dV is 2.6 at 3 N).
    clean = 0.1 + force**0.6
    assert np.max(np.abs(curve(clean) - force)) < 0.01 * curve.force[-1]
    assert curve.residual_sd < 0.05
    assert (np.diff(curve(np.linspace(0, 2.5, 500))) >= 0).all()
    assert curve.hysteresis_percent < 3 * curve.hysteresis_noise_percent + 0.5
    assert abs(curve.drift_percent_per_minute) < 4 * curve.drift_sd


def test_hysteresis_and_drift_are_reported():
    time, voltage, _, reference = pressed(hysteresis=0.08)
    curve = fit_curve("FSR1", time, voltage, reference, NOISE)
    # 8 % between the branches in the middle of the range, averaged over an eighth of it.
    assert abs(curve.hysteresis_percent - 8.0) < 0.8
    time, voltage, _, reference = pressed(drift=0.05, seconds=120.0)
    curve = fit_curve("FSR1", time, voltage, reference, NOISE)
    assert abs(curve.drift_percent_per_minute - 5.0) < max(4 * curve.drift_sd, 0.5)


def test_nothing_is_invented_beyond_the_range_and_a_dead_channel_is_refused():
    time, voltage, _, reference = pressed()
    curve = fit_curve("FSR1", time, voltage, reference, NOISE)
    assert float(curve(np.array([-1.0]))[0]) == 0.0
    top = curve.voltage[-1] + np.array([0.0, 0.1, 0.2])
    assert np.ptp(np.diff(curve(top))) < 1e-9
    noise = NOISE * np.random.default_rng(3).normal(size=len(time))
    with pytest.raises(ValueError, match="channel 'FSR1' does not rise with the reference force"):
        fit_curve("FSR1", time, noise, reference, NOISE)
    with pytest.raises(ValueError, match="samples are too few"):
        fit_curve("FSR1", time[:30], voltage[:30], reference[:30], NOISE)


TEXT = """
file = "press.csv"
[reference]
channels = ["Fz"]
tare = [0.0, 0.3]
[[sensor]]
channel = "FSR1"
"""


@pytest.fixture
def recording(tmp_path):
    time, voltage, _, reference = pressed()
    rows = [f"{t:.4f},{v:.5f},{f + 0.4:.5f}" for t, v, f in zip(time, voltage, reference, strict=True)]
    (tmp_path / "press.csv").write_text("time,FSR1,Fz\n" + "\n".join(rows) + "\n")
    (tmp_path / "press.toml").write_text(TEXT)
    return tmp_path


def test_the_verb_writes_what_the_reader_reads(recording, capsys):
    assert main(["calibrate", str(recording / "press.toml"), "--out", str(recording / "fsr.toml")]) == 0
    assert "FSR1" in capsys.readouterr().out
    found = read_curves(recording / "fsr.toml")["FSR1"]
    (made,) = calibrate(recording / "press.toml")
    volts = np.linspace(0.0, 2.0, 50)
    # Eight figures are written.
    np.testing.assert_allclose(found(volts), made(volts), rtol=1e-6, atol=1e-7)
    assert found.hysteresis_percent > 0
    assert found.hysteresis_percent == pytest.approx(made.hysteresis_percent, rel=1e-4)
    assert not list(recording.glob(".fsr*"))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ('file = "press.csv"', 'file = "absent.csv"', "which does not exist"),
        ('channels = ["Fz"]', 'channels = ["Fz", "Fy"]', "[reference] key 'channels' lists 2 channels"),
        ('channels = ["Fz"]', 'channels = ["Fq"]', "has no analog channel 'Fq'"),
        ('channel = "FSR1"', 'channel = "FSR9"', "has no analog channel 'FSR9'"),
        ('channel = "FSR1"', 'channel = "FSR1"\ninterval = [90, 91]', "0 loaded"),
        ("[0.0, 0.3]", "[0.0, 0.01]", "the tare of its reference holds 3 samples"),
        ('[[sensor]]\nchannel = "FSR1"', "", "needs at least one sensor"),
    ],
)
def test_bad_calibrations_give_one_line_and_no_file(recording, old, new, expected, capsys):
    assert old in TEXT
    (recording / "press.toml").write_text(TEXT.replace(old, new))
    assert main(["calibrate", str(recording / "press.toml"), "--out", str(recording / "fsr.toml")]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert expected in lines[0]
    assert not (recording / "fsr.toml").exists()


def test_a_damaged_calibration_is_named(tmp_path, recording):
    write_curves(tmp_path / "fsr.toml", calibrate(recording / "press.toml"), "press.toml")
    text = (tmp_path / "fsr.toml").read_text()
    (tmp_path / "fsr.toml").write_text(text.replace("force = [0.0", "force = [9.0"))
    with pytest.raises(FileError, match=r"key 'force' must be a list of two or more increasing numbers"):
        read_curves(tmp_path / "fsr.toml")
