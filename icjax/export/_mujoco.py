"""A rollout as a MuJoCo model and the coordinates of its bodies over time."""

import csv
import io
import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from icjax.export._mujoco_shapes import add_shape
from icjax.files import write_bytes
from icjax.model import Model
from icjax.rollout import Rollout
from icjax.view import bones, scene_content

ENDLESS = 1e10
"""rad or m in place of no limit, where a joint has one on its other side only."""


def export_mujoco(rollout: Rollout, path: str | os.PathLike) -> tuple[Path, Path]:
    """Write an MJCF model of hand, objects and surfaces, and beside it the `qpos` of every step.

    `NAME.xml` loads as it is, with keyframes of the first and the last step; `NAME_qpos.csv` has a row a step: `time`
    (s), then `qpos` in MuJoCo's order (hinge rad, slide m, ball and free quaternions w, x, y, z; objects last). With a
    row of it, `mj_forward` puts every body where it was in the rollout. Masses, joint springs, limits, pads and
    friction are those of the record; the contact model, the driven root and compliance over time are not MuJoCo's,
    so it plays the motion and does not simulate it again. Segments are drawn as capsules that touch nothing.

    **Returns** both paths. **Errors**: `FileError` if one cannot be written.
    """
    path = Path(path)
    table = path.with_name(f"{path.stem}_qpos.csv")
    names, qpos = mujoco_coordinates(rollout)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time", *names])
    writer.writerows(np.column_stack([np.asarray(rollout.time, float), qpos]).tolist())
    write_bytes(table, text.getvalue().encode())
    return write_bytes(path, mujoco_model(rollout, qpos).encode()), table


def mujoco_coordinates(rollout: Rollout) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of MuJoCo's coordinates and their values `[time, nq]`, in the order of the model that is written."""
    model, q = rollout.model, np.asarray(rollout.q, float)
    suffixes = {"hinge": ("",), "slide": ("",), "ball": ("_qw", "_qx", "_qy", "_qz")}
    free = ("_x", "_y", "_z", "_qw", "_qx", "_qy", "_qz")
    names: list[str] = []
    columns = [np.zeros((len(q), 0))]
    for body in _depth_first(model):
        for joint in _joints(model, body):
            names += [model.joint_names[joint] + end for end in suffixes.get(model.joint_types[joint], free)]
            columns.append(q[:, model.coordinate_slices[joint]])
    for number, name in enumerate(rollout.object_names):
        names += [name + end for end in free]
        columns += [np.asarray(rollout.object_position, float)[:, number],
                    np.asarray(rollout.object_quaternion, float)[:, number]]  # fmt: skip
    return tuple(names), np.concatenate(columns, axis=1)


def mujoco_model(rollout: Rollout, qpos: np.ndarray) -> str:
    """The model as XML text, with the first and last row of `qpos` as keyframes."""
    model, scene = rollout.model, scene_content(rollout.scene)
    root = ElementTree.Element("mujoco", model=rollout.name)
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    gravity = scene.get("gravity", np.asarray(model.gravity, float).tolist())
    ElementTree.SubElement(root, "option", timestep=_text(scene.get("step", 0.002)), gravity=_text(gravity))
    default = ElementTree.SubElement(root, "default")
    ElementTree.SubElement(ElementTree.SubElement(default, "default", {"class": "pad"}), "geom", type="sphere")
    looks = {"contype": "0", "conaffinity": "0", "group": "1", "rgba": "0.44 0.54 0.67 0.7"}
    ElementTree.SubElement(ElementTree.SubElement(default, "default", {"class": "segment"}), "geom", looks)
    assets = ElementTree.SubElement(root, "asset")
    world = ElementTree.SubElement(root, "worldbody")
    ElementTree.SubElement(world, "light", pos="0 0 1.5", dir="0 0 -1", directional="true")
    for entry in scene.get("surfaces", ()):
        add_shape(world, assets, entry, {"rgba": "0.73 0.69 0.62 1"})
    _add_bodies(world, model)
    for name in rollout.object_names:
        _add_object(world, assets, model, name, next(
            (entry for entry in scene.get("objects", ()) if entry["name"] == name), {}
        ))  # fmt: skip
    if not len(assets):
        root.remove(assets)
    keys = ElementTree.SubElement(root, "keyframe")
    for name, row in (("first", 0), ("last", -1)):
        ElementTree.SubElement(keys, "key", name=name, time=_text(rollout.time[row]), qpos=_text(qpos[row]))
    ElementTree.indent(root)
    return ElementTree.tostring(root, encoding="unicode") + "\n"


