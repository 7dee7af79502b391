"""Qualisys TSV and BVH: values, gaps and clocks as in the file; an error names the file and the line."""

import numpy as np
import pytest

from icjax.capture._load import read_motion
from icjax.files import FileError, is_qualisys, read_bvh, read_tsv

HEAD = """NO_OF_FRAMES\t3
NO_OF_CAMERAS\t7
NO_OF_MARKERS\t2
FREQUENCY\t100
NO_OF_ANALOG\t0
DESCRIPTION\t--
TIME_STAMP\t2021-08-26, 15:19:24.317\t1483034.685
DATA_INCLUDED\t3D
EVENT\tstart\t2\t0.01
MARKER_NAMES\tknee\tankle
TRAJECTORY_TYPES\tMeasured\tMixed
"""
NAMES = "Frame\tTime\tknee X\tknee Y\tknee Z\tankle X\tankle Y\tankle Z\t\n"
ROWS = "11\t0.10\t1\t2\t3\t4\t5\t6\n12\t0.11\t\t\t\t0\t0\t0.000\n13\t0.12\t7\t8\t9\t0\t5\tnan\n"
TSV = HEAD + NAMES + ROWS

BVH = """HIERARCHY
ROOT Hips
{
\tOFFSET 0 0 0
\tCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
\tJOINT Upper Leg
\t{
\t\tOFFSET 0 -5 1
\t\tCHANNELS 3 Zrotation Xrotation Yrotation
\t\tEnd Site
\t\t{
\t\t\tOFFSET 0 -40 0
\t\t}
\t}
\tJOINT Chest
\t{
\t\tOFFSET 0 10 0
\t\tCHANNELS 1 Yrotation
\t}
}
MOTION
Frames: 2
Frame Time: 0.008
100 90 0 10 20 30 1 2 3 -180
101 91 1 11 21 31 2 3 4 180
"""


def put(path, text):
    path.write_text(text)
    return path


def test_tsv(tmp_path):
    read = read_tsv(put(tmp_path / "a.tsv", TSV))
    assert (read.marker_names, read.marker_rate, read.marker_unit) == (("knee", "ankle"), 100.0, "mm")
    nan = [np.nan] * 3
    expected = [[[1, 2, 3], [4, 5, 6]], [nan, nan], [[7, 8, 9], nan]]
    np.testing.assert_allclose(read.markers, np.array(expected) * 1e-3, rtol=1e-15)
    np.testing.assert_array_equal(read.marker_time, [0.10, 0.11, 0.12])
    assert read.events == (("start", "", 0.01),)
    assert read.metadata["TIME_STAMP"] == ("2021-08-26, 15:19:24.317", "1483034.685")
    assert read.notes == ()


@pytest.mark.parametrize(
    ("names", "first", "time"),
    [
        (NAMES, 0, [0.10, 0.11, 0.12]),
        (NAMES.replace("Time\t", ""), 0, [0.10, 0.11, 0.12]),  # frame 11 is the eleventh, 0.10 s after the first
        (NAMES.replace("Frame\t", ""), 1, [0.10, 0.11, 0.12]),
        (NAMES.replace("Frame\tTime\t", ""), 2, [0.0, 0.01, 0.02]),
        ("", 0, [0.10, 0.11, 0.12]),
        ("", 2, [0.0, 0.01, 0.02]),
    ],
)
def test_frame_and_time_columns_are_optional(tmp_path, names, first, time):
    cells = [line.split("\t") for line in ROWS.splitlines()]
    keep = [row[:1] + row[2:] if names.startswith("Frame\tknee") else row[first:] for row in cells]
    text = HEAD + names + "".join("\t".join(row) + "\n" for row in keep)
    read = read_tsv(put(tmp_path / "a.tsv", text))
    np.testing.assert_allclose(read.marker_time, time, rtol=1e-12)
    np.testing.assert_array_equal(read.markers, read_tsv(put(tmp_path / "b.tsv", TSV)).markers)


