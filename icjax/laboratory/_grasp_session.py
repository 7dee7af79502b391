"""Record a session of grasps: C3D files, a session file with the hand's model, and the truth apart from them."""

import dataclasses
import json
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from icjax.files import FileError, write_c3d
from icjax.laboratory._dynamics import ANALOG_RATE
from icjax.laboratory._free_object import FreeObject
from icjax.laboratory._gait import Gait
from icjax.laboratory._grasp import GraspMotion, GraspTruth, simulate_grasp
from icjax.laboratory._hand import FINGERS, Hand
from icjax.laboratory._hand_model import described_xml
from icjax.laboratory._instruments import Markers, Noise, cameras, films, place, restless_hand
from icjax.laboratory._lift import Lift, lift_command
from icjax.laboratory._movement import RATE
from icjax.laboratory._record import Paths, Progress

OBJECTS = (
    FreeObject("light_box"),
    FreeObject("heavy_box", mass=0.150),
    FreeObject("wedge", shape="wedge", taper=float(np.radians(8.0))),
    FreeObject("sphere", shape="sphere", size=(0.044,)),
    FreeObject("cylinder", shape="cylinder", size=(0.040, 0.060)),
    FreeObject("slippery_box", mass=0.150, friction=0.25),
)
"""What `grasp_session` lets the hand lift unless told otherwise; the slippery box falls."""


def grasp_session(
    folder: str | os.PathLike,
    *,
    seed: int,
    objects: Sequence[FreeObject] = OBJECTS,
    hand: Hand | None = None,
    lift: Lift | None = None,
    noise: Noise | None = None,
    timestep: float = 0.00025,
    progress: Progress | None = None,
) -> Paths:
    """Let a simulated hand grasp and lift objects, one a trial, and record it as a motion-capture studio would.

    Writes `NAME.c3d` of every object (markers; a film sensor `Fn_<finger>` on every fingertip, the normal force),
    `session.toml`, `hand.xml` (lengths, joint axes, nominal markers and pads) and `truth/`. The hand is a dynamic
    MuJoCo model, M q'' + h + B q' + K q = tau_ff + K theta_plan + B theta_plan' + J^T f, its fingertips sprung spheres
    with Coulomb friction; nothing of it is shared with the estimators. Its command is the same for every object but for
    variation and tremor: it aims at a distance of thumb and fingers below the object's width, and compliance makes the
    force. Whether an object rises is physics. The same seed gives the same data.

    **Arguments**

    - `seed`: of everything random.
    - `objects`: one a trial, each with a name of its own.
    - `hand`: the subject. `lift`: the movement.
    - `noise`: of instruments and subject; the default is a good studio.
    - `timestep`: of the simulation, s; a whole fraction of a millisecond, at most 0.5 ms.
    - `progress`: called with the fraction done after every recording.

    **Returns** the paths written. **Errors**: `ValueError` naming the argument and its value; `FileError` where a
    file cannot be written; `RuntimeError` where the simulation diverges. Nothing is written before the movement is
    known to be within reach.
    """
    if not (0 <= seed < 2**63):
        raise ValueError(f"seed must be between 0 and {2**63 - 1}, got {seed}")
    names = [thing.name for thing in objects]
    if not names:
        raise ValueError("objects must name one object at least, got none")
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"objects must have names of their own, got '{name}' twice")
    lift = Lift() if lift is None else lift
    for thing in objects:
        if thing.width >= lift.open:
            raise ValueError(
                f"object '{thing.name}' is {thing.width} m wide; the hand opens to {lift.open} m (open of lift)"
            )
    check_timestep(timestep)
    noise = Noise() if noise is None else noise
    hand = Hand() if hand is None else hand
    placed = place(hand.markers(), noise, np.random.default_rng([seed, 0]))
    gain = 1.0 + noise.film_gain * np.random.default_rng([seed, 1]).standard_normal(len(FINGERS))
    planned = lift_command(hand, lift)

    folder = Path(folder)
    truth = folder / "truth"
    trials, truths = [], []
    for trial, thing in enumerate(objects):
        generator = np.random.default_rng([seed, 2, trial])
        motion = simulate_grasp(hand, thing, restless_hand(planned, noise, generator), placed, timestep)
        trials.append(_write(folder / f"{thing.name}.c3d", motion, gain, noise, generator))
        truths.append(motion.truth.save(truth / f"{thing.name}.npz"))
        if progress is not None:
            progress((trial + 1) / len(objects))
    truths.append(write_hand(truth, seed, hand, objects, lift, timestep, placed, {"film_gain": gain.tolist()}))
    (folder / "hand.xml").write_text(described_xml(hand, folder.name or "laboratory"))
    session = folder / "session.toml"
    session.write_text(grasp_text(folder.name, hand, noise, objects))
    return Paths(session=session, trials=tuple(trials), catches=(), truth=tuple(truths))


