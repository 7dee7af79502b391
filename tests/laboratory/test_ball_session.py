"""The ball that measures pressure: its map against the forces that press on it, and its files."""

import dataclasses

import numpy as np
import pytest

from icjax.capture import ball_contacts, ball_pose, read_ball, read_session
from icjax.files import read_c3d, read_csv
from icjax.laboratory import Hand, Lift, Noise, PressureBall, ball_session, load_grasp
from icjax.laboratory._hand import FINGERS
from icjax.laboratory._pressure_ball import measured, pressure_map

SHORT = Lift(grip=0.032, open=0.056, height=0.01, roll=0.008, rest=0.3, close=0.4, settle=0.1, rise=0.2, hold=0.8)
COARSE = 0.0005


@pytest.fixture(scope="module")
def rolled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("laboratory") / "ball"
    return folder, ball_session(folder, seed=2, lift=SHORT, timestep=COARSE)


def turn(truth) -> np.ndarray:
    """Of the ball against its place at the start, rad."""
    return 2.0 * np.arccos(np.clip(np.abs(truth.object_pose[:, 3]), 0.0, 1.0))


def test_the_ball_is_held_and_rolled_there_and_back(rolled):
    """By opposite shifts of 8 mm about a ball of 54 mm: twenty degrees and more beyond the tilt of the lift."""
    folder, _ = rolled
    truth = load_grasp(folder / "truth" / "ball.npz")
    held = truth.t > 1.0
    assert np.all(truth.f_normal[held, 0] > 0.5)
    assert truth.object_pose[-1, 2] > truth.object_pose[0, 2] + 0.005
    angle = turn(truth)
    start, middle, end = (angle[np.argmin(np.abs(truth.t - time))] for time in (1.0, 1.38, 1.8))
    assert middle > start + np.radians(15.0)
    assert abs(end - start) < np.radians(5.0)


def test_the_map_holds_the_force_and_its_place(rolled):
    """Each patch sums to the normal force exactly; its centre lies within a third of the pitch of the cells (5 mm)."""
    folder, _ = rolled
    truth = load_grasp(folder / "truth" / "ball.npz")
    ball = PressureBall()
    time, pressure = pressure_map(ball, Hand(), truth)
    np.testing.assert_allclose(np.diff(time), 0.02, atol=1e-12)
    frames = np.round(time * 500.0).astype(int)
    np.testing.assert_allclose(pressure.sum(axis=1) * ball.area, truth.f_normal[frames].sum(axis=1), rtol=1e-9)
    spec = read_ball(folder / "ball.toml")
    R, p = ball_pose(spec, read_c3d(folder / "ball.c3d"), 20.0)
    local = np.einsum("fji,fkj->fki", R, truth.pad - p[:, None])[frames]
    radii = np.array([Hand().pad(finger)[1] for finger in FINGERS])
    found = ball_contacts(spec, pressure * ball.area, local, radii, np.full(ball.cells, 1e-3))
    np.testing.assert_allclose(found.pressed, truth.f_normal[frames], atol=0.03)
    world = np.einsum("fij,fkj->fki", R[frames], found.point) + p[frames, None]
    error = np.linalg.norm(world - truth.point[frames], axis=2)[truth.f_normal[frames] > 0.3]
    assert len(error) > 100
    assert np.sqrt(np.mean(error**2)) < 0.0015
    assert found.elsewhere.max() < 0.03


def test_cells_have_gain_noise_steps_and_saturate():
    ball = PressureBall(cells=20, noise=100.0, step=50.0, largest=1000.0)
    generator = np.random.default_rng(0)
    gain = np.linspace(0.9, 1.1, 20)
    shown = measured(ball, np.full((4000, 20), 500.0), gain, generator)
    np.testing.assert_allclose(shown.mean(axis=0), 500.0 * gain, atol=8.0)  # 100 / sqrt(4000) = 1.6 Pa, five of them
    assert shown.std() == pytest.approx(np.sqrt(100.0**2 + 50.0**2 / 12.0 + (500.0 * gain).var()), rel=0.03)
    np.testing.assert_array_equal(shown % 50.0, 0.0)
    assert measured(ball, np.full((1, 20), 5000.0), gain, generator).max() == 1000.0
    assert measured(ball, np.zeros((100, 20)), gain, generator).min() == 0.0


def test_files_rates_and_labels(rolled):
    folder, paths = rolled
    names = {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}
    files = {"session.toml", "hand.xml", "ball.c3d", "ball_pressure.csv", "ball.toml", "cells.csv"}
    assert names == files | {"truth/ball.npz", "truth/hand.json"}
    assert paths.trials == (folder / "ball.c3d",)
    motion = read_c3d(paths.trials[0])
    assert set(motion.marker_names) == set(Hand().markers()) | {f"BALL{number}" for number in range(1, 6)}
    pressure = read_csv(folder / "ball_pressure.csv")
    assert pressure.analog_rate == pytest.approx(50.0)
    assert pressure.analog.shape == (len(pressure.analog_time), 400)
    spec = read_session(paths.session)
    assert [(trial.name, trial.touches, trial.friction) for trial in spec.trials] == [("ball", (), 0.8)]
    ball = read_ball(folder / "ball.toml")
    assert sum(cell.scale for cell in ball.cells) == pytest.approx(4.0 * np.pi * ball.radius**2, rel=1e-6)


def test_pose_of_the_ball_from_its_markers(rolled):
    """Markers misplaced by 0.3 mm leave half a millimetre and two degrees."""
    folder, _ = rolled
    truth = load_grasp(folder / "truth" / "ball.npz")
    R, p = ball_pose(read_ball(folder / "ball.toml"), read_c3d(folder / "ball.c3d"), 20.0)
    assert np.linalg.norm(p - truth.object_pose[:, :3], axis=1).max() < 1e-3
    cosine = 0.5 * (np.trace(R, axis1=1, axis2=2) - 1.0)
    found = np.arccos(np.clip(cosine, -1.0, 1.0))
    np.testing.assert_allclose(found, turn(truth), atol=np.radians(2.0))


def test_same_seed_same_data(rolled, tmp_path):
    folder, _ = rolled
    ball_session(tmp_path / "b", seed=2, lift=SHORT, timestep=COARSE)
    for name in ("ball.c3d", "ball_pressure.csv", "truth/ball.npz", "cells.csv"):
        assert (folder / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"cells": 3}, "cells"),
        ({"rate": 30.0}, "rate"),
        ({"gain": -0.1}, "gain"),
        ({"noise": float("nan")}, "noise"),
        ({"step": -1.0}, "step"),
        ({"largest": 0.0}, "largest"),
        ({"mass": 0.0}, "mass"),
        ({"diameter": 1.0}, "size"),
    ],
)
def test_bad_balls_name_the_argument(arguments, word):
    with pytest.raises(ValueError, match=word):
        PressureBall(**arguments)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"seed": -1}, "seed"),
        ({"timestep": 0.01}, "timestep"),
        ({"ball": PressureBall(diameter=0.08)}, "diameter"),
        ({"lift": dataclasses.replace(SHORT, open=0.1)}, "cannot reach"),
    ],
)
def test_bad_sessions_write_nothing(tmp_path, arguments, word):
    with pytest.raises(ValueError, match=word):
        ball_session(tmp_path / "s", **{"seed": 0, "noise": Noise.none(), **arguments})
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(("arguments", "word"), [({"roll": 0.05}, "roll"), ({"roll": 0.01, "hold": 0.2}, "hold")])
def test_bad_rolls(arguments, word):
    with pytest.raises(ValueError, match=word):
        Lift(**arguments)
