"""Figure 13 (f, g) of Kry and Pai (2006): a ball that measures pressure is turned by finger gaiting, then a light bulb.

    python experiments/kry_pai_2006/figure13_bulb.py [--cache DIR] [--main-only]

- (f) A simulated hand lifts the ball out of its stand and turns it in the air: five strokes of all fingers; between
  two of them the index finger, then the little finger, then thumb, middle and ring finger let go, go back and grip
  again. Captured are markers and the map of pressure.
- Compliances are estimated from another session of the same hand, grasps with sensors on the fingertips. Joints that
  it does not excite get the median of those that it does.
- (g) With these, the capture of the ball becomes an interaction trajectory and meets a light bulb: a free body that
  stands on a table on its cap. It must be lifted and turned by 90 degrees at least, without ever leaving the hand.

Beside it: other compliances, friction left out of the recording, other bulbs, another capture. Simulated data (MuJoCo,
independently of icjax); no person was measured. Writes figure13_bulb.png and figure13_bulb.json.
"""

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np
import tyro
from figure13_bulb_drawing import Course, drawn
from scipy.spatial.transform import Rotation
from virtual_sessions import RESULTS, SIMULATED, write

from icjax.capture import ball_pose, ball_recording, capture, read_ball, read_session
from icjax.estimation import EstimationOptions, estimate
from icjax.files import read_c3d, read_csv
from icjax.geometry import Cylinder, Placed, Plane, Sphere, Union
from icjax.interaction import Interaction
from icjax.laboratory import HAND_JOINTS, Gait, Hand, ball_session, grasp_session, load_grasp
from icjax.recording import Recording, Session
from icjax.rollout import Rollout
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, transfer
from icjax.view import save

GAIT = Gait()

TABLE_FRICTION = 0.6

HELD = 0.010
"""m; the middle of the glass stays so far above where it stood."""

NECK, CAP = (0.0160, 0.012, -0.030), (0.0133, 0.010, -0.052)
"""Cylinders of the bulb: radius, half length, height of the middle against that of the glass, m."""


@dataclasses.dataclass(frozen=True)
class Config:
    """`cache` keeps what was simulated and captured; `main_only` leaves out all transfers but the one of the figure."""

    seed: int = 3
    cache: Path | None = None
    main_only: bool = False
    out: Path = RESULTS


def captured(
    folder: Path, seed: int
) -> tuple[Recording, Recording, tuple[np.ndarray, np.ndarray], dict[str, np.ndarray]]:
    """Ball with friction from its balance and without, its pose, and the truth that judges, simulated if need be."""
    here = folder / f"ball{seed}"
    if not (here / "session.toml").exists():
        ball_session(here, seed=seed, lift=GAIT)
    motion, ball, pressure = (
        read_c3d(here / "ball.c3d"),
        read_ball(here / "ball.toml"),
        read_csv(here / "ball_pressure.csv"),
    )
    hand = stored(folder / f"hand{seed}.nc", here).recordings[0]
    full = ball_recording(hand, motion, ball, pressure)
    normal = ball_recording(hand, motion, dataclasses.replace(ball, mass=None), pressure)
    truth = load_grasp(here / "truth" / "ball.npz")
    return full, normal, ball_pose(ball, motion, 20.0), vars(truth)


def stored(path: Path, folder: Path) -> Session:
    """A captured session, from its file or from the folder of its recording."""
    if not path.exists():
        capture(read_session(folder / "session.toml")).save(path)
    return Session.load(path)


def estimated(folder: Path, seed: int) -> tuple[dict[str, float], list[str]]:
    """Compliance of every joint from grasps of the same hand, rad/Nm, and the joints whose own estimate it is."""
    here = folder / f"grasps{seed}"
    if not (here / "session.toml").exists():
        grasp_session(here, seed=seed)
    summary = estimate(stored(folder / f"grasps{seed}.nc", here))[0].summary
    rows = zip(summary.joint_names, np.asarray(summary.compliance), np.asarray(summary.upper), strict=True)
    good = {name: float(value) for name, value, upper in rows if np.isfinite(value) and (upper - value) / 1.96 < value}
    middle = float(np.median(list(good.values())))
    return {joint: good.get(joint, middle) for joint in HAND_JOINTS}, list(good)


def interaction_of(recording: Recording, compliance: dict[str, float]) -> Interaction:
    """With given compliances; the forearm is driven along its path. Pads as stiff as the laboratory makes them."""
    given = compliance | {f"forearm_{axis}": 0.0 for axis in "xyz"}
    found = estimate(Session(recording.name, "", (recording,)), EstimationOptions(given=given))[0]
    model = dataclasses.replace(found.model, pad_compliance=np.full(5, 1.0 / Hand().pad_stiffness))
    return dataclasses.replace(found, model=model)