def test_a_recorded_hand(shared_data):
    """21 markers, 40 s at 100 Hz; the fingertips have gaps, the back of the hand has none."""
    path = shared_data / "hand_mocap_dfki" / "recording_first40s.tsv"
    read = read_tsv(path)
    assert read.markers.shape == (4000, 21, 3)
    assert (read.marker_rate, read.marker_time[0], read.marker_time[-1]) == (100.0, 0.0, 39.99)
    gaps = dict(zip(read.marker_names, np.isnan(read.markers[:, :, 0]).sum(axis=0).tolist(), strict=True))
    cells = [line.rstrip("\r\n\t").split("\t") for line in path.read_text().splitlines()[12:]]
    counted = [sum(row[2 + 3 * index] == "nan" for row in cells) for index in range(21)]  # this file writes "nan"
    assert list(gaps.values()) == counted
    assert {name for name, count in gaps.items() if count} == {"thumb_tip", "middle_tip", "ring_tip"}
    steps = np.linalg.norm(np.diff(read.marker("hand_top"), axis=0), axis=1)
    assert steps.max() < 0.05  # m in 10 ms: a hand is slower than 5 m/s, and no gap was read as the origin
    np.testing.assert_allclose(read.marker("hand_top")[0], [0.110406, 0.135075, 0.460584], rtol=1e-12)


def test_a_session_recognises_qualisys_by_its_first_line(tmp_path):
    assert read_motion(put(tmp_path / "a.tsv", TSV), {}, None).marker_names == ("knee", "ankle")
    table = put(tmp_path / "b.tsv", "t\tA_x\tA_y\tA_z\n0\t1\t2\t3\n1\t4\t5\t6\n")
    assert not is_qualisys(table)
    assert not is_qualisys(tmp_path / "none.tsv")
    assert read_motion(table, {}, None).marker_names == ("A",)


def test_bvh(tmp_path):
    read = read_bvh(put(tmp_path / "a.bvh", BVH))
    assert read.analog_names[:4] == ("Hips.Xposition", "Hips.Yposition", "Hips.Zposition", "Hips.Zrotation")
    assert read.analog_names[6:] == (
        "Upper Leg.Zrotation",
        "Upper Leg.Xrotation",
        "Upper Leg.Yrotation",
        "Chest.Yrotation",
    )
    np.testing.assert_allclose(read.analog[0, :3], [1.0, 0.9, 0.0])
    np.testing.assert_allclose(
        read.analog[:, 3:], np.radians([[10, 20, 30, 1, 2, 3, -180], [11, 21, 31, 2, 3, 4, 180]])
    )
    assert read.analog_rate == pytest.approx(125.0)
    assert read.metadata["joints"] == ("Hips", "Upper Leg", "Chest")
    assert read.metadata["parents"] == (-1, 0, 0)
    assert read.metadata["offsets"] == ((0.0, 0.0, 0.0), (0.0, -0.05, 0.01), (0.0, 0.1, 0.0))
    assert read.metadata["channels"][1] == ("Zrotation", "Xrotation", "Yrotation")
    assert read.metadata["end_sites"] == ((1, (0.0, -0.4, 0.0)),)
    assert read.notes == ("BVH states no unit of length; cm was assumed",)
    other = read_bvh(tmp_path / "a.bvh", "mm")
    np.testing.assert_allclose(other.analog[0, :3], [0.1, 0.09, 0.0])
    with pytest.raises(ValueError, match="length_unit must be a unit of length, not 'parsec'"):
        read_bvh(tmp_path / "a.bvh", "parsec")


def test_a_deep_skeleton_needs_no_deep_recursion(tmp_path):
    depth = 3000
    joints = "".join(f"JOINT j{index}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n" for index in range(depth))
    text = f"HIERARCHY\nROOT r\n{{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n{joints}" + "}\n" * (depth + 1)
    read = read_bvh(put(tmp_path / "a.bvh", text + "MOTION\nFrames: 1\nFrame Time: 0.01\n90\n"))
    assert read.metadata["parents"] == tuple(range(-1, depth))


