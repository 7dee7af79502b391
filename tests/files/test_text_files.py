"""TRC, STO, MOT and CSV: values, gaps and rates as in the file; an error names the file and the line."""

import numpy as np
import pytest

from icjax.files import FileError, read_csv, read_sto, read_trc

TRC = """PathFileType\t4\t(X/Y/Z)\tfree.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames
100.0\t100.0\t3\t2\tmm\t100.0\t1\t3
Frame#\tTime\tKnee\t\t\tAnkle\t\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.00\t1\t2\t3\t4\t5\t6
2\t0.01\t\t\t\t40\t50\t60
3\t0.02\t100\t200\t300\tNaN\tNaN\tNaN
"""

MOT = """forces
version=1
nRows=3
nColumns=3
inDegrees=no
endheader
time\tground_force_vy\tground_force_px
0.0\t10\t0.1
0.5\t20\tnan
1.0\t30\t0.3
"""

CSV = """t,A_x,A_y,A_z,Fz,Tx
0.0,1,2,3,10,500
0.1,nan,,nan,20,600
0.2,7,8,9,30,700
"""


def put(path, text):
    path.write_text(text)
    return path


def test_trc(tmp_path):
    read = read_trc(put(tmp_path / "a.trc", TRC))
    assert (read.marker_names, read.marker_rate, read.marker_unit) == (("Knee", "Ankle"), 100.0, "mm")
    nan = [np.nan] * 3
    expected = [[[1, 2, 3], [4, 5, 6]], [nan, [40, 50, 60]], [[100, 200, 300], nan]]
    np.testing.assert_allclose(read.markers, np.array(expected) * 1e-3, rtol=1e-15)
    np.testing.assert_array_equal(read.marker_time, [0.0, 0.01, 0.02])


def test_sto(tmp_path):
    read = read_sto(put(tmp_path / "a.mot", MOT))
    assert read.analog_names == ("ground_force_vy", "ground_force_px")
    assert read.analog_units == ("N", "m")
    assert read.analog_rate == 2.0
    assert read.metadata["inDegrees"] is False
    np.testing.assert_array_equal(read.analog, [[10, 0.1], [20, np.nan], [30, 0.3]])
    assert read.markers.shape == (0, 0, 3)


def test_csv_with_the_defaults(tmp_path):
    read = read_csv(put(tmp_path / "a.csv", CSV))
    assert read.marker_names == ("A",)
    np.testing.assert_allclose(read.marker("A"), [[1e-3, 2e-3, 3e-3], [np.nan] * 3, [7e-3, 8e-3, 9e-3]])
    assert read.analog_names == ("Fz", "Tx")
    np.testing.assert_array_equal(read.analog[:, 1], [500, 600, 700])
    assert any("'Tx' has no unit" in note for note in read.notes)


