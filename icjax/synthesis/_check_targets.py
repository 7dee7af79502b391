"""Targets that no hand, object or scene could follow, named before anything is simulated."""

import jax.numpy as jnp
import numpy as np

from icjax.model import Model
from icjax.synthesis._bodies import Target
from icjax.synthesis._contacts import slots
from icjax.synthesis._scene import Scene
from icjax.synthesis._surface import known
from icjax.typing import Float, Real

UNIT = 0.01
"""How far from one the length of a quaternion may be."""

JUMP = 0.02, 0.2
"""m and rad; a driven object must begin its path within this of where it stands, or it is a blow."""


def check_targets(model: Model, scene: Scene, targets: Target, begins: bool = True) -> None:
    """**Errors**: `ValueError` naming the argument, and the row, joint or object; traced numbers are not looked at.

    **Arguments**: `begins` whether the objects stand where the scene has them.
    """
    _check_pads(model)
    _check_shapes(model, scene, targets)
    for name in ("reference", "compliance", "wrench", "path"):
        value = getattr(targets, name)
        value = None if value is None else known(value)
        if value is not None and not np.isfinite(value).all():
            row = int(np.argmin(np.isfinite(value).all(axis=tuple(range(1, value.ndim)))))
            raise ValueError(f"targets: {name} is not finite, first in row {row}")
    _check_compliance(model, known(targets.compliance))
    _check_limits(model)
    if targets.path is not None:
        _check_path(scene, known(targets.path), begins)


def check_start(model: Model, scene: Scene, gap: Float[Real, " slot"]) -> None:
    """**Errors**: `ValueError` for an object into which a pad is pressed deeper than it is thick: out may be anywhere.

    A hand that holds something may well begin at a reference inside it, from where it is pushed out in the first step.

    **Arguments**: `gap` of all slots at the start; traced numbers are not looked at.
    """
    table, depth = slots(model, scene), known(gap)
    if depth is None or not model.pad_names:
        return
    radius = np.append(np.asarray(model.pad_radius, float), np.inf)[table.pad]
    inside = np.where((table.pad >= 0) & (table.second >= 0), depth + 2.0 * radius, np.inf)
    if inside.min() < 0:
        slot = int(np.argmin(inside))
        pad, thing = table.names[slot].split("/")
        raise ValueError(
            f"object {thing!r} begins {-1e3 * depth[slot]:.1f} mm inside the hand, around pad {pad!r} of radius "
            f"{1e3 * radius[slot]:.1f} mm: move the object, or begin with the hand open"
        )


def _check_pads(model: Model) -> None:
    for name, low in (("pad_compliance", 0.0), ("pad_radius", np.nextafter(0.0, 1.0))):
        value = known(getattr(model, name))
        if value is None or (value >= low).all() and np.isfinite(value).all():
            continue
        at = int(np.argmin((value >= low) & np.isfinite(value)))
        raise ValueError(f"model {model.name!r}: {name} of {model.pad_names[at]!r} is {value[at]:g}")


def _check_shapes(model: Model, scene: Scene, targets: Target) -> None:
    for name in ("reference", "compliance"):
        kind = getattr(getattr(targets, name), "dtype", None)
        if kind is None or not jnp.issubdtype(kind, jnp.floating):
            raise TypeError(f"targets: {name} must be an array of floating numbers; got {kind or 'no array'}")
    reference, compliance = jnp.shape(targets.reference), jnp.shape(targets.compliance)
    rows = reference[:1]
    if reference[1:] != (model.nq,) or compliance[1:] not in ((model.nv,), (model.nv, model.nv)):
        found = reference[1:], compliance[1:]
        raise ValueError(f"targets must be [time, {model.nq}] and [time, {model.nv}]; got [time, ...] {found}")
    if not rows[0]:
        raise ValueError("targets have no rows")
    driven = sum(item.driven for item in scene.objects)
    for name, value, count, size in (
        ("wrench", targets.wrench, len(scene.objects), 6),
        ("path", targets.path, driven, 7),
    ):
        if value is not None and jnp.shape(value)[1:] != (count, size):
            of = "an object" if name == "wrench" else "a driven object"
            raise ValueError(f"{name} must be [time, {count}, {size}], a row {of}; got {list(jnp.shape(value))}")
    for name in ("compliance", "wrench", "path"):
        value = getattr(targets, name)
        if value is not None and jnp.shape(value)[:1] != rows:
            raise ValueError(f"targets: {name} has {jnp.shape(value)[0]} rows, reference {rows[0]}")


def _check_compliance(model: Model, compliance: np.ndarray | None) -> None:
    if compliance is None or not compliance.size:
        return
    diagonal = compliance if compliance.ndim == 2 else np.diagonal(compliance, axis1=1, axis2=2)
    if (diagonal < 0).any():
        row, dof = np.argwhere(diagonal < 0)[0]
        name, value = model.dof_names[dof], diagonal[row, dof]
        raise ValueError(f"targets: compliance of {name} must not be negative; got {value:g} in row {row}")
    if compliance.ndim == 2:
        return
    size = np.abs(compliance).max(axis=(1, 2))
    off = np.abs(compliance - np.swapaxes(compliance, 1, 2)).max(axis=(1, 2)) > 1e-9 * size
    if off.any():
        raise ValueError(f"targets: compliance is not symmetric, first in row {int(np.argmax(off))}")
    least = np.linalg.eigvalsh(compliance)[:, 0]
    if (least < -1e-9 * size).any():
        row = int(np.argmax(least < -1e-9 * size))
        raise ValueError(f"targets: compliance has the negative eigenvalue {least[row]:.3g} in row {row}")


def _check_limits(model: Model) -> None:
    lower, upper = known(model.lower), known(model.upper)
    if lower is None or upper is None or not (lower > upper).any():
        return
    at = int(np.argmax(lower > upper))
    names = {part.start: name for name, part in zip(model.joint_names, model.coordinate_slices, strict=True)}
    raise ValueError(f"model {model.name!r}: limits of {names.get(at, at)} are {lower[at]:g} to {upper[at]:g}")


def _check_path(scene: Scene, path: np.ndarray | None, begins: bool) -> None:
    if path is None or not path.size:
        return
    driven = [item for item in scene.objects if item.driven]
    length = np.linalg.norm(path[:, :, 3:], axis=2)
    if (np.abs(length - 1) > UNIT).any():
        row, column = np.argwhere(np.abs(length - 1) > UNIT)[0]
        name, found = driven[column].name, path[row, column, 3:].tolist()
        raise ValueError(f"targets: path of {name!r}: no unit quaternion (w, x, y, z) in row {row}: {found}")
    for item, pose in zip(driven, path[0] if begins else (), strict=False):
        position, rotation = known(item.pose.position), known(item.pose.rotation)
        if position is None or rotation is None:
            continue
        away = float(np.linalg.norm(pose[:3] - position))
        turn = float(np.arccos(np.clip((np.trace(rotation.T @ _rotation(pose[3:])) - 1) / 2, -1, 1)))
        if away > JUMP[0] or turn > JUMP[1]:
            raise ValueError(
                f"targets: path of {item.name!r} begins {1e3 * away:.0f} mm and {turn:.2g} rad from where it stands"
            )


def _rotation(quaternion: np.ndarray) -> np.ndarray:
    w, *v = quaternion / np.linalg.norm(quaternion)
    K = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    return np.eye(3) + 2 * w * K + 2 * K @ K