@pytest.mark.parametrize(
    ("reader", "text", "before", "after", "message"),
    [
        (read_tsv, TSV, "NO_OF_FRAMES", "FRAMES", "is not a Qualisys TSV file"),
        (read_tsv, TSV, "FRAMES\t3", "FRAMES\t4", "holds 3 of 4 frames: truncated"),
        (read_tsv, TSV, "FRAMES\t3", "FRAMES\t-3", "states no valid NO_OF_FRAMES: '-3'"),
        (read_tsv, TSV, "MARKERS\t2", "MARKERS\t3", "names 2 markers (MARKER_NAMES) but states NO_OF_MARKERS 3"),
        (read_tsv, TSV, "FREQUENCY\t100", "FREQUENCY\t0", "states no valid FREQUENCY: '0'"),
        (read_tsv, TSV, "DED\t3D", "DED\t6D", "holds '6D' data; only 3D markers are read"),
        (read_tsv, TSV, "ankle X", "ankle Q", "has the column 'ankle Q' where MARKER_NAMES asks for 'ankle X'"),
        (read_tsv, TSV, "\tankle Z", "", "names 5 coordinate columns for 2 markers"),
        (read_tsv, TSV, "\t4\t5\t6", "\t4\t5", "line 13 has 7 columns, expected 8"),
        (read_tsv, TSV, "\t8", "\teight", "line 15, column 4: 'eight' is not a number"),
        (read_tsv, TSV, "0.12", "0.11", "time does not increase at data row 3"),
        (read_tsv, TSV, "2\t0.01", "2", "line 9: an EVENT needs a name, a frame and a time"),
        (read_bvh, BVH, "HIERARCHY", "HIER", "is not a BVH file"),
        (read_bvh, BVH, "-5 1", "-5", "line 8: 'OFFSET 0 -5' where 'OFFSET' and three numbers should be"),
        (read_bvh, BVH, "-5 1", "-5 inf", "line 8: 'OFFSET 0 -5 inf' where"),
        (read_bvh, BVH, "CHANNELS 3", "CHANNELS 4", "line 9: 'CHANNELS 4 Zrotation Xrotation Yrotation' where"),
        (read_bvh, BVH, "3 Zrotation", "3 Wrotation", "line 9: 'CHANNELS 3 Wrotation"),
        (read_bvh, BVH, "3 Zrotation Xrotation", "3 Zrotation Zrotation", "line 9: 'CHANNELS 3 Zrotation Zrotation"),
        (read_bvh, BVH, "}\nMOTION", "MOTION", "line 20: 'MOTION' where 'ROOT', 'JOINT', 'End Site'"),
        (read_bvh, BVH, "JOINT Chest", "ROOT Chest", "line 15: 'ROOT Chest' where"),
        (
            read_bvh,
            BVH,
            BVH[BVH.index("\t\tOFFSET 0 -5") :],
            "",
            "ends where 'OFFSET' and three numbers should follow: truncated",
        ),
        (read_bvh, BVH, "Frames: 2", "Frames: 3", "holds 2 of 3 frames: truncated"),
        (read_bvh, BVH, "Frames: 2", "Frames: 9999999999", "a number of frames below 1000000000"),
        (read_bvh, BVH, "Time: 0.008", "Time: 0", "line 23: 'Frame Time: 0' where"),
        (read_bvh, BVH, "-180", "", "line 24 has 9 columns, expected 10"),
        (read_bvh, BVH, " 180", " nan", "frame 2, value 10 is not a finite number"),
    ],
)
def test_bad_text_is_refused_by_name_and_line(tmp_path, reader, text, before, after, message):
    assert before in text
    path = put(tmp_path / "bad.txt", text.replace(before, after, 1))
    with pytest.raises(FileError) as caught:
        reader(path)
    assert message in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("reader", [read_tsv, read_bvh])
def test_missing_files(tmp_path, reader):
    with pytest.raises(FileError, match=r"none\.txt: does not exist"):
        reader(tmp_path / "none.txt")
