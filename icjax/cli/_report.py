"""`icjax report`: the records of a folder as one self-contained page."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Report:
    """Write DIR/report.html from the recordings, interactions, fits and rollouts found in DIR."""

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]
    """Folder with recording.nc, interaction.nc, fit_*.nc and rollout_*.nc (each may be missing)."""
    out: Path | None = None
    """Page to write; DIR/report.html if not given."""

    def run(self) -> None:
        from icjax.cli._output import Steps

        if not self.folder.is_dir():
            raise ValueError(f"{self.folder}: is not a folder")
        with Steps(1).step("report") as progress:
            path = report_folder(self.folder, self.out, progress)
        print(f"wrote {path}")


def report_folder(
    folder: Path, out: Path | None = None, progress: Callable[[float, str], None] = lambda share, note: None
) -> Path:
    """Collect the records of a folder and write its page; `progress` is told the share that is done and what comes."""
    from icjax.fit import FitRecord
    from icjax.interaction import Interaction
    from icjax.recording import Session
    from icjax.report import Report
    from icjax.rollout import Rollout
    from icjax.view import scene_name

    recording = folder / "recording.nc"
    interactions = sorted(folder.glob("interaction*.nc"))
    fits, rollouts = sorted(folder.glob("fit_*.nc")), sorted(folder.glob("rollout_*.nc"))
    if not (recording.exists() or interactions or fits or rollouts):
        raise ValueError(f"{folder}: holds no recording.nc, interaction.nc, fit_*.nc or rollout_*.nc")
    metrics = _metrics(folder / "metrics.json")
    progress(0.0, "reading the records")
    session = Session.load(recording) if recording.exists() else None
    told = _told_apart([(path, Rollout.load(path)) for path in rollouts])
    estimates = tuple(Interaction.load(path) for path in interactions)
    report, parts = Report(), len(told) + 2
    progress(0.0, "what was recorded, estimated and fitted")
    report.measured(session, estimates, metrics, tuple(FitRecord.load(path) for path in fits))
    for number, rollout in enumerate(told):
        progress((number + 1) / parts, f"the rollout to {scene_name(rollout)}")
        report.transferred(rollout)
    progress((parts - 1) / parts, "forces, and the page itself")
    return report.write(out or folder / "report.html", metrics=metrics, seed=metrics.get("seed") if metrics else None)


def _told_apart(found: list) -> tuple:
    """Rollouts of pairs of a path and a rollout, those to scenes of one name called after their files."""
    import dataclasses
    import json

    from icjax.view import scene_name

    names = [scene_name(rollout) for _, rollout in found]
    told = []
    for (path, rollout), name in zip(found, names, strict=True):
        if names.count(name) > 1:
            scene = json.dumps({**json.loads(rollout.scene), "name": path.stem.removeprefix("rollout_")})
            rollout = dataclasses.replace(rollout, scene=scene)
        told.append(rollout)
    return tuple(told)


def _metrics(path: Path) -> dict | None:
    import json

    from icjax.files import FileError

    if not path.exists():
        return None
    try:
        metrics = json.loads(path.read_text())
    except ValueError as error:
        raise FileError(path, f"is not valid JSON: {error}") from None
    if not isinstance(metrics, dict):
        raise FileError(path, "must hold a table of figures")
    return metrics
