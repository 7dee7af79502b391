"""Record a session: C3D files, a session file, and the truth apart from them."""

import dataclasses
import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from icjax.files import write_c3d
from icjax.laboratory._dynamics import ANALOG_RATE, Motion, simulate
from icjax.laboratory._instruments import Noise, cameras, place, restless, sensor
from icjax.laboratory._movement import RATE, command, duration, plan
from icjax.laboratory._session import session_text
from icjax.laboratory._subject import Subject
from icjax.laboratory._surface import Bump, Surface

CATCH_LOWERED = 0.12
"""How far the plate is lowered for a catch trial, m."""

CHANNELS = ("Fx", "Fy", "Fz", "Tx", "Ty", "Tz", "SYNC")
UNITS = ("N", "N", "N", "Nm", "Nm", "Nm", "V")

Progress = Callable[[float], object]
"""Called with the fraction of the runs done, 0 to 1."""


@dataclasses.dataclass(frozen=True)
class Paths:
    """What was written: `session` is the file to hand to the capture; `truth` is for judging only."""

    session: Path
    trials: tuple[Path, ...]
    catches: tuple[Path, ...]
    truth: tuple[Path, ...]


def record(
    folder: str | os.PathLike,
    *,
    seed: int,
    trials: int = 2,
    contacts: int = 3,
    hand_length: float = 0.190,
    compliance: tuple[float, float, float, float] = (0.25, 0.70, 0.45, 1.10),
    damping_time: float = 0.018,
    friction: float = 0.6,
    catch: int = 1,
    bump: Bump | None = None,
    height: float = 0.0,
    noise: Noise | None = None,
    progress: Progress | None = None,
) -> Paths:
    """Let a simulated subject tap and stroke a plate and record it as a motion-capture studio would.

    Writes `trialNN.c3d`, `catchNN.c3d` (and `catchNN_2.c3d`, ...: the same movement with the plate lowered out of
    reach), `session.toml` and `truth/`. The subject is a dynamic MuJoCo model, M q'' + h + B q' + K q = tau_ff +
    K theta_plan + B theta_plan' + J^T f; nothing of it is shared with the estimators. The same seed gives the same
    data.

    **Arguments**

    - `seed`: of everything random.
    - `trials`, `contacts`: recordings and contacts in each, taps and strokes in turn.
    - `hand_length`: m. `compliance`: of wrist, MP, PIP and DIP, rad/Nm. `damping_time`: s, a joint's
      damping over its stiffness. `friction`: Coulomb coefficient.
    - `catch`: catch trials for each trial.
    - `bump`: on the plate; `height`: of the plate's top, m.
    - `noise`: of instruments and subject; the default is a good studio.
    - `progress`: called with the fraction done after every recording.

    **Returns** the paths written. **Errors**: `ValueError` naming the argument and its value; `FileError` where a
    file cannot be written. Nothing is written before every movement is known to be within reach.
    """
    for name, value, low, high in (
        ("trials", trials, 1, 99),
        ("contacts", contacts, 1, 20),
        ("catch", catch, 0, 9),
        ("seed", seed, 0, 2**63 - 1),
    ):
        if not (low <= value <= high):
            raise ValueError(f"{name} must be between {low} and {high}, got {value}")
    noise = Noise() if noise is None else noise
    subject = Subject(hand_length=hand_length, compliance=compliance, damping_time=damping_time)
    surface = Surface(friction=friction, height=height, bump=bump)
    lowered = dataclasses.replace(surface, lowered=CATCH_LOWERED)
    placed = place(subject.markers(), noise, np.random.default_rng([seed, 0]))
    plans = []
    for trial in range(trials):
        kinds = tuple("tap" if (trial + contact) % 2 == 0 else "stroke" for contact in range(contacts))
        plans.append(plan(subject, surface, kinds, np.random.default_rng([seed, 1, trial])))

    folder = Path(folder)
    truth = folder / "truth"
    written: dict[str, list[Path]] = {"trial": [], "catch": [], "truth": []}
    entries = []
    for trial, touches in enumerate(plans):
        for repetition in range(1 + catch):
            role = "catch" if repetition else "trial"
            name = f"{role}{trial:02d}" + (f"_{repetition}" if repetition > 1 else "")
            generator = np.random.default_rng([seed, 2, trial, repetition])
            shifts = np.clip(noise.timing * generator.standard_normal(contacts), -0.04, 0.04)
            shifts = shifts if repetition else np.zeros(contacts)
            wanted = command(subject, surface, touches, shifts, duration(touches))
            motion = simulate(subject, lowered if repetition else surface, restless(wanted, noise, generator), placed)
            written[role].append(_write(folder / f"{name}.c3d", motion, noise, generator))
            written["truth"].append(motion.truth.save(truth / f"{name}.npz"))
            entries.append((name, role, f"trial{trial:02d}"))
            if progress is not None:
                progress(len(entries) / (trials * (1 + catch)))
    written["truth"].append(_write_subject(truth, seed, subject, surface, plans, placed))
    session = folder / "session.toml"
    session.write_text(session_text(folder.name, subject, surface, entries))
    return Paths(
        session=session,
        trials=tuple(written["trial"]),
        catches=tuple(written["catch"]),
        truth=tuple(written["truth"]),
    )


def _write(path: Path, motion: Motion, noise: Noise, generator: np.random.Generator) -> Path:
    return write_c3d(
        path,
        marker_names=list(motion.marker_names),
        markers=cameras(motion.marker_names, motion.markers, noise, generator),
        marker_rate=RATE,
        analog_names=list(CHANNELS),
        analog_units=list(UNITS),
        analog=sensor(motion.wrench, noise, generator),
        analog_rate=ANALOG_RATE,
    )


def _write_subject(truth: Path, seed: int, subject: Subject, surface: Surface, plans: list, placed: dict) -> Path:
    path = truth / "subject.json"
    content = {
        "seed": seed,
        "subject": dataclasses.asdict(subject),
        "surface": dataclasses.asdict(surface),
        "touches": [[dataclasses.asdict(touch) for touch in touches] for touches in plans],
        "markers": {label: [body, list(position)] for label, (body, position) in placed.items()},
    }
    path.write_text(json.dumps(content, indent=1))
    return path
