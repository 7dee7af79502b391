"""Force plates of every supported type read the same wrench, and OpenSim's on its own file."""

import dataclasses

import numpy as np
import pytest

from icjax.capture._plates import plate_frame, plate_wrench
from icjax.files import FileError, ForcePlate, MotionFile, read_c3d, read_sto

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
