"""`icjax check`: what a session or a record file says, before anything is computed from it."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Check:
    """Print what icjax understands of a session file, or validate a record file (.nc).

    Of a session: rates, channels, units, gaps, plates, suspicious values. Of a record: its layout against the
    documented one, and whether its numbers mean what their fields say.
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION.TOML|RECORD.NC")]
    """Session file (its keys are explained in the guide "The session file"), recording, interaction, rollout or fit."""

    def run(self) -> None:
        if self.file.suffix == ".checkpoint":
            raise ValueError(f"{self.file} is a checkpoint of a fit: `icjax fit ... --resume` reads it")
        lines = _record(self.file) if self.file.suffix == ".nc" else _session(self.file)
        print("\n".join(lines))
        refused = [line for line in lines if line.startswith("error: ")]
        if refused:
            what = "make it unusable" if self.file.suffix == ".nc" else "would stop capture"
            raise ValueError(f"{self.file}: {len(refused)} of the lines above {what}")


def _session(path: Path) -> list[str]:
    from icjax.capture import check, read_session

    return check(read_session(path))


def _record(path: Path) -> list[str]:
    from icjax.files import FileError, layout_problems, record_kind
    from icjax.fit import FitRecord
    from icjax.interaction import Interaction
    from icjax.recording import Recording, Session
    from icjax.rollout import Rollout

    kinds = {item.__name__: item for item in (Recording, Session, Interaction, Rollout, FitRecord)}
    kind = record_kind(path)
    if kind not in kinds:
        raise FileError(path, f"holds a {kind}, which is none of {', '.join(kinds)}")
    problems = layout_problems(path, kinds[kind])
    if problems:
        return [f"error: {problem}" for problem in problems]
    try:
        return _contents(path, kind)
    except (TypeError, AttributeError, IndexError, KeyError, ZeroDivisionError) as error:
        return [f"error: a field holds something else than it should: {error}"]


def _contents(path: Path, kind: str) -> list[str]:
    from icjax.fit import FitRecord, check_fit
    from icjax.interaction import Interaction
    from icjax.recording import Session
    from icjax.rollout import Rollout

    if kind == "Interaction":
        from icjax.estimation import check_interaction

        return check_interaction(Interaction.load(path))
    if kind == "FitRecord":
        return check_fit(FitRecord.load(path))
    if kind == "Rollout":
        from icjax.synthesis import check_rollout

        return check_rollout(Rollout.load(path))
    from icjax.capture import check_recording

    return check_recording(Session.load(path))
