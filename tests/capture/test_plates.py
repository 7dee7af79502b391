"""Force plates of every supported type read the same wrench, and OpenSim's on its own file."""

import dataclasses

import numpy as np
import pytest

from icjax.capture._contact_point import centre_of_pressure
from icjax.capture._plates import plate_frame, plate_wrench
from icjax.capture._sensors import plate_surface
from icjax.files import FileError, ForcePlate, MotionFile, read_c3d, read_sto, write_c3d

CORNERS = np.array([[1.0, 2.0, 0.1], [1.0, 2.6, 0.1], [1.4, 2.6, 0.1], [1.4, 2.0, 0.1]])
"""A plate as laboratories have it: x, y along world -y, -x, so that z points down."""

ROUNDING = 1e-12
"""Relative to forces of 1000 N and arms of 3 m in double precision."""


def motion(channels: np.ndarray, plate: ForcePlate) -> MotionFile:
    count = channels.shape[1]
    return MotionFile(
        path="made.c3d",
        marker_names=(),
        marker_rate=float("nan"),
        marker_time=np.zeros(0),
        markers=np.zeros((0, 0, 3)),
        marker_unit="m",
        analog_names=tuple(f"c{index}" for index in range(count)),
        analog_units=("N",) * count,
        analog_rate=1000.0,
        analog_time=np.arange(len(channels)) / 1000.0,
        analog=channels,
        plates=(plate,),
    )


def load(seed: int = 0):
    """Reactions on a subject in world axes at points of the plate's surface, with free moments about its normal."""
    rng = np.random.default_rng(seed)
    point = np.stack([rng.uniform(1.0, 1.4, 20), rng.uniform(2.0, 2.6, 20), np.full(20, 0.1)], axis=1)
    force = np.stack([rng.normal(size=20) * 100, rng.normal(size=20) * 100, rng.uniform(100, 1000, 20)], axis=1)
    free = np.stack([np.zeros(20), np.zeros(20), rng.normal(size=20) * 10], axis=1)
    return point, force, free


def channels(kind: int, point: np.ndarray, force: np.ndarray, free: np.ndarray, origin: np.ndarray) -> np.ndarray:
    """What a plate of each type would store for that load: the instrument's equations, forward."""
    R = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])  # plate axes in world
    p = (point - CORNERS.mean(axis=0)) @ R
    F, M = force @ R, free @ R
    if kind == 1:
        return np.concatenate([F, p[:, :2], M[:, 2:]], axis=1)
    if kind == 3:
        a, b, depth = origin
        M = np.cross(p + np.array([0.0, 0.0, depth]), F) + M  # about the plane of the sensors
        fy14 = F[:, 1] / 2 + M[:, 2] / (4 * a)
        fx12 = F[:, 0] / 2 - M[:, 2] / (4 * b)
        z = F[:, 2] / 4
        x, y = M[:, 0] / (4 * b), M[:, 1] / (4 * a)
        columns = [fx12, F[:, 0] - fx12, fy14, F[:, 1] - fy14, z + x - y, z + x + y, z - x + y, z - x - y]
        return np.stack(columns, axis=1)
    return np.concatenate([F, np.cross(p + origin, F) + M], axis=1)  # origin: from the transducer to the surface


@pytest.mark.parametrize(
    ("kind", "origin"),
    [
        (1, [0.0, 0.0, 0.0]),
        (2, [0.003, -0.002, -0.04]),
        (3, [0.12, 0.2, -0.05]),
        (4, [0.003, -0.002, -0.04]),
    ],
)
def test_every_type_reads_the_same_wrench(kind, origin):
    point, force, free = load()
    origin = np.array(origin)
    stored = channels(kind, point, force, free, origin)
    calibration = None
    if kind == 4:
        calibration = np.random.default_rng(3).normal(size=(6, 6))
        stored = stored @ np.linalg.inv(calibration).T
    plate = ForcePlate(kind, CORNERS, origin, tuple(range(stored.shape[1])), calibration)
    expected = np.concatenate([np.cross(point, force) + free, force], axis=1)
    accuracy = 1e-9 if kind == 4 else ROUNDING  # type 4 inverts a random 6 x 6 matrix
    np.testing.assert_allclose(plate_wrench(motion(stored, plate), plate), expected, rtol=0, atol=3000 * accuracy)


SINGLE = 2.0**-22
"""Relative; C3D stores 32-bit floats, and corners and channels are rounded apart."""

