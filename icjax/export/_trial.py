"""Trials, interactions and rollouts as folders of files that other programs open."""

import importlib.util
from pathlib import Path

import numpy as np

from icjax.export._mujoco import export_mujoco
from icjax.export._opensim import (
    contact_marks,
    coordinate_table,
    force_table,
    rollout_coordinates,
    rollout_forces,
    safe,
    sensor_table,
    torque_names,
)
from icjax.files import write_c3d, write_sto, write_trc
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view import export_animation, scene_name

LAST_FRAME = 65535
"""Frame numbers of C3D headers are 16-bit."""


def export_recording(recording: Recording, folder: Path, turn: np.ndarray) -> list[str]:
    """Write one trial's markers, angles and forces. Returns what was done, a line a file."""
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


def _c3d(recording: Recording, path: Path, turn: np.ndarray) -> list[str]:
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


def export_interaction(interaction: Interaction, folder: Path, turn: np.ndarray) -> list[str]:
    """Write torque, reference trajectory and compliance. Returns what was done, a line a file."""
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


def export_rollout(rollout: Rollout, folder: Path, turn: np.ndarray) -> list[str]:
    """Write coordinates, contact forces, an animation and a MuJoCo model. Returns what was done, a line a file."""
    name, time = safe(f"{rollout.name}_{scene_name(rollout)}"), np.asarray(rollout.time)
    angles, forces = rollout_coordinates(rollout, turn), rollout_forces(rollout, turn)
    path = folder / f"{name}_angles.mot"
    write_sto(path, time=time, names=angles.names, values=angles.values, in_degrees=True)
    lines = [f"wrote {path} ({len(angles.names)} coordinates, degrees and m)"]
    path = folder / f"{name}_forces.mot"
    write_sto(path, time=time, names=forces.names, values=forces.values)
    lines.append(f"wrote {path} ({len(forces.names) // 9} pairs, on the first of each)")
    lines.append(f"wrote {export_animation(rollout, folder / f'{name}.glb')} (animated, y up)")
    model, table = export_mujoco(rollout, folder / f"{name}.xml")
    return [*lines, f"wrote {model} (MuJoCo) and {table} (its qpos)"]