def test_csv_with_a_column_map(tmp_path):
    columns = {
        "time": "t",
        "length_unit": "m",
        "markers": {"tip": ["A_x", "A_y", "A_z"]},
        "channels": {"force": "Fz", "torque": "Tx"},
        "units": {"force": "N", "torque": "Nmm"},
    }
    read = read_csv(put(tmp_path / "a.csv", CSV.replace(",", ";")), columns)
    np.testing.assert_allclose(read.marker("tip")[0], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(read.channels(["torque", "force"]), [[0.5, 10], [0.6, 20], [0.7, 30]])
    assert read.notes == ()


@pytest.mark.parametrize(
    ("reader", "text", "before", "after", "message"),
    [
        (read_trc, TRC, "3\t0.02", "3\t0.01", "time does not increase at data row 3"),
        (read_trc, TRC, "2\t0.01", "2\tNaN", "data row 2 has no valid time"),
        (read_trc, TRC, "\t40\t50\t60", "\t40\t50", "line 8 has 7 columns, expected 8"),
        (read_trc, TRC, "\t40", "\tforty", "line 8, column 6: 'forty' is not a number"),
        (read_trc, TRC, "100.0\t3\t2", "100.0\t4\t2", "holds 3 of 4 frames: truncated"),
        (read_trc, TRC, "3\t2\tmm", "3\t3\tmm", "names 2 markers but states NumMarkers 3"),
        (read_trc, TRC, "mm", "px", "states lengths in the unknown unit 'px'"),
        (read_trc, TRC, "3\t2\tmm", "many\t2\tmm", "line 3 states no valid NumFrames"),
        (read_trc, TRC, "PathFileType", "Path", "is not a TRC file"),
        (read_sto, MOT, "endheader\n", "", "is not a STO or MOT file"),
        (read_sto, MOT, "1.0\t30", "0.5\t30", "time does not increase at data row 3"),
        (read_sto, MOT, "20\tnan", "20", "line 9 has 2 columns, expected 3"),
        (read_sto, MOT, "nRows=3", "nRows=30", "holds 3 of 30 rows: truncated"),
        (read_sto, MOT, "nRows=3", "nRows=three", "the header states nRows = 'three'"),
        (read_sto, MOT, "\t30", "\tx30", "line 10, column 2: 'x30' is not a number"),
        (read_sto, MOT, "time", "clock", "the first column is 'clock', expected 'time'"),
        (read_csv, CSV, "0.2,7", "0.05,7", "time does not increase at data row 3"),
        (read_csv, CSV, ",30,", ",", "line 4 has 5 columns, expected 6"),
        (read_csv, CSV, "500", "5OO", "line 2, column 6: '5OO' is not a number"),
        (read_csv, CSV, CSV[20:], "", "holds no rows"),
        (read_csv, CSV, CSV, "\n", "is empty"),
        (read_csv, CSV, "t,A", "t\0,A", "is not a text file"),
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


@pytest.mark.parametrize("reader", [read_trc, read_sto, read_csv])
def test_missing_files(tmp_path, reader):
    with pytest.raises(FileError, match=r"none\.txt: does not exist"):
        reader(tmp_path / "none.txt")


def test_unknown_columns_and_labels(tmp_path):
    path = put(tmp_path / "a.csv", CSV)
    with pytest.raises(FileError, match="has no column 'Fq'"):
        read_csv(path, {"channels": {"force": "Fq"}})
    with pytest.raises(ValueError, match="unknown entry 'marker'"):
        read_csv(path, {"marker": {}})
    with pytest.raises(ValueError, match="length_unit is the unknown unit 'px'"):
        read_csv(path, {"length_unit": "px"})
    with pytest.raises(ValueError, match=r"columns\.markers\.A must list three columns"):
        read_csv(path, {"markers": {"A": "A_x"}})
    with pytest.raises(FileError, match="has no marker 'B'"):
        read_csv(path).marker("B")
    with pytest.raises(FileError, match="has no analog channel 'Fy'"):
        read_csv(path).channels(["Fz", "Fy"])


def test_every_opensim_file_is_read(shared_data):
    """Rates, sizes and the statement about degrees, as the headers say."""
    folder = shared_data / "opensim_core_gait"
    sizes = {
        "subject01/subject01_static.trc": (300, 49, 60.0),
        "subject01/subject01_walk1.trc": (151, 41, 60.0),
        "walk3d/markers_walk.trc": (238, 41, 100.0),
    }
    for name, (frames, markers, rate) in sizes.items():
        read = read_trc(folder / name)
        assert read.markers.shape == (frames, markers, 3)
        assert read.marker_rate == rate
        assert 0.0 < np.nanmedian(read.markers[:, :, 1]) < 2.0  # m, y up
    tables = {
        "subject01/subject01_walk1_grf.mot": (9009, 18, None),
        "subject01/subject01_walk1_ik.mot": (211, 23, True),
        "subject01/std_subject01_InverseDynamics.sto": (73, 23, None),
        "walk3d/coordinates.sto": (1350, 31, False),
        "walk3d/grf_walk.mot": (4778, 18, False),
    }
    for name, (rows, columns, degrees) in tables.items():
        read = read_sto(folder / name)
        assert read.analog.shape == (rows, columns)
        assert read.metadata["inDegrees"] is degrees
    assert "states 40 columns" in read_sto(folder / "walk3d" / "coordinates.sto").notes[0]


def test_a_header_whose_rate_contradicts_its_times_is_noted(shared_data):
    read = read_trc(shared_data / "opensim_core_gait" / "c3d" / "std_walking2_markers.trc")
    assert "states 250 Hz" in read.notes[0]
    assert read.marker_rate == pytest.approx(25.0, abs=0.05)  # the last interval is shorter


def test_uneven_times_are_noted(tmp_path):
    assert read_sto(put(tmp_path / "a.mot", MOT)).notes == ()
    read = read_sto(put(tmp_path / "b.mot", MOT.replace("1.0\t30", "4.0\t30")))
    assert read.notes == ("times are not evenly spaced: intervals from 0.5 to 3.5 s",)


def test_a_force_recorder_with_its_own_clock(shared_data):
    units = {"Fx": "N", "Fy": "N", "Fz": "N", "Tx": "Nm", "Ty": "Nm", "Tz": "Nm", "SYNC": "V"}
    read = read_csv(shared_data / "virtual_sessions" / "explore" / "trial00_force_daq.csv", {"units": units})
    assert read.analog_names == tuple(units)
    assert read.notes == ()
    assert read.analog_rate == pytest.approx(1000.0)
