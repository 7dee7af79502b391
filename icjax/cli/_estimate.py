"""`icjax estimate`: a recording to compliance and reference trajectory."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True)
class Estimate:
    """Estimate joint compliance and reference trajectory; write DIR/interaction.nc.

    The estimate is the paper's (Kry and Pai 2006, sections 3.3 and 3.4). Its intervals state the scatter of the
    events, not the bias that inertia, damping and a planned deceleration cause.
    """

    recording: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORDING.NC")]
    """Recording or session written by `icjax capture`."""
    out: Path | None = None
    """Folder for the result; the recording's own folder if not given."""
    trial: str | None = None
    """Trial whose interaction is written as interaction.nc; the first if not given."""
    all: bool = False
    """Write every trial, as interaction_<trial>.nc."""
    window: float = 0.1
    """Length of the windows before and after contact, s (spinal reflexes need about 0.1 s)."""
    degree: Literal[1, 2] = 2
    """Degree of the polynomials fitted in the windows."""

    def run(self) -> None:
        from icjax.cli._output import Steps
        from icjax.estimation import EstimationOptions, estimate
        from icjax.recording import Session

        session = Session.load(self.recording)
        options = EstimationOptions(window_before=self.window, window_after=self.window, degree=self.degree)
        with Steps(1).step("compliance at contact and reference trajectory") as progress:
            interactions = estimate(session, options, progress=progress)
        known = [item.name for item in interactions]
        if self.trial is not None and self.trial not in known:
            raise ValueError(f"--trial {self.trial}: {self.recording} has the trials {', '.join(known)}")
        folder = self.out or self.recording.parent
        chosen = interactions[known.index(self.trial) if self.trial else 0]
        print(summary_text(chosen.summary))
        chosen.save(folder / "interaction.nc")
        print(f"wrote {folder / 'interaction.nc'} (trial {chosen.name})")
        if self.all:
            for item in interactions:
                item.save(folder / f"interaction_{item.name}.nc")
            print(f"wrote {folder / 'interaction_<trial>.nc'} for {', '.join(known)}")


def summary_text(summary) -> str:
    """Compliance of each joint as a table of text."""
    lines = [f"{'joint':12s} {'rad/Nm':>9s}   95 % interval      accepted  negative  of events"]
    for index, joint in enumerate(summary.joint_names):
        lines.append(
            f"{joint:12s} {summary.compliance[index]:9.4f}   "
            f"[{summary.lower[index]:7.4f}, {summary.upper[index]:7.4f}] "
            f"{summary.accepted[index]:8d}  {summary.negative[index]:8d}  {summary.events[index]:9d}"
        )
    return "\n".join(lines)
