"""`icjax export`: recordings and interactions as files that OpenSim and C3D viewers open."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

LAST_FRAME = 65535
"""Frame numbers of C3D headers are 16-bit."""


@dataclass(frozen=True)
class Export:
    """Write the trials of a recording, or an interaction, as TRC, MOT, STO and C3D.

    A recording gives TRIAL_markers.trc, TRIAL_angles.mot, TRIAL_forces.mot and TRIAL.c3d; an interaction gives
    TRIAL_torques.sto, TRIAL_reference.mot and TRIAL_compliance.sto.
    """

    record: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORD.NC")]
    """Recording or session written by `icjax capture`, or interaction written by `icjax estimate`."""
    out: Path
    """Folder for the files."""
    trial: str | None = None
    """Trial of a session; every one if not given."""
    y_up: bool = False
    """Turn markers, points, forces and free bodies from a world with z up to OpenSim's y up: (x, z, -y)."""

    def run(self) -> None:
        import numpy as np

        from icjax.cli._opensim import Y_UP
        from icjax.cli._output import Steps
        from icjax.files import record_kind
        from icjax.interaction import Interaction
        from icjax.recording import Session

        kind = record_kind(self.record)
        turn = Y_UP if self.y_up else np.eye(3)
        if kind in ("Recording", "Session"):
            items, write = Session.load(self.record).recordings, export_recording
        elif kind == "Interaction":
            items, write = (Interaction.load(self.record),), export_interaction
        else:
            raise ValueError(f"{self.record}: holds a {kind}; export takes a recording, a session or an interaction")
        chosen = self._chosen(items)
        for item in chosen:
            up = -np.asarray(item.model.gravity)
            if self.y_up and up.any() and np.argmax(np.abs(up)) != 2:
                told = ", ".join(f"{value:g}" for value in -up)
                raise ValueError(
                    f"--y-up turns a world with z up; gravity of '{item.name}' is ({told}) m/s2, so leave it out"
                )
        lines = []
        with Steps(1).step("export") as progress:
            for index, item in enumerate(chosen):
                lines += write(item, self.out, turn)
                progress((index + 1) / len(chosen))
        print("\n".join(lines))

    def _chosen(self, items):
        from icjax.cli._opensim import safe

        known = [item.name for item in items]
        if self.trial is not None and self.trial not in known:
            raise ValueError(f"--trial {self.trial}: {self.record} has the trials {', '.join(known)}")
        chosen = [item for item in items if self.trial in (None, item.name)]
        names = [safe(item.name) for item in chosen]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"{self.record}: two trials would be written as '{name}'; choose one with --trial")
        return chosen


def export_recording(recording, folder: Path, turn) -> list[str]:
    """Write one trial's markers, angles and forces. Returns what was done, a line a file."""
    import numpy as np

    from icjax.cli._opensim import coordinate_table, force_table, safe
    from icjax.files import write_sto, write_trc

    name, time = safe(recording.name), np.asarray(recording.time)
    lines = []
    if recording.marker_names:
        markers = np.asarray(recording.markers) @ turn.T
        path = folder / f"{name}_markers.trc"
        write_trc(path, marker_names=recording.marker_names, markers=markers, time=time, rate=recording.rate)
        lines.append(f"wrote {path} ({len(recording.marker_names)} markers, mm)")
    valid = np.asarray(recording.valid)
    angles = coordinate_table(recording.model, np.asarray(recording.q), valid, turn)
    path = folder / f"{name}_angles.mot"
    write_sto(path, time=time, names=angles.names, values=angles.values, in_degrees=True)
    gaps = f"; {int((~valid).sum())} frames without pose are NaN" if not valid.all() else ""
    lines.append(f"wrote {path} ({len(angles.names)} coordinates, degrees and m{gaps})")
    if recording.contact_names:
        forces = force_table(recording, turn)
        path = folder / f"{name}_forces.mot"
        write_sto(path, time=time, names=forces.names, values=forces.values)
        lines.append(f"wrote {path} (on the subject: {', '.join(recording.contact_names)})")
    return lines + _c3d(recording, folder / f"{name}.c3d", turn)


def _c3d(recording, path: Path, turn) -> list[str]:
    import importlib.util

    import numpy as np

    from icjax.cli._opensim import contact_marks, sensor_table
    from icjax.files import write_c3d

    if not recording.marker_names:
        return []
    if importlib.util.find_spec("ezc3d") is None:
        return [f'left out {path}: it needs ezc3d (pip install "icjax[capture]")']
    first = float(recording.time[0]) * recording.rate
    frame = round(first)
    if not 0 <= frame <= LAST_FRAME - len(recording.time):
        return [f"left out {path}: frames {frame} to {frame + len(recording.time) - 1} are no frame numbers of C3D"]
    notes = []
    if abs(first - frame) > 0.01:
        notes.append(f"times are shifted by {(frame - first) / recording.rate:.6f} s to whole frames")
    analog = {}
    if recording.channels.sensor_names and len(recording.channels.time) > 1:
        table, rate, done = sensor_table(recording, turn)
        units = ("N", "N", "N", "Nm", "Nm", "Nm") * len(recording.channels.sensor_names)
        analog = {"analog_names": table.names, "analog_units": units, "analog": table.values, "analog_rate": rate}
        notes += [done] if done else []
    write_c3d(
        path,
        marker_names=recording.marker_names,
        markers=np.asarray(recording.markers) @ turn.T,
        marker_rate=recording.rate,
        events=contact_marks(recording),
        first_frame=frame,
        **analog,
    )
    sensors = ", ".join(recording.channels.sensor_names) if analog else "none"
    return [f"wrote {path} (markers, mm; wrenches of {sensors} on the subject about the world origin)"] + [
        f"  {note}" for note in notes
    ]


def export_interaction(interaction, folder: Path, turn) -> list[str]:
    """Write torque, reference trajectory and compliance. Returns what was done, a line a file."""
    import numpy as np

    from icjax.cli._opensim import coordinate_table, safe, torque_names
    from icjax.files import write_sto

    name, model, time = safe(interaction.name), interaction.model, np.asarray(interaction.time)
    whole = np.ones(len(time), bool)
    reference = coordinate_table(model, np.asarray(interaction.reference), whole, turn)
    dofs = tuple(safe(dof) for dof in model.dof_names)
    tables = (
        ("torques.sto", torque_names(model), np.asarray(interaction.torque), False, "torque of the contact force, Nm"),
        ("reference.mot", reference.names, reference.values, True, "reference trajectory, degrees and m"),
        ("compliance.sto", dofs, np.asarray(interaction.compliance), False, "compliance, rad/Nm and m/N"),
    )
    lines = []
    for suffix, names, values, degrees, what in tables:
        path = folder / f"{name}_{suffix}"
        write_sto(path, time=time, names=names, values=values, in_degrees=degrees)
        lines.append(f"wrote {path} ({what})")
    return lines
