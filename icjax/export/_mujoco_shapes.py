"""Surfaces and solids of a scene as geoms of MuJoCo."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from icjax.view import parts_of, solid


def add_shape(element: Any, assets: Any, entry: Mapping[str, Any], looks: dict[str, str]) -> bool:
    """Add the geom of a surface or object as a rollout's scene describes it, of a union one geom a part.

    **Returns**: whether it is a shape.
    """
    if entry.get("shape") == "union":
        added = [
            add_shape(
                element, assets, {"friction": entry.get("friction"), **part, "name": f"{entry['name']}.{number}"}, looks
            )
            for number, part in enumerate(parts_of(entry), start=1)
        ]
        return all(added)
    found = _geom(entry, assets)
    if found is None:
        return False
    values, position, rotation = found
    quaternion = Rotation.from_matrix(rotation).as_quat(scalar_first=True)
    values |= {"name": str(entry["name"]), "pos": _text(position), "quat": _text(quaternion), **looks}
    if entry.get("friction") is not None:
        values["friction"] = _text([entry["friction"], 0.005, 0.0001])
    ElementTree.SubElement(element, "geom", values)
    return True


def _geom(entry: Mapping[str, Any], assets: Any) -> tuple[dict[str, str], np.ndarray, np.ndarray] | None:
    """Type and size of a geom, where it is and how it is turned."""
    kind = entry.get("shape")
    position = np.asarray(entry.get("centre", entry.get("position", np.zeros(3))), float)
    rotation = np.asarray(entry.get("rotation", np.eye(3)), float).reshape(3, 3)
    if kind == "plane":
        normal = np.asarray(entry["normal"], float)
        turn = Rotation.align_vectors(normal[None] / np.linalg.norm(normal), np.array([[0.0, 0.0, 1.0]]))[0]
        return {"type": "plane", "size": "1 1 0.05"}, np.asarray(entry["point"], float), turn.as_matrix()
    keys = {
        "box": ("half_sizes",),
        "ellipsoid": ("radii",),
        "sphere": ("radius",),
        "capsule": ("radius", "half_length"),
        "cylinder": ("radius", "half_length"),
    }
    if kind in keys:
        size = np.concatenate([np.atleast_1d(np.asarray(entry[key], float)) for key in keys[kind]])
        return {"type": str(kind), "size": _text(size)}, position, rotation
    body = solid({key: value for key, value in entry.items() if key not in ("position", "rotation")}, "")
    if body is None:
        return None
    name = f"{entry['name']} mesh"
    ElementTree.SubElement(assets, "mesh", name=name, vertex=_text(body.vertices), inertia="convex")
    return {"type": "mesh", "mesh": name}, position, rotation


def _text(values: Any) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values, float).reshape(-1))