STORED = {
    1: ("N", "N", "N", "mm", "mm", "Nmm"),
    2: ("N", "N", "N", "Nmm", "Nmm", "Nmm"),
    3: ("N",) * 8,
    4: ("V",) * 6,
}
"""Units that the C3D manual has in a file whose lengths are in mm."""

ORIGIN = {1: [0.0, 0, 0], 2: [0.003, -0.002, -0.04], 3: [0.12, 0.2, -0.05], 4: [0.003, -0.002, -0.04]}


def through_a_file(path, kind: int, units: tuple[str, ...], unit: str = "mm") -> MotionFile:
    """The load stored by a plate of one type in a C3D file, read back."""
    origin = np.array(ORIGIN[kind])
    stored = channels(kind, *load(), origin)
    calibration = None
    if kind == 4:  # N and Nm of 6 V: a diagonal with cross-talk
        calibration = np.diag([100.0, 120, 400, 40, 50, 30]) + np.random.default_rng(3).uniform(-1, 1, (6, 6))
        stored = stored @ np.linalg.inv(calibration).T
    return read_c3d(
        write_c3d(
            path,
            marker_names=("A",),
            markers=np.zeros((10, 1, 3)),
            marker_rate=100.0,
            analog_names=tuple(f"c{index}" for index in range(len(units))),
            analog_units=units,
            analog=stored,
            analog_rate=200.0,
            plates=(ForcePlate(kind, CORNERS, origin, tuple(range(len(units))), calibration),),
            unit=unit,
        )
    )


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
@pytest.mark.parametrize("unit", ["mm", "m"])
def test_every_type_through_a_file(tmp_path, kind, unit):
    """Wrench and centre of pressure come back from a C3D file in the manual's units: N, mm, Nmm, V."""
    read = through_a_file(tmp_path / "a.c3d", kind, STORED[kind], unit)
    plate = read.plates[0]
    assert (plate.type, read.analog_units) == (kind, STORED[kind])
    wrench = plate_wrench(read, plate)
    point, force, free = load()
    expected = np.concatenate([np.cross(point, force) + free, force], axis=1)
    np.testing.assert_allclose(wrench, expected, rtol=0, atol=6000 * SINGLE)  # N and Nm: 1000 N at arms of 3 m, sums
    found, moment = centre_of_pressure(wrench[:, :3], wrench[:, 3:], plate_surface(plate))
    np.testing.assert_allclose(found, point, rtol=0, atol=60 * SINGLE)  # m: moments over at least 100 N
    np.testing.assert_allclose(moment, free, rtol=0, atol=6000 * SINGLE)


