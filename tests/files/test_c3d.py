"""C3D files: what is written is read back, and what other people's software read from the same files is found."""

import dataclasses

import numpy as np
import pytest

from icjax.files import FileError, ForcePlate, MotionEvent, read_c3d, read_csv, read_sto, read_trc, write_c3d

FLOAT = 2.0**-23
"""Relative spacing of the 32-bit floats that C3D stores."""


def example(seed: int = 0, frames: int = 20, ratio: int = 4) -> dict:
    """Arguments of write_c3d: five markers with gaps, one wholly missing; two plates; events; a late start."""
    rng = np.random.default_rng(seed)
    markers = rng.normal(size=(frames, 5, 3))
    markers[3:6, 1] = np.nan
    markers[:, 4] = np.nan
    units = ("N", "N", "N", "Nmm", "Nmm", "Nmm", "N", "N", "N", "Nm", "Nm", "Nm", "V", "mV")
    corners = np.array([[0.5, 0.4, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    return {
        "marker_names": ("A", "B", "C", "D", "lost"),
        "markers": markers,
        "marker_rate": 250.0,
        "analog_names": tuple(f"ch{index}" for index in range(len(units))),
        "analog_units": units,
        "analog": rng.normal(size=(frames * ratio, len(units))) * 100,
        "analog_rate": 250.0 * ratio,
        "plates": (
            ForcePlate(2, corners, np.array([0.0, 0.0, -0.04]), tuple(range(6))),
            ForcePlate(4, corners + 1.0, np.array([0.0, 0.0, -0.05]), tuple(range(6, 12)), np.diag(np.arange(1.0, 7))),
        ),
        "events": (MotionEvent("Foot Strike", "Left", 0.404), MotionEvent("Foot Off", "Right", 61.5)),
        "first_frame": 100,
    }


def test_what_is_written_is_read_back(tmp_path):
    wrote = example()
    read = read_c3d(write_c3d(tmp_path / "a.c3d", **wrote))
    assert read.marker_names == wrote["marker_names"]
    np.testing.assert_array_equal(np.isnan(read.markers), np.isnan(wrote["markers"]))
    scale = np.nanmax(np.abs(wrote["markers"]))
    np.testing.assert_allclose(read.markers, wrote["markers"], rtol=0, atol=FLOAT * scale)
    np.testing.assert_allclose(read.analog, wrote["analog"], rtol=FLOAT)
    assert read.analog_names == wrote["analog_names"]
    assert read.analog_units == wrote["analog_units"]
    for got, put in zip(read.plates, wrote["plates"], strict=True):
        assert (got.type, got.channels) == (put.type, put.channels)
        np.testing.assert_allclose(got.corners, put.corners, atol=2 * FLOAT)
        np.testing.assert_allclose(got.origin, put.origin, atol=FLOAT)
    np.testing.assert_allclose(read.plates[1].calibration, wrote["plates"][1].calibration, rtol=FLOAT)
    assert [event[:2] for event in read.events] == [event[:2] for event in wrote["events"]]
    np.testing.assert_allclose(
        [event.time for event in read.events], [event.time for event in wrote["events"]], rtol=FLOAT
    )


def test_frames_samples_and_events_share_one_clock(tmp_path):
    read = read_c3d(write_c3d(tmp_path / "a.c3d", **example()))
    np.testing.assert_allclose(read.marker_time, (100 + np.arange(20)) / 250.0, rtol=1e-15)
    np.testing.assert_allclose(read.analog_time, 0.4 + np.arange(80) / 1000.0, rtol=1e-15)
    np.testing.assert_allclose(read.events[0].time, read.marker_time[1], rtol=FLOAT)


def test_a_marker_that_was_never_seen_is_read_as_nan(tmp_path):
    read = read_c3d(write_c3d(tmp_path / "a.c3d", **example()))
    assert np.isnan(read.marker("lost")).all()


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_lengths_are_metres_whatever_the_file_uses(tmp_path, unit, factor):
    read = read_c3d(write_c3d(tmp_path / "a.c3d", **example(), unit=unit))
    assert read.marker_unit == unit
    np.testing.assert_allclose(read.markers[:3], example()["markers"][:3], atol=1e-6)
    import ezc3d

    stored = ezc3d.c3d(str(tmp_path / "a.c3d"))["data"]["points"][:3, 0, 0]
    np.testing.assert_allclose(stored * factor, example()["markers"][0, 0], atol=1e-6)


def test_labels_are_made_unique_and_the_change_is_noted(tmp_path):
    arguments = example() | {"marker_names": ("A", "B", "A", "D", "lost")}
    read = read_c3d(write_c3d(tmp_path / "a.c3d", **arguments))
    assert read.marker_names == ("A", "B", "A#2", "D", "lost")
    assert any("'A' is repeated" in note for note in read.notes)


def test_opensim_imports_the_same_markers(shared_data):
    """OpenSim's reference holds every tenth frame and the last, to 0.1 mm."""
    folder = shared_data / "opensim_core_gait" / "c3d"
    ours, theirs = read_c3d(folder / "walking2.c3d"), read_trc(folder / "std_walking2_markers.trc")
    assert ours.marker_names == theirs.marker_names
    frames = np.append(np.arange(0, 1250, 10), 1248)
    np.testing.assert_allclose(ours.marker_time[frames], theirs.marker_time, atol=1e-9)
    np.testing.assert_array_equal(np.isnan(ours.markers[frames]), np.isnan(theirs.markers))
    printed = 0.5e-4 * 1.01  # m: the reference is printed to 0.1 mm; 1 % for the binary rounding of the tie
    np.testing.assert_allclose(ours.markers[frames], theirs.markers, rtol=0, atol=printed)


def test_opensim_reads_the_same_forces(shared_data):
    """OpenSim turns plate axes into world axes; without its rotation the channels must agree one by one."""
    folder = shared_data / "opensim_core_gait" / "c3d"
    ours, theirs = read_c3d(folder / "walking2.c3d"), read_sto(folder / "std_walking2_grfs.sto")
    samples = np.append(np.arange(0, 10000, 100), 9991)
    np.testing.assert_allclose(ours.analog_time[samples], theirs.analog_time, atol=1e-9)
    printed = 1e-8  # N: the reference is printed to 8 decimals
    first, second = ours.analog[samples, :3], ours.analog[samples, 6:9]
    np.testing.assert_allclose(theirs.analog[:, :3], -first[:, [1, 0, 2]], rtol=0, atol=printed)
    np.testing.assert_allclose(theirs.analog[:, 9:12], second * np.array([[-1.0, 1.0, -1.0]]), rtol=0, atol=printed)
    centre = [plate.corners.mean(axis=0) * 1e3 for plate in ours.plates]
    np.testing.assert_allclose(theirs.analog[:, 3:6], np.tile(centre[0], (101, 1)), atol=printed)
    np.testing.assert_allclose(theirs.analog[:, 12:15], np.tile(centre[1], (101, 1)), atol=printed)


def test_vicon_files_with_events_and_computed_outputs(shared_data):
    files = sorted((shared_data / "btk_pig").glob("*.c3d"))
    assert len(files) == 5
    for file in files:
        read = read_c3d(file)
        assert (read.marker_unit, read.marker_rate, read.analog_rate) == ("mm", 100.0, 1000.0)
        assert len(read.analog) == 10 * len(read.markers)
        assert len(read.plates) == 2
        assert "LKNE" in read.marker_names
    motion = read_c3d(shared_data / "btk_pig" / "PiG_Motion-FlatFoot-Full.c3d")
    assert motion.output_units["LAnkleMoment"] == "Nmm"
    assert "LAnkleMoment" not in motion.marker_names
    assert motion.metadata["PROCESSING:Bodymass"] == pytest.approx(47.5)
    assert len(motion.events) == 12
    for event in motion.events:  # whole frames, inside the recording: the first-frame offset is in both
        assert motion.marker_time[0] <= event.time <= motion.marker_time[-1]
        assert event.time * 100 == pytest.approx(round(event.time * 100), abs=1e-3)


def test_simulated_studio_agrees_with_its_own_text_copies(shared_data):
    folder = shared_data / "virtual_sessions" / "explore"
    c3d, csv = read_c3d(folder / "trial00.c3d"), read_csv(folder / "trial00_markers.csv")
    assert c3d.marker_names == csv.marker_names
    np.testing.assert_array_equal(np.isnan(c3d.markers), np.isnan(csv.markers))
    quantum = 1e-3 / 64  # m: the C3D copy is rounded to 1/64 mm, the text copy to 1/1000 mm
    np.testing.assert_allclose(c3d.markers, csv.markers, rtol=0, atol=(quantum + 1e-6) / 2 * 1.001)
    np.testing.assert_allclose(c3d.marker_time, csv.marker_time, atol=1e-9)


@pytest.mark.parametrize("part", [0.99, 0.6, 0.2, 0.02, 0.001])
def test_a_truncated_file_is_named_and_refused(tmp_path, part):
    whole = write_c3d(tmp_path / "whole.c3d", **example(frames=200)).read_bytes()
    path = tmp_path / "cut.c3d"
    path.write_bytes(whole[: int(part * len(whole))])
    with pytest.raises(FileError, match=r"cut\.c3d: is (truncated|damaged|not a C3D)") as caught:
        read_c3d(path)
    assert "\n" not in str(caught.value)


def test_files_that_are_no_c3d(tmp_path):
    with pytest.raises(FileError, match="nothing.c3d: does not exist"):
        read_c3d(tmp_path / "nothing.c3d")
    (tmp_path / "text.c3d").write_text("time,Fx\n0,1\n")
    with pytest.raises(FileError, match=r"text\.c3d: is not a C3D file"):
        read_c3d(tmp_path / "text.c3d")
    (tmp_path / "empty.c3d").write_bytes(b"")
    with pytest.raises(FileError, match=r"empty\.c3d: is not a C3D file"):
        read_c3d(tmp_path / "empty.c3d")


def test_no_frames(tmp_path):
    data = bytearray(write_c3d(tmp_path / "a.c3d", **example()).read_bytes())
    data[6:10] = (5).to_bytes(2, "little") + (4).to_bytes(2, "little")  # last frame before the first
    position = data.index(b"FRAMES") + 6 + 2 + 1 + 1
    position += 1 if data[position - 1] else 0
    data[position : position + 2] = (0).to_bytes(2, "little")
    (tmp_path / "b.c3d").write_bytes(data)
    with pytest.raises(FileError, match=r"b\.c3d: holds no frames"):
        read_c3d(tmp_path / "b.c3d")


def rename(path, before: bytes, after: bytes) -> None:
    """Change the name of a parameter in place."""
    data = path.read_bytes()
    assert before in data
    path.write_bytes(data.replace(before, after))


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        (b"CORNERS", b"CORNETS", "force plate 1 has no CORNERS"),
        (b"CAL_MATRIX", b"CAL_MATRIZ", "force plate 2 of type 4 has no calibration"),
        (b"ORIGIN", b"ORIGEN", "force plate 1 has no ORIGIN"),
        (b"OFFSET", b"OFFZET", "ANALOG:OFFSET is missing"),
    ],
)
def test_missing_parameters_are_named(tmp_path, before, after, message):
    path = write_c3d(tmp_path / "a.c3d", **example())
    rename(path, before, after)
    with pytest.raises(FileError, match=message):
        read_c3d(path)


def test_unknown_units(tmp_path):
    path = write_c3d(tmp_path / "a.c3d", **example(), unit="inch")
    rename(path, b"inch", b"ells")
    with pytest.raises(FileError, match="POINT:UNITS is 'ells'"):
        read_c3d(path)
    arguments = example() | {"plates": ()}
    path = write_c3d(tmp_path / "b.c3d", **arguments)
    rename(path, b"mV", b"qV")
    assert any("'ch13' has the unit 'qV'" in note for note in read_c3d(path).notes)


def test_a_plate_that_refers_to_a_channel_that_is_not_there(tmp_path):
    plate = dataclasses.replace(example()["plates"][0], channels=(0, 1, 2, 3, 4, 99))
    path = write_c3d(tmp_path / "a.c3d", **(example() | {"plates": (plate,)}))
    with pytest.raises(FileError, match="force plate 1 refers to analog channel 100 of 14"):
        read_c3d(path)


def test_a_plate_without_extent(tmp_path):
    plate = dataclasses.replace(example()["plates"][0], corners=np.zeros((4, 3)))
    path = write_c3d(tmp_path / "a.c3d", **(example() | {"plates": (plate,)}))
    with pytest.raises(FileError, match="force plate 1 has no extent"):
        read_c3d(path)


def test_damaged_bytes_give_data_or_one_clear_error(tmp_path):
    """Random damage to the header and the parameters; nothing but `FileError` may come out."""
    whole = write_c3d(tmp_path / "whole.c3d", **example()).read_bytes()
    rng = np.random.default_rng(1)
    path = tmp_path / "damaged.c3d"
    messages = []
    for _ in range(60):
        data = bytearray(whole)
        for _ in range(rng.integers(1, 20)):
            data[rng.integers(0, len(whole) // 2)] = rng.integers(256)
        path.write_bytes(data)
        try:
            read_c3d(path)
        except FileError as error:
            messages.append(str(error))
    assert len(messages) > 20
    assert not any("\n" in message for message in messages)


def test_arguments_of_the_writer_are_checked(tmp_path):
    path = tmp_path / "a.c3d"
    with pytest.raises(ValueError, match="unit must be a unit of length"):
        write_c3d(path, **example(), unit="parsec")
    with pytest.raises(ValueError, match="no whole multiple of marker_rate"):
        write_c3d(path, **(example() | {"analog_rate": 900.0}))
    with pytest.raises(ValueError, match="marker_names has 4 names for 5 markers"):
        write_c3d(path, **(example() | {"marker_names": ("A", "B", "C", "D")}))
    assert list(tmp_path.iterdir()) == []


def test_no_half_written_file(tmp_path, monkeypatch):
    import ezc3d

    def fail(self, path, *rest):
        with open(path, "wb") as file:
            file.write(b"half")
        raise RuntimeError("disk full")

    monkeypatch.setattr(ezc3d.c3d, "write", fail)
    with pytest.raises(FileError, match=r"a\.c3d: cannot be written: disk full"):
        write_c3d(tmp_path / "a.c3d", **example())
    assert list(tmp_path.iterdir()) == []


def test_without_ezc3d_the_extra_is_named(tmp_path, monkeypatch):
    import sys

    path = write_c3d(tmp_path / "a.c3d", **example())
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    with pytest.raises(ImportError, match=r'pip install "icjax\[capture\]"'):
        read_c3d(path)