def bulb_scene(height: float, radius: float = 0.027, mass: float = 0.035, friction: float = 0.8) -> Scene:
    """A bulb on a table, its glass (a shell of 60 % of the mass) at a height; neck and cap carry the rest."""
    parts = [Sphere(radius)]
    for size, half, middle in (NECK, CAP):
        parts.append(Placed(Cylinder(size, half), Pose(np.eye(3), np.array([0.0, 0.0, middle - (radius - 0.027)]))))
    foot = CAP[2] - CAP[1] - (radius - 0.027)
    glass, base = 0.6 * mass, 0.4 * mass
    low, long = CAP[2] + 0.004 - (radius - 0.027), 0.028
    com = np.array([0.0, 0.0, low * base / mass])
    across = 2 / 3 * glass * radius**2 + glass * com[2] ** 2
    across += base * (CAP[0] ** 2 / 4 + long**2 / 12) + base * (low - com[2]) ** 2
    along = 2 / 3 * glass * radius**2 + base * CAP[0] ** 2 / 2
    place = Pose(np.eye(3), np.array([0.0, 0.0, height]))
    inertia = np.diag([across, across, along])
    bulb = Object("bulb", Union(parts), friction, mass=mass, com=com, inertia=inertia, pose=place)
    table = Plane(np.array([0.0, 0.0, height + foot]), np.array([0.0, 0.0, 1.0]))
    return Scene("bulb", (Surface("table", table, TABLE_FRICTION),), objects=(bulb,), contacts=12)


def course(time: Any, rotation: np.ndarray, position: np.ndarray, force: np.ndarray) -> Course:
    """Turn about the vertical (the twist of swing and twist) and tilt, rad; normal forces on fingers, N."""
    turn = np.arctan2(rotation[:, 1, 0] - rotation[:, 0, 1], rotation[:, 0, 0] + rotation[:, 1, 1])
    tilt = np.arccos(np.clip(rotation[:, 2, 2], -1.0, 1.0))
    return Course(np.asarray(time) - float(time[0]), rotation, position, np.unwrap(turn), tilt, force)


def seen_ball(recording: Recording, pose: tuple[np.ndarray, np.ndarray]) -> Course:
    """Of the ball as captured, from a recording of its normal forces."""
    return course(recording.time, *pose, np.linalg.norm(np.asarray(recording.contact_force), axis=2))


def course_of(rollout: Rollout) -> Course:
    """Of the bulb."""
    slots = [rollout.slot_names.index(f"{pad}/bulb") for pad in rollout.model.pad_names]
    normal = np.sum(np.asarray(rollout.contact_force) * np.asarray(rollout.contact_normal), axis=2)[:, slots]
    rotation = Rotation.from_quat(np.asarray(rollout.object_quaternion)[:, 0][:, [1, 2, 3, 0]]).as_matrix()
    return course(rollout.time, rotation, np.asarray(rollout.object_position)[:, 0], normal)


def judged(found: Course) -> dict[str, Any]:
    """Whether it was held from the first stroke to the end, and how far it turned until then or until it fell."""
    gaiting = found.time >= GAIT.starts[0]
    fallen = gaiting & (found.position[:, 2] < found.position[0, 2] + HELD)
    last = int(np.argmax(fallen)) - 1 if fallen.any() else -1
    touching = np.sum(found.force > 0.05, axis=1)
    return {
        "dropped": bool(fallen.any()),
        "held until s": float(found.time[last]),
        "turn deg": float(np.degrees(found.turn[last])),
        "turn about its own axis deg": float(np.degrees(spun(found.rotation[: last % len(found.time) + 1]))),
        "largest tilt deg": float(np.degrees(found.tilt[: last % len(found.time) + 1].max())),
        "fewest fingers that hold": int(touching[gaiting][: np.argmax(fallen[gaiting]) or None].min()),
        "largest finger force N": float(found.force.max()),
    }


def spun(rotation: np.ndarray) -> float:
    """About the z axis of the thing itself, rad: the sum of small steps."""
    step = np.einsum("tji,tjk->tik", rotation[:-1], rotation[1:])
    return 0.5 * float(np.sum(step[:, 1, 0] - step[:, 0, 1]))