@pytest.mark.parametrize("kind", [1, 2])
def test_lengths_in_channels_without_a_unit_are_those_of_the_points(tmp_path, kind):
    """The manual states channels in POINT:UNITS; a file that leaves ANALOG:UNITS empty means mm and Nmm, too."""
    path = tmp_path / "a.c3d"
    stated = through_a_file(path, kind, STORED[kind])
    data = path.read_bytes()
    start = data.index(b"UNITS", data.index(b"ANALOG")) + len(b"UNITS") + 2
    assert data[start : start + 2] == b"\xff\x02"  # text with two dimensions
    width, count = data[start + 2 : start + 4]
    first, last = start + 4 + 3 * width, start + 4 + count * width
    path.write_bytes(data[:first] + b" " * (last - first) + data[last:])
    read = read_c3d(path)
    assert read.analog_units == (*STORED[kind][:3], "", "", "")
    assert f"force plate 1 of type {kind}: lengths in its channels state no unit and are taken as mm" in read.notes
    np.testing.assert_allclose(
        plate_wrench(read, read.plates[0]), plate_wrench(stated, stated.plates[0]), rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize("kind", [2, 3, 4])
def test_a_positive_depth_in_a_file_is_turned_round(tmp_path, kind):
    right = through_a_file(tmp_path / "a.c3d", kind, STORED[kind])
    flipped = dataclasses.replace(right.plates[0], origin=right.plates[0].origin * [-1.0, -1.0, -1.0])
    if kind == 3:  # a and b are distances; only the depth has a sign
        flipped = dataclasses.replace(right.plates[0], origin=right.plates[0].origin * [1.0, 1.0, -1.0])
    np.testing.assert_array_equal(plate_wrench(right, flipped), plate_wrench(right, right.plates[0]))


def test_plates_of_several_types_share_a_file(tmp_path):
    """Six and eight channels side by side: the shorter list is padded with channel 0, as the manual has it."""
    stored = np.concatenate([channels(kind, *load(), np.array(ORIGIN[kind])) for kind in (1, 3, 2)], axis=1)
    plates = (
        ForcePlate(1, CORNERS, np.array(ORIGIN[1]), tuple(range(6))),
        ForcePlate(3, CORNERS, np.array(ORIGIN[3]), tuple(range(6, 14))),
        ForcePlate(2, CORNERS, np.array(ORIGIN[2]), tuple(range(14, 20))),
    )
    path = write_c3d(
        tmp_path / "a.c3d",
        marker_names=("A",),
        markers=np.zeros((10, 1, 3)),
        marker_rate=100.0,
        analog_names=tuple(f"c{index}" for index in range(20)),
        analog_units=STORED[1] + STORED[3] + STORED[2],
        analog=stored,
        analog_rate=200.0,
        plates=plates,
    )
    read = read_c3d(path)
    first, *others = (plate_wrench(read, plate) for plate in read.plates)
    for other in others:
        np.testing.assert_allclose(other, first, rtol=0, atol=6000 * SINGLE)


def test_an_origin_of_the_wrong_sign_is_turned_round():
    point, force, free = load()
    origin = np.array([0.003, -0.002, -0.04])
    stored = channels(2, point, force, free, origin)
    right = ForcePlate(2, CORNERS, origin, tuple(range(6)))
    wrong = dataclasses.replace(right, origin=-origin)
    np.testing.assert_array_equal(
        plate_wrench(motion(stored, right), right), plate_wrench(motion(stored, wrong), wrong)
    )


def test_the_frame_of_a_tilted_plate():
    """Corners turned by any rotation turn the axes with them."""
    rng = np.random.default_rng(0)
    Q = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    Q *= np.sign(np.linalg.det(Q))
    R, p = plate_frame(ForcePlate(2, CORNERS, np.zeros(3), tuple(range(6))))
    turned, centre = plate_frame(ForcePlate(2, CORNERS @ Q.T, np.zeros(3), tuple(range(6))))
    np.testing.assert_allclose(turned, Q @ R, atol=ROUNDING)
    np.testing.assert_allclose(centre, Q @ p, atol=ROUNDING)
    np.testing.assert_allclose(R[:, 2], [0.0, 0.0, -1.0], atol=ROUNDING)


def test_plates_that_cannot_be_used():
    stored = np.zeros((3, 6))
    plate = ForcePlate(4, CORNERS, np.zeros(3), tuple(range(6)))
    with pytest.raises(FileError, match="type 4 has no calibration"):
        plate_wrench(motion(stored, plate), plate)
    plate = ForcePlate(6, CORNERS, np.zeros(3), tuple(range(6)))
    with pytest.raises(FileError, match="type 6 are not supported"):
        plate_wrench(motion(stored, plate), plate)
    line = np.linspace(0, 1, 4)[:, None] * np.ones((1, 3))
    with pytest.raises(ValueError, match="lie on one line"):
        plate_frame(ForcePlate(2, line, np.zeros(3), tuple(range(6))))


def test_opensim_finds_the_same_wrench(shared_data):
    """Its reference holds force, surface centre and moment about that centre in N, mm, Nmm, every 100th sample."""
    folder = shared_data / "opensim_core_gait" / "c3d"
    ours, theirs = read_c3d(folder / "walking2.c3d"), read_sto(folder / "std_walking2_grfs.sto")
    samples = np.append(np.arange(0, 10000, 100), 9991)
    printed = 0.51e-8  # N, mm, Nmm: eight decimals
    for index, plate in enumerate(ours.plates):
        wrench = plate_wrench(ours, plate)[samples]
        centre = plate_frame(plate)[1]
        moment = wrench[:, :3] - np.cross(centre[None, :], wrench[:, 3:])
        expected = theirs.analog[:, 9 * index : 9 * index + 9]
        np.testing.assert_allclose(wrench[:, 3:], expected[:, :3], rtol=0, atol=printed)
        np.testing.assert_allclose(centre * 1e3, expected[0, 3:6], rtol=0, atol=printed)
        np.testing.assert_allclose(moment * 1e3, expected[:, 6:], rtol=0, atol=printed)