def _add_bodies(world: Any, model: Model) -> None:
    elements = {0: world}
    _add_points(world, model, 0)
    for body in _depth_first(model):
        element = ElementTree.SubElement(
            elements[int(model.body_parents[body])],
            "body",
            name=model.body_names[body],
            pos=_text(model.body_position[body]),
            quat=_quaternion(model.body_rotation[body]),
        )
        elements[body] = element
        if float(model.body_mass[body]) > 0:
            _add_inertia(element, model.body_mass[body], model.body_com[body], model.body_inertia[body])
        for joint in _joints(model, body):
            _add_joint(element, model, joint)
        _add_points(element, model, body)


def _add_points(element: Any, model: Model, body: int) -> None:
    """Pads, sites and what shows the segment."""
    for bone in bones(model):
        if bone.body == body:
            ends, radius = np.concatenate([bone.start, bone.end]), 0.5 * (bone.start_radius + bone.end_radius)
            ElementTree.SubElement(
                element, "geom", {"class": "segment", "type": "capsule"}, fromto=_text(ends), size=_text(radius),
                mass="0",
            )  # fmt: skip
    for pad, owner in enumerate(model.pad_bodies):
        if owner == body:
            place = {"pos": _text(model.pad_centre[pad])}
            if pad in model.capsule_pads:
                axis = np.asarray(model.pad_axis)[pad]
                ends = np.concatenate(
                    [model.pad_centre[pad] + axis, model.pad_centre[pad] - axis]
                )  # the second end is below
                place = {"type": "capsule", "fromto": _text(ends)}
            ElementTree.SubElement(
                element,
                "geom",
                {"class": "pad", **place},
                name=model.pad_names[pad],
                size=_text(model.pad_radius[pad]),
                user=_text(model.pad_compliance[pad]),
                mass="0",
            )
    for site, owner in enumerate(model.site_bodies):
        if owner == body:
            place = _text(model.site_position[site])
            ElementTree.SubElement(element, "site", name=model.site_names[site], pos=place, size="0.003", group="4")


def _add_joint(element: Any, model: Model, joint: int) -> None:
    kind, dofs, at = model.joint_types[joint], model.dof_slices[joint], model.coordinate_slices[joint].start
    values = {"type": kind, "name": model.joint_names[joint]}
    armature = float(np.max(np.asarray(model.armature)[dofs], initial=0.0))
    damping, compliance = np.asarray(model.damping)[dofs], float(model.compliance[dofs.start])
    if armature > 0:
        values["armature"] = _text(armature)
    if damping[0] > 0 and np.ptp(damping) == 0:  # MuJoCo has one number for all directions
        values["damping"] = _text(damping[0])
    if kind != "free" and np.isfinite(compliance) and compliance > 0:
        values["stiffness"] = _text(1.0 / compliance)
    if kind in ("hinge", "slide"):
        values |= {"axis": _text(model.joint_axis[joint]), "pos": _text(model.joint_position[joint])}
        values |= {"ref": _text(model.zero[at]), "springref": _text(model.rest[at])}
        ends = np.array([model.lower[at], model.upper[at]], float)
        if np.isfinite(ends).any():
            values["range"] = _text(np.clip(ends, -ENDLESS, ENDLESS))
    elif kind == "ball":
        values["pos"] = _text(model.joint_position[joint])
    ElementTree.SubElement(element, "joint", values)


def _add_object(world: Any, assets: Any, model: Model, name: str, entry: dict[str, Any]) -> None:
    body = ElementTree.SubElement(world, "body", name=name if name not in model.body_names else f"{name} (object)")
    ElementTree.SubElement(body, "freejoint", name=name if name not in model.joint_names else f"{name} (object)")
    if "mass" in entry:
        _add_inertia(body, entry["mass"], entry["com"], entry["inertia"])
    if not add_shape(body, assets, entry, {"rgba": "0.48 0.32 0.58 1"}) and "mass" not in entry:
        ElementTree.SubElement(body, "geom", type="sphere", size="0.005", contype="0", conaffinity="0")


def _add_inertia(element: Any, mass: Any, com: Any, inertia: Any) -> None:
    inertia = np.asarray(inertia, float)
    six = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
    ElementTree.SubElement(element, "inertial", pos=_text(com), mass=_text(mass), fullinertia=_text(six))


def _depth_first(model: Model) -> list[int]:
    """Bodies in the order in which MuJoCo numbers them, the world left out."""
    order, waiting = [], [0]
    while waiting:
        body = waiting.pop()
        order.append(body)
        children = [number for number in range(1, len(model.body_names)) if model.body_parents[number] == body]
        waiting += reversed(children)
    return order[1:]


def _joints(model: Model, body: int) -> list[int]:
    return [joint for joint, owner in enumerate(model.joint_bodies) if owner == body]


def _quaternion(rotation: Any) -> str:
    return _text(Rotation.from_matrix(np.asarray(rotation, float)).as_quat(scalar_first=True))


def _text(values: Any) -> str:
    """Numbers with every digit."""
    return " ".join(repr(float(value)) for value in np.atleast_1d(np.asarray(values, float)).reshape(-1))
