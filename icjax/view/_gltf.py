"""glTF 2.0 in one binary file (GLB): meshes, nodes and their movement, as the specification lays them out."""

import json
import struct
from typing import Any

import numpy as np

from icjax.view._style import rgb

FLOAT, UNSIGNED = 5126, 5125
"""Component types."""

VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""

KINDS = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


class Gltf:
    """A scene that is built node by node.

    Translations are in m, rotations unit quaternions (w, x, y, z), which the file has as (x, y, z, w).
    """

    def __init__(self, name: str, note: dict[str, Any]):
        self._blob = bytearray()
        self._content: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "icjax", "extras": note},
            "scene": 0,
            "scenes": [{"name": name, "nodes": []}],
        }
        self._clip: dict[str, Any] = {"name": name, "channels": [], "samplers": []}

    def material(self, name: str, colour: str | tuple[int, int, int], two_sided: bool = False) -> int:
        """A dull colour, given in sRGB."""
        shades = np.array(rgb(colour) if isinstance(colour, str) else colour) / 255.0
        linear = np.where(shades <= 0.04045, shades / 12.92, ((shades + 0.055) / 1.055) ** 2.4)
        base = {"baseColorFactor": [*linear.tolist(), 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.75}
        return self._add("materials", {"name": name, "pbrMetallicRoughness": base, "doubleSided": two_sided})

    def mesh(self, vertices: np.ndarray, faces: np.ndarray, material: int, flat: bool = False) -> int:
        """Triangles, smooth (with normals) or flat (without, as the specification has it)."""
        attributes = {"POSITION": self._array(vertices, np.float32, VERTICES, bounds=True)}
        if not flat:
            from trimesh import Trimesh

            normals = np.array(Trimesh(vertices, faces, process=False).vertex_normals)
            length = np.linalg.norm(normals, axis=1, keepdims=True)
            normals = np.where(length > 0, normals / np.where(length > 0, length, 1.0), np.array([0.0, 0.0, 1.0]))
            attributes["NORMAL"] = self._array(normals, np.float32, VERTICES)
        indices = self._array(faces.reshape(-1), np.uint32, INDICES)
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        return self._add("meshes", {"primitives": [primitive]})

    def node(
        self,
        name: str,
        parent: int | None = None,
        mesh: int | None = None,
        translation: np.ndarray | None = None,
        rotation: np.ndarray | None = None,
        scale: np.ndarray | None = None,
    ) -> int:
        """A frame in its parent's, or in the world's."""
        content: dict[str, Any] = {"name": name}
        if mesh is not None:
            content["mesh"] = mesh
        if translation is not None:
            content["translation"] = np.asarray(translation, float).tolist()
        if rotation is not None:
            content["rotation"] = np.roll(np.asarray(rotation, float), -1).tolist()
        if scale is not None:
            content["scale"] = np.asarray(scale, float).tolist()
        number = self._add("nodes", content)
        if parent is None:
            self._content["scenes"][0]["nodes"].append(number)
        else:
            self._content["nodes"][parent].setdefault("children", []).append(number)
        return number

    def times(self, seconds: np.ndarray) -> int:
        """Times of an animation, s, from zero on."""
        return self._array(seconds, np.float32, None, bounds=True)

    def move(self, node: int, path: str, times: int, values: np.ndarray, stepwise: bool = False) -> None:
        """Move a node along `values` `[time, 3 or 4]` of its "translation", "rotation" or "scale"."""
        if path == "rotation":
            values = np.roll(continuous(values), -1, axis=1)
        sampler = {
            "input": times,
            "output": self._array(values, np.float32, None),
            "interpolation": "STEP" if stepwise else "LINEAR",
        }
        self._clip["samplers"].append(sampler)
        target = {"node": node, "path": path}
        self._clip["channels"].append({"sampler": len(self._clip["samplers"]) - 1, "target": target})

    def to_bytes(self) -> bytes:
        """The file."""
        content = dict(self._content)
        if self._clip["channels"]:
            content["animations"] = [self._clip]
        content["buffers"] = [{"byteLength": len(self._blob)}]
        text = json.dumps(content, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self._blob), 0x004E4942) + bytes(self._blob)
        return struct.pack("<III", 0x46546C67, 2, 12 + len(chunks)) + chunks

    def _add(self, kind: str, item: dict[str, Any]) -> int:
        self._content.setdefault(kind, []).append(item)
        return len(self._content[kind]) - 1

    def _array(self, values: Any, dtype: Any, target: int | None, bounds: bool = False) -> int:
        array = np.ascontiguousarray(values, dtype)
        view = {"buffer": 0, "byteOffset": len(self._blob), "byteLength": array.nbytes}
        if target is not None:
            view["target"] = target
        self._blob += array.tobytes()  # four bytes a number: always aligned
        accessor = {
            "bufferView": self._add("bufferViews", view),
            "componentType": UNSIGNED if dtype == np.uint32 else FLOAT,
            "count": len(array),
            "type": KINDS[array.shape[1] if array.ndim == 2 else 1],
        }
        if bounds:
            rows = array.reshape(len(array), -1)
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        return self._add("accessors", accessor)


def continuous(quaternions: np.ndarray) -> np.ndarray:
    """The same rotations `[time, 4]`, every quaternion on the side of the one before."""
    if len(quaternions) < 2:
        return quaternions
    turned = np.where(np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0, -1.0, 1.0)
    return quaternions * np.concatenate([np.ones(1), np.cumprod(turned)])[:, None]