def check_timestep(timestep: float) -> None:
    """**Errors**: `ValueError` unless frames and samples are whole numbers of steps."""
    part = 1e-3 / timestep if timestep > 0.0 else 0.0
    if not (part >= 2.0 - 1e-9 and abs(part - round(part)) < 1e-9):
        raise ValueError(f"timestep must be a whole fraction of 0.001 s, at most 0.0005 s, got {timestep}")


def regrasp(folder: str | os.PathLike, trial: str, thing: FreeObject) -> GraspTruth:
    """Run the command of a recorded grasp on another object: the judge of a transfer.

    Hand, commanded movement, tremor and sway are those of the recording. With the recorded object the result is the
    recorded truth itself.

    **Arguments**

    - `folder`: given to `grasp_session`.
    - `trial`: name of the recording.
    - `thing`: to be grasped instead.

    **Returns** the truth with that object. **Errors**: `FileError` where the truth of the recording is missing.
    """
    path = Path(folder) / "truth" / "hand.json"
    if not path.is_file():
        raise FileError(path, "does not exist: grasping again needs the truth of a recorded session")
    content = json.loads(path.read_text())
    recorded = load_grasp(Path(folder) / "truth" / f"{trial}.npz")
    hand = Hand(**{**content["hand"], "compliance": tuple(content["hand"]["compliance"])})
    return simulate_grasp(hand, thing, recorded.command, {}, content["timestep"]).truth


def load_grasp(path: str | os.PathLike) -> GraspTruth:
    """Read a truth that `grasp_session` or `GraspTruth.save` wrote. **Errors**: `FileError` naming the file."""
    path = Path(path)
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        with np.load(path) as archive:
            values = {field.name: archive[field.name] for field in dataclasses.fields(GraspTruth)}
    except (OSError, ValueError, KeyError) as error:
        raise FileError(path, f"is no truth of a grasp: {error}") from error
    values["mu"], values["pad_stiffness"] = float(values["mu"]), float(values["pad_stiffness"])
    return GraspTruth(**values)


def grasp_text(name: str, hand: Hand, noise: Noise, objects: Sequence[FreeObject]) -> str:
    """TOML text that describes the session.

    The object's faces lie across x and the thumb is on the near side: the force on it points along -x, that on the
    fingers along +x.
    """
    lines = session_head(name, hand, noise)
    for finger in FINGERS:
        lines += ["", "[[source]]", f'name = "{finger}"', 'kind = "normal"', f'channels = ["Fn_{finger}"]']
        lines += ['frame = "world"', f"normal = [{-1.0 if finger == 'thumb' else 1.0}, 0.0, 0.0]", "tare = [0.0, 0.2]"]
    touches = ", ".join(f'{finger} = "{finger}"' for finger in FINGERS)
    for thing in objects:
        lines += ["", "[[trial]]", f'name = "{thing.name}"', f'file = "{thing.name}.c3d"']
        lines += [f"touches = {{ {touches} }}", f"friction = {thing.friction!r}"]
    return "\n".join(lines) + "\n"


def session_head(name: str, hand: Hand, noise: Noise) -> list[str]:
    """Lines of the session file about model and markers."""
    return [
        "# Simulated by icjax.laboratory: no person was measured.",
        f'name = "{name or "laboratory"}"',
        'subject = "simulated"',
        "simulated = true",
        "",
        "[model]",
        'file = "hand.xml"',
        *([f"placement_sd = {noise.placement!r}"] if noise.placement > 0.0 else []),
        "",
        "[markers]",
        *(f'{label} = "{label}"' for label in hand.markers()),
    ]


def _write(path: Path, motion: GraspMotion, gain: np.ndarray, noise: Noise, generator: np.random.Generator) -> Path:
    return write_c3d(
        path,
        marker_names=list(motion.marker_names),
        markers=cameras(motion.marker_names, motion.markers, noise, generator),
        marker_rate=RATE,
        analog_names=[f"Fn_{finger}" for finger in FINGERS],
        analog_units=["N"] * len(FINGERS),
        analog=films(motion.pressed, gain, noise, generator),
        analog_rate=ANALOG_RATE,
    )


def write_hand(
    truth: Path,
    seed: int,
    hand: Hand,
    objects: Sequence[FreeObject],
    lift: Lift | Gait,
    timestep: float,
    placed: Markers,
    instruments: dict[str, Any],
) -> Path:
    """What the subject and the instruments truly are, as JSON."""
    path = truth / "hand.json"
    content = {
        "seed": seed,
        "hand": dataclasses.asdict(hand),
        "objects": [dataclasses.asdict(thing) for thing in objects],
        "lift": dataclasses.asdict(lift),
        "timestep": timestep,
        **instruments,
        "markers": {label: [body, list(position)] for label, (body, position) in placed.items()},
    }
    path.write_text(json.dumps(content, indent=1))
    return path
