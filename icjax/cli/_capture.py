"""`icjax capture`: recorded files to joint angles, contact forces and events."""

from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from icjax.capture import SessionSpec

LONG = 50_000_000
"""Bytes of files that two processes read and solve in less time than one."""


@dataclass(frozen=True)
class Capture:
    """Read a session's files; write its joint angles, contact forces and events to DIR/recording.nc."""

    session: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION.TOML")]
    """Session file."""
    out: Path = Path("icjax-out")
    """Folder for recording.nc."""

    def run(self) -> None:
        import json

        from icjax.capture import calibration_lines, capture, check_recording, read_session
        from icjax.cli._helper import helper
        from icjax.cli._output import Steps

        path = self.out / "recording.nc"
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file, not a folder")
        steps = Steps(1)
        with steps.step("markers to joint angles, forces and contact events") as progress:
            spec = read_session(self.session)
            with helper() if _is_long(spec) else nullcontext() as executor:
                session = capture(spec, progress=progress, executor=executor)
        session.save(path)
        calibration = json.loads(session.recordings[0].provenance).get("calibration") if session.recordings else None
        for line in calibration_lines(calibration) if calibration else ():
            print(f"  {line}")
        for recording in session.recordings:
            rms = _rms(recording.marker_residual[recording.valid])
            fit = f"marker residual {1e3 * rms:.2f} mm RMS" if recording.marker_names else "joint angles from a file"
            print(
                f"  {recording.name} ({recording.role}): {float(recording.time[-1] - recording.time[0]):.2f} s, "
                f"{len(recording.events.onset)} contacts, {fit}, "
                f"{int((~recording.valid).sum())} frames without pose"
            )
            if recording.normal_only:
                print(
                    f"  {recording.name}: normal force only at {', '.join(recording.normal_only)}; joint torques are "
                    "biased (no tangential force) and friction is unknown"
                )
        lines = [line for line in check_recording(session) if line.startswith(("suspicious: ", "error: "))]
        for line in lines:
            print(line)
        print(f"wrote {path}")
        errors = [line for line in lines if line.startswith("error: ")]
        if errors:
            raise ValueError(f"{path} is unusable: {errors[0].removeprefix('error: ')}")


def _is_long(spec: "SessionSpec") -> bool:
    """Whether there is work for a second process, which takes seconds to begin."""
    files = {path for trial in spec.trials for path in (trial.markers, trial.forces) if path is not None}
    return len(spec.trials) > 1 and sum(path.stat().st_size for path in files if path.is_file()) > LONG


def _rms(values) -> float:
    import numpy as np

    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")
