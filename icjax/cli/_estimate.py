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
    explain: bool = False
    """Also print why each estimate was accepted or not, and whether it depends on windows and degree."""

    def run(self) -> None:
        from icjax.capture import check_recording
        from icjax.cli._output import Steps
        from icjax.estimation import EstimationOptions, estimates
        from icjax.recording import Session

        session = Session.load(self.recording)
        errors = [line for line in check_recording(session) if line.startswith("error: ")]
        if errors:
            raise ValueError(f"{self.recording} is unusable: {errors[0].removeprefix('error: ')}")
        options = EstimationOptions(window_before=self.window, window_after=self.window, degree=self.degree)
        known = [item.name for item in session.trials()]
        if self.trial is not None and self.trial not in known:
            raise ValueError(f"--trial {self.trial}: {self.recording} has the trials {', '.join(known)}")
        folder, first = self.out or self.recording.parent, self.trial or next(iter(known), "")
        steps = Steps(1 + self.explain)
        chosen = None
        with steps.step("compliance at contact and reference trajectory") as progress:
            for item in estimates(session, options, progress, known if self.all else (first,)):
                if self.all:
                    item.save(folder / f"interaction_{item.name}.nc")
                if item.name == first:
                    item.save(folder / "interaction.nc")
                    chosen = item
        print(summary_text(chosen))
        if self.explain:
            with steps.step("the same over other windows and degrees"):
                told = explanation_text(session.trials(), chosen, options)
            print(told)
        print(f"wrote {folder / 'interaction.nc'} (trial {first})")
        if self.all:
            print(f"wrote {folder / 'interaction_<trial>.nc'} for {', '.join(known)}")


def summary_text(interaction) -> str:
    """Compliance of each joint over the session, as a table of text."""
    import json

    import numpy as np

    from icjax.interaction import STATUS

    summary, status = interaction.summary, np.asarray(interaction.per_event.status)
    model = interaction.model
    provenance = json.loads(interaction.provenance or "{}")
    slides = [name for name, kind in zip(model.joint_names, model.joint_types, strict=True) if kind == "slide"]
    unit = "rad/Nm" if not slides else "rad/Nm, m/N"
    lines = [f"{'joint':12s} {unit:>14s}  {'95 % interval':>20s}   events: " + ", ".join(STATUS)]
    instead = []
    for index, joint in enumerate(summary.joint_names):
        value, lower, upper = (float(x[index]) for x in (summary.compliance, summary.lower, summary.upper))
        told = f"{value:.3g}" if np.isfinite(value) else "not estimated"
        if not np.isfinite(upper):
            interval = "unbounded"
        elif lower > 0:
            interval = f"[{lower:.3g}, {upper:.3g}]"
        else:
            interval = f"< {upper:.3g}"
        if not np.isfinite(value):
            used = float(np.asarray(interaction.compliance)[0, model.dof_names.index(joint)])
            source = (provenance.get("sources", {}).get(joint) or ["unknown"])[0]
            instead.append(f"{joint} {used:.3g} ({source})")
        column = interaction.per_event.joint_names.index(joint)
        counts = ", ".join(str(int(np.sum(status[:, column] == code))) for code in range(len(STATUS)))
        lines.append(f"{joint:12s} {told:>14s}  {interval:>20s}   {counts}")
    if instead:
        lines.append("not estimated; the reference trajectory uses instead: " + ", ".join(instead))
    lines.append("intervals state the scatter of the events, not the bias of inertia, damping and planned deceleration")
    blind = provenance.get("normal_only", [])
    if blind:
        lines.append(
            f"normal force only ({', '.join(blind)}): tangential force is missing from the torques, which biases every "
            "value above, and friction is unknown"
        )
    return "\n".join(lines)


def explanation_text(trials, interaction, options) -> str:
    """A line an event and joint: status with numbers, geometry, agreement over windows and degrees."""
    import numpy as np

    from icjax.estimation import excitation, explain, joint_torque, sensitivity

    torques = tuple(np.asarray(joint_torque(item)) for item in trials)
    per_event = interaction.per_event
    agreement = sensitivity(trials, options=options, torques=torques)
    reasons = explain(per_event, excitation(trials, options, torques), agreement, options)
    lines = []
    for event, (name, onset) in enumerate(zip(per_event.recording, np.asarray(per_event.onset), strict=True)):
        for joint, reason in zip(per_event.joint_names, reasons[event], strict=True):
            lines.append(f"{name} {float(onset):8.3f} s  {joint:12s} {reason}")
    counts = zip(per_event.joint_names, agreement.stable.sum(axis=0), strict=True)
    told = ", ".join(f"{joint} {int(count)}" for joint, count in counts)
    return "\n".join([*lines, f"stable over windows and degrees, of {len(per_event.onset)} events: {told}"])
