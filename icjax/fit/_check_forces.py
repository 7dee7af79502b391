"""Does what was measured fit the simulation that is to explain it?"""

from typing import Any

import numpy as np

from icjax.fit._roles import check_array, check_sd, check_time, check_uses, counted, role
from icjax.model import Model
from icjax.synthesis import Scene, slot_names
from icjax.typing import Bool, Float, Int, Real

ROLES = ("compliance", "reference", "friction", "pad stiffness", "sensor gain", "sensor bias", "sensor delay")

MATCH = 1e-6
"""s; times farther apart are different."""


def pads_to_slots(what: str, model: Model, scene: Scene, pads: tuple[str, ...] | None) -> Float[np.ndarray, "pad slot"]:
    """1 where a slot's force acts on a pad, -1 where its opposite does (the second of two pads that meet).

    **Errors**: `ValueError` for unknown pads or none.
    """
    pads = model.pad_names if pads is None else pads
    unknown = [pad for pad in pads if pad not in model.pad_names]
    if unknown or not pads:
        raise ValueError(f"{what}: pads {unknown or 'is empty'}; model {model.name!r} has {', '.join(model.pad_names)}")
    sides = [slot.split("/") for slot in slot_names(model, scene)]
    sides = [(a if a in model.pad_names else a.rsplit(".", 1)[0], b) for a, b in sides]  # without a point's number
    return np.array([[float(first == pad) - float(second == pad) for first, second in sides] for pad in pads])


def measured_rows(
    what: str, scene: Scene, time: Any, reference_time: Any, counts: Any
) -> tuple[Int[np.ndarray, " time"], Bool[Real, " time"]]:
    """The row of the reference of every sample, and which samples count.

    **Errors**: `ValueError` for a reference that ends before the trial, times that are none of its rows, and with
    objects rows that are not spaced by the scene's step.
    """
    time = check_time(f"{what}: time", time)
    rows = time if reference_time is None else check_time(f"{what}: reference_time", reference_time)
    if rows[-1] < time[-1] - MATCH or rows[0] > time[0] + MATCH:
        raise ValueError(
            f"{what}: the reference goes from {rows[0]:g} to {rows[-1]:g} s, the trial from {time[0]:g} to {time[-1]:g}"
        )
    nearest = np.abs(rows[:, None] - time[None, :]).argmin(axis=0)
    off = np.abs(rows[nearest] - time)
    if off.max() > MATCH:
        row = int(off.argmax())
        raise ValueError(
            f"{what}: sample {row} at {time[row]:g} s is no row of the reference; the nearest is at "
            f"{rows[nearest[row]]:g} s"
        )
    if scene.objects and rows.size > 1 and np.abs(np.diff(rows) - scene.step).max() > MATCH:
        raise ValueError(f"{what}: rows of the reference must be {scene.step:g} s apart, the scene's step")
    return nearest, counted(what, counts, time.size)


def check_forces(what: str, of: Any, force, force_sd, nominal, basis, angles, angle_sd, time, reference_time) -> None:
    """**Errors**: `ValueError`, see [`ContactForces`]; `of` the measurement so far."""
    check_uses(what, of.uses, ROLES, several=("friction",))
    _check_frictions(what, of.uses, of.scene)
    samples, pads, nq = np.size(time), of.gather.shape[0], of.model.nq
    rows = samples if reference_time is None else np.size(reference_time)
    shape = (samples, pads, 3) if np.ndim(force) == 3 else (samples, pads)
    check_array(f"{what}: force", force, shape, "time, pad, 3" if len(shape) == 3 else "time, pad", of.counts)
    check_sd(f"{what}: force_sd", force_sd, shape)
    if np.ndim(nominal) == 2 and np.shape(nominal)[0] < rows:
        raise ValueError(f"{what}: the reference has {np.shape(nominal)[0]} rows, its times and the trial {rows}")
    check_array(f"{what}: nominal", nominal, (rows, nq), "row, nq")
    if any(role(name) == "reference" for name in of.uses) != (basis is not None):
        raise ValueError(f"{what}: a basis and a parameter 'reference' belong together; uses {of.uses}")
    if basis is not None:
        check_array(f"{what}: basis", basis, (rows, np.shape(basis)[-1]), "row, basis")
    if (angles is None) != (angle_sd is None):
        raise ValueError(f"{what}: angles and angle_sd belong together")
    if angles is not None:
        check_array(f"{what}: angles", angles, (samples, nq), "time, nq", of.counts)
        check_sd(f"{what}: angle_sd", angle_sd, (samples, len(of.dofs)))


def _check_frictions(what: str, uses: tuple[str, ...], scene: Scene) -> None:
    known = [thing.name for thing in (*scene.surfaces, *scene.objects)]
    stated = [name for name in uses if role(name) == "friction"]
    if "friction" in stated and len(stated) > 1:
        raise ValueError(f"{what}: uses 'friction' of everything beside {stated[1]!r}")
    for name in stated:
        if name != "friction" and name.removeprefix("friction of ") not in known:
            raise ValueError(f"{what}: uses {name!r}; the scene has {', '.join(known)}")
