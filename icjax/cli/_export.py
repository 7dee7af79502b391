"""`icjax export`: records as files that other programs open."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro


@dataclass(frozen=True)
class Export:
    """Write a record for other programs: a folder of files, or one file whose suffix says what it is.

    In a folder, a recording gives TRIAL_markers.trc, TRIAL_angles.mot, TRIAL_forces.mot and TRIAL.c3d; an interaction
    TRIAL_torques.sto, TRIAL_reference.mot and TRIAL_compliance.sto; a rollout NAME_angles.mot, NAME_forces.mot,
    NAME.glb and NAME.xml with NAME_qpos.csv for MuJoCo. One file: .glb (animated), .gif or .mp4 (a clip), and of a
    rollout also .xml, .sto, .mot or .nc. Files that are there are replaced.
    """

    record: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORD.NC")]
    """Recording or session, interaction or rollout."""
    out: Path
    """Folder for the files, or one file."""
    trial: str | None = None
    """Trial of a session; every one if not given."""
    y_up: bool = False
    """Turn markers, points, forces and free bodies from a world with z up to OpenSim's y up: (x, z, -y)."""
    speed: float | None = None
    """Of a clip, times real time; 1 if not given."""
    fps: float | None = None
    """Frames a second of a clip; 25 if not given."""
    size: tuple[int, int] | None = None
    """Width and height of a clip, pixels; 640 480 if not given."""
    times: tuple[float, float] | None = None
    """Begin and end of a clip, s; those of the record if not given."""

    def run(self) -> None:
        import numpy as np

        from icjax.cli._output import Steps
        from icjax.export import Y_UP, export_record

        turn = Y_UP if self.y_up else np.eye(3)
        items, write = self._read()
        one_file = bool(self.out.suffix) and not self.out.is_dir()
        chosen = self._chosen(items, one_file)
        for item in chosen:
            self._refuse_turn(item)
        clip = {"speed": self.speed, "frames_per_second": self.fps, "size": self.size, "times": self.times}
        clip = {name: value for name, value in clip.items() if value is not None}
        if clip and not one_file:
            raise ValueError(f"{', '.join(clip)} is said of clips only; --out {self.out} is a folder")
        lines = []
        with Steps(1).step("export") as progress:
            if one_file:
                lines = export_record(chosen[0], self.out, turn=turn, progress=progress, **clip)
            else:
                for index, item in enumerate(chosen):
                    lines += write(item, self.out, turn)
                    progress((index + 1) / len(chosen))
        print("\n".join(lines))

    def _read(self) -> tuple[tuple[Any, ...], Any]:
        from icjax.export import export_interaction, export_recording, export_rollout
        from icjax.files import record_kind
        from icjax.interaction import Interaction
        from icjax.recording import Session
        from icjax.rollout import Rollout

        kind = record_kind(self.record)
        if kind in ("Recording", "Session"):
            return Session.load(self.record).recordings, export_recording
        if kind == "Interaction":
            return (Interaction.load(self.record),), export_interaction
        if kind == "Rollout":
            return (Rollout.load(self.record),), export_rollout
        raise ValueError(
            f"{self.record}: holds a {kind}; export takes a recording, a session, an interaction or a rollout"
        )

    def _refuse_turn(self, item) -> None:
        import numpy as np

        up = -np.asarray(item.model.gravity)
        if self.y_up and up.any() and np.argmax(np.abs(up)) != 2:
            told = ", ".join(f"{value:g}" for value in -up)
            raise ValueError(
                f"--y-up turns a world with z up; gravity of '{item.name}' is ({told}) m/s2, so leave it out"
            )

    def _chosen(self, items, one_file: bool):
        from icjax.export import safe

        known = [item.name for item in items]
        if self.trial is not None and self.trial not in known:
            raise ValueError(f"--trial {self.trial}: {self.record} has the trials {', '.join(known)}")
        chosen = [item for item in items if self.trial in (None, item.name)]
        if one_file and len(chosen) > 1:
            raise ValueError(f"--out {self.out} is one file; choose one of the trials {', '.join(known)} with --trial")
        names = [safe(item.name) for item in chosen]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"{self.record}: two trials would be written as '{name}'; choose one with --trial")
        return chosen
