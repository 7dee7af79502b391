"""What the same subject, with the same intention, would have done on another surface: the judge of a transfer."""

import dataclasses
import json
import os
from pathlib import Path

import numpy as np

from icjax.files import FileError
from icjax.laboratory._dynamics import Truth, simulate
from icjax.laboratory._subject import Subject
from icjax.laboratory._surface import Bump, Surface


def replay(
    folder: str | os.PathLike, trial: str = "trial00", *, bump: Bump | None = None, friction: float | None = None
) -> Truth:
    """Run the command of a recorded trial on another surface.

    Subject, commanded movement, tremor and forearm sway are those of the recording; only the surface differs. With
    the recorded surface the result is the recorded truth itself.

    **Arguments**

    - `folder`: given to `record`.
    - `trial`: name of the recording.
    - `bump`: on the plate; None is a flat plate.
    - `friction`: Coulomb coefficient; None is as recorded.

    **Returns** the truth on that surface. **Errors**: `FileError` where the truth of the recording is missing;
    `ValueError` for an impossible surface.
    """
    content = _subject(folder)
    recorded = load_truth(Path(folder) / "truth" / f"{trial}.npz")
    surface = Surface(
        friction=content["surface"]["friction"] if friction is None else friction,
        height=content["surface"]["height"],
        bump=bump,
    )
    values = content["subject"]
    subject = Subject(**{**values, "compliance": tuple(values["compliance"])})
    return simulate(subject, surface, recorded.command, {}).truth


def bump_under(
    folder: str | os.PathLike,
    trial: str = "trial00",
    *,
    height: float = 0.003,
    half_length: float = 0.012,
    half_width: float = 0.035,
) -> Bump:
    """A bump (m) in the middle of the first stroke of a recorded trial.

    **Errors**: `FileError` where the truth is missing; `ValueError` where the trial has no stroke.
    """
    content = _subject(folder)
    names = [f"trial{index:02d}" for index in range(len(content["touches"]))]
    if trial not in names:
        raise ValueError(f"unknown trial {trial!r}; the session has {', '.join(names)}")
    for touch in content["touches"][names.index(trial)]:
        if touch["kind"] == "stroke":
            middle = 0.5 * (touch["x_from"] + touch["x_to"])
            return Bump(centre=(middle, 0.0, content["surface"]["height"]), radii=(half_length, half_width, height))
    raise ValueError(f"{trial} has no stroke to put a bump under")


def load_truth(path: str | os.PathLike) -> Truth:
    """Read a truth that `record` or `Truth.save` wrote. **Errors**: `FileError` naming the file."""
    path = Path(path)
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        with np.load(path) as archive:
            values = {field.name: archive[field.name] for field in dataclasses.fields(Truth)}
    except (OSError, ValueError, KeyError) as error:
        raise FileError(path, f"is no truth of the laboratory: {error}") from error
    values["mu"], values["pad_stiffness"] = float(values["mu"]), float(values["pad_stiffness"])
    return Truth(**values)


def _subject(folder: str | os.PathLike) -> dict:
    path = Path(folder) / "truth" / "subject.json"
    if not path.is_file():
        raise FileError(path, "does not exist: replaying needs the truth of a recorded session")
    return json.loads(path.read_text())