def synthesised(rollout: Rollout, ball: Course) -> dict[str, Any]:
    """`judged`, how far the glass is from where the ball was, and what the solver and the contacts say."""
    slots = [rollout.slot_names.index(f"{pad}/bulb") for pad in rollout.model.pad_names]
    state = np.asarray(rollout.slip_state)[:, slots]
    sliding = [float(np.sum(column == 2) / max(np.sum(column > 0), 1)) for column in state.T]
    bulb = course_of(rollout)
    gaiting = (bulb.time >= GAIT.starts[0]) & (bulb.position[:, 2] >= bulb.position[0, 2] + HELD)
    there = np.stack([np.interp(bulb.time, ball.time, column) for column in ball.position.T], axis=1)
    return judged(bulb) | {
        "glass from ball mm RMS": 1e3 * root(np.linalg.norm(bulb.position - there, axis=1)[gaiting]),
        "unsolved steps": int(np.sum(np.asarray(rollout.status) > 0)),
        "steps": len(rollout.time),
        "share of touching time that a finger slides": dict(zip(rollout.model.pad_names, sliding, strict=True)),
    }


def errors(recording: Recording, truth: dict[str, np.ndarray]) -> dict[str, Any]:
    """Of the captured contacts while the ball is in the air."""
    air = np.asarray(recording.time) >= GAIT.starts[0]
    force, true = np.asarray(recording.contact_force)[air], truth["f_contact"][air]
    outward = truth["point"] - truth["object_pose"][:, None, :3]
    outward = np.nan_to_num(outward / np.linalg.norm(outward, axis=2, keepdims=True))[air]
    away = np.linalg.norm(np.asarray(recording.contact_point) - truth["point"], axis=2)[air]
    return {
        "force on a finger N RMS": root(np.linalg.norm(true, axis=2)),
        "error of it N RMS": root(np.linalg.norm(force - true, axis=2)),
        "error of its normal part N RMS": root(np.sum((force - true) * outward, axis=2)),
        "error of the contact point mm RMS": 1e3 * root(away[np.isfinite(away) & (truth["f_normal"][air] > 0.3)]),
    }


def root(values: np.ndarray) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def main(config: Config) -> dict[str, Any]:
    """Record, capture, estimate, transfer, draw, write."""
    jax.config.update("jax_enable_x64", True)
    with tempfile.TemporaryDirectory() as temporary:
        folder = config.cache or Path(temporary)
        full, normal, (R, p), truth = captured(folder, config.seed)
        compliance, own = estimated(folder, config.seed + 1)
        others = [] if config.main_only else [captured(folder, config.seed + step) for step in (100, 200)]
    true = dict(zip(HAND_JOINTS, Hand().compliance, strict=True))
    height = float(np.median(p[:100, 2]))
    plain = bulb_scene(height)
    quaternion = truth["object_pose"][:, [4, 5, 6, 3]]
    real = course(
        truth["t"], Rotation.from_quat(quaternion).as_matrix(), truth["object_pose"][:, :3], truth["f_normal"]
    )
    seen = seen_ball(normal, (R, p))
    rollout = transfer(interaction_of(full, compliance), plain)
    result: dict[str, Any] = {
        "data": SIMULATED,
        "compliance rad/Nm": compliance,
        "of which estimated, the others their median": own,
        "f: ball, truth": judged(real),
        "f: ball, captured": judged(seen),
        "capture, friction balanced": errors(full, truth),
        "capture, normal forces only": errors(normal, truth),
        "g: bulb": synthesised(rollout, seen),
        "variations": {},
    }
    print(result)
    save(drawn(full, seen, rollout, course_of(rollout), (0.027, NECK, CAP), GAIT), config.out / "figure13_bulb.png")
    double, half = ({joint: factor * value for joint, value in true.items()} for factor in (2.0, 0.5))
    cases: dict[str, tuple[Recording, dict[str, float], Scene]] = {
        "true compliance": (full, true, plain),
        "half the true compliance": (full, half, plain),
        "twice the true compliance": (full, double, plain),
        "normal forces only": (normal, compliance, plain),
        "glass of 56 mm": (full, compliance, bulb_scene(height, radius=0.028)),
        "bulb of 70 g": (full, compliance, bulb_scene(height, mass=0.070)),
        "friction 0.6": (full, compliance, bulb_scene(height, friction=0.6)),
    }
    tracks = dict.fromkeys(cases, seen)
    for number, (recording, normal, pose, _) in enumerate(others):
        name = f"another capture, {number + 1}"
        cases[name], tracks[name] = (recording, compliance, plain), seen_ball(normal, pose)
    for name, (recording, values, scene) in ({} if config.main_only else cases).items():
        result["variations"][name] = synthesised(transfer(interaction_of(recording, values), scene), tracks[name])
        print(name, result["variations"][name])
    write(config.out / "figure13_bulb.json", result)
    return result


if __name__ == "__main__":
    main(tyro.cli(Config))
