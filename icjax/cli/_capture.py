"""`icjax capture`: recorded files to joint angles, contact forces and events."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


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
        from icjax.cli._output import Steps

        steps = Steps(1)
        with steps.step("markers to joint angles, forces and contact events") as progress:
            session = capture(read_session(self.session), progress=progress)
        path = self.out / "recording.nc"
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
        for line in check_recording(session):
            if line.startswith(("suspicious: ", "error: ")):
                print(line)
        print(f"wrote {path}")


def _rms(values) -> float:
    import numpy as np

    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else float("nan")
