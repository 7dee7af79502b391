"""TRC, STO and MOT: what is written is read back, in the layout of OpenSim's own files, whole or not at all."""

import numpy as np
import pytest

from icjax.files import FileError, read_sto, read_trc, write_sto, write_trc

PRINTED = 0.5e-9 * 1.001
"""m and s; nine decimals, and the rounding of the last one in binary."""

DIGITS = 0.5e-11
"""Relative; twelve significant digits."""


def trc(seed: int = 0) -> dict:
    markers = np.random.default_rng(seed).normal(size=(7, 3, 3))
    markers[2:4, 1] = np.nan
    markers[5, 0, 2] = np.nan
    return {
        "marker_names": ("R.ASIS", "left knee", "c"),
        "markers": markers,
        "time": 3.0 + np.arange(7) / 60.0,
        "rate": 60.0,
    }


def sto(seed: int = 0) -> dict:
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(6, 3)) * np.array([[1e-6, 1.0, 1e6]])
    values[2, 1] = np.nan
    return {
        "time": 0.1 + np.arange(6) / 300.0,
        "names": ("plate_vx", "plate_px", "plate_torque_x"),
        "values": values,
        "in_degrees": True,
    }


@pytest.mark.parametrize("unit", ["mm", "cm", "m"])
def test_trc_round_trip(tmp_path, unit):
    wrote = trc()
    read = read_trc(write_trc(tmp_path / "new" / "a.trc", **wrote, unit=unit))
    assert (read.marker_names, read.marker_rate, read.marker_unit) == (wrote["marker_names"], 60.0, unit)
    expected = wrote["markers"].copy()
    expected[5, 0] = np.nan  # a marker is there or not
    np.testing.assert_array_equal(np.isnan(read.markers), np.isnan(expected))
    np.testing.assert_allclose(read.markers, expected, rtol=0, atol=PRINTED)
    np.testing.assert_allclose(read.marker_time, wrote["time"], rtol=0, atol=PRINTED)
    assert read.notes == ()


def test_sto_round_trip(tmp_path):
    wrote = sto()
    read = read_sto(write_sto(tmp_path / "a.mot", **wrote))
    assert read.analog_names == wrote["names"]
    assert read.analog_units == ("N", "m", "Nm")
    assert read.metadata["inDegrees"] is True
    np.testing.assert_allclose(read.analog, wrote["values"], rtol=DIGITS, atol=0)
    np.testing.assert_allclose(read.analog_time, wrote["time"], rtol=DIGITS, atol=0)
    assert read_sto(write_sto(tmp_path / "b.sto", **(wrote | {"in_degrees": False}))).metadata["inDegrees"] is False
    assert read.notes == ()


def test_trc_has_the_layout_of_opensims_own(tmp_path, shared_data):
    """Written from what was read, header and label lines are those of the original, cell by cell."""
    original = shared_data / "opensim_core_gait" / "subject01" / "subject01_walk1.trc"
    read = read_trc(original)
    path = write_trc(
        tmp_path / original.name,
        marker_names=read.marker_names,
        markers=read.markers,
        time=read.marker_time,
        rate=read.marker_rate,
    )
    ours, theirs = path.read_text().splitlines(), original.read_text().splitlines()
    assert len(ours) == len(theirs)

    def cells(line):
        found = [cell.strip() for cell in line.split("\t")]
        return [f"{float(cell):.6f}" if cell.replace(".", "").replace("-", "").isdigit() else cell for cell in found]

    for number in (0, 1, 2, 3, 4, 5):
        assert [c for c in cells(ours[number]) if c] == [c for c in cells(theirs[number]) if c], number
        assert cells(ours[number])[:8] == cells(theirs[number])[:8], number
    assert cells(ours[3])[2:122:3] == list(read.marker_names)[:40]  # a name above each X
    for number in (6, 50, len(ours) - 1):
        assert cells(ours[number])[:125] == cells(theirs[number])[:125]
    np.testing.assert_allclose(read_trc(path).markers, read.markers, rtol=0, atol=PRINTED)


def test_mot_has_the_layout_of_opensims_own(tmp_path, shared_data):
    original = shared_data / "opensim_core_gait" / "walk3d" / "grf_walk.mot"
    read = read_sto(original)
    path = write_sto(tmp_path / original.name, time=read.analog_time, names=read.analog_names, values=read.analog)
    ours, theirs = path.read_text().splitlines(), original.read_text().splitlines()
    assert ours[:7] == theirs[:7]  # name, version, nRows, nColumns, inDegrees, endheader, labels
    assert len(ours) == len(theirs)
    np.testing.assert_allclose(read_sto(path).analog, read.analog, rtol=DIGITS, atol=0)


@pytest.mark.parametrize(
    ("write", "arguments", "change", "message"),
    [
        (write_trc, trc, {"unit": "parsec"}, "unit must be a unit of length"),
        (write_trc, trc, {"marker_names": ("a", "b")}, "marker_names has 2 names for 3 markers"),
        (write_trc, trc, {"marker_names": ("a", "b\tc", "d")}, "marker_names has the label 'b\\\\tc'"),
        (write_trc, trc, {"marker_names": ("a", "b", "a")}, "marker_names has the label 'a' twice"),
        (write_trc, trc, {"time": np.zeros(0), "markers": np.zeros((0, 3, 3))}, "time has 0 entries for 0 rows"),
        (write_trc, trc, {"time": np.zeros(7)}, "time must be finite and increase"),
        (write_trc, trc, {"rate": float("nan")}, "rate must be a positive number of Hz"),
        (write_trc, trc, {"markers": np.full((7, 3, 3), np.inf)}, "markers holds an infinite coordinate"),
        (write_sto, sto, {"names": ("a", "b")}, "names has 2 names for 3 columns"),
        (write_sto, sto, {"names": ("a", "b c", "d")}, "names has the label 'b c'"),
        (write_sto, sto, {"names": ("a", "time", "d")}, "names has the label 'time' twice"),
        (write_sto, sto, {"values": np.full((6, 3), -np.inf)}, "values of 'plate_vx' are infinite"),
    ],
)
def test_arguments_are_checked_before_anything_is_written(tmp_path, write, arguments, change, message):
    with pytest.raises(ValueError, match=message):
        write(tmp_path / "a.txt", **(arguments() | change))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("write", "arguments"), [(write_trc, trc), (write_sto, sto)])
def test_no_half_written_file(tmp_path, monkeypatch, write, arguments):
    path = tmp_path / "a.txt"
    path.write_text("before")

    def fail(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(FileError, match=r"a\.txt: cannot be written: No space left on device"):
        write(path, **arguments())
    assert [item.name for item in tmp_path.iterdir()] == ["a.txt"]
    assert path.read_text() == "before"
    with pytest.raises(FileError, match="cannot be written"):
        write(path / "below", **arguments())
