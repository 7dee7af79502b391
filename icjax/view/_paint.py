"""Solids painted in two dimensions: a camera, and triangles from the farthest to the nearest."""

from typing import Any, NamedTuple

import numpy as np

from icjax.view._extras import require

LIGHT = np.array([0.35, 0.55, 0.76])
"""Where the light is: along the side of the camera, up, and towards it."""

SHADE = 0.45
"""Brightness of a face that is turned away from the light."""


class Camera(NamedTuple):
    """Where a picture is taken from: `eye` and the directions to its right, up and back (towards the eye), world."""

    eye: np.ndarray
    right: np.ndarray
    up: np.ndarray
    back: np.ndarray
    focal: float

    def project(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places `[..., 2]` in the picture, whose half height is 1, and distances `[...]` along the view, m."""
        away = points - self.eye
        depth = -(away @ self.back)
        flat = np.stack([away @ self.right, away @ self.up], axis=-1)
        return self.focal * flat / np.maximum(depth, 1e-9)[..., None], depth


def camera_at(eye: np.ndarray, focus: np.ndarray, up: np.ndarray, field: float) -> Camera:
    """A camera that looks at a point, with a vertical field of view in rad."""
    back = (eye - focus) / np.linalg.norm(eye - focus)
    right = np.cross(up, back)
    right = right / np.linalg.norm(right)
    return Camera(eye, right, np.cross(back, right), back, 1.0 / np.tan(0.5 * field))


class Faces(NamedTuple):
    """Triangles `[n, 3, 3]` (m, world) with colours `[n, 3]`, 0 to 1."""

    corners: np.ndarray
    colour: np.ndarray


def faces_of(vertices: np.ndarray, faces: np.ndarray, colour: tuple[int, int, int]) -> Faces:
    """Triangles of one colour."""
    return Faces(vertices[faces], np.broadcast_to(np.array(colour) / 255.0, (len(faces), 3)))


def together(parts: list[Faces]) -> Faces:
    """All triangles of several parts."""
    if not parts:
        return Faces(np.zeros((0, 3, 3)), np.zeros((0, 3)))
    return Faces(*(np.concatenate(items) for items in zip(*parts, strict=True)))


def paint(axis: Any, camera: Camera, parts: list[Faces], order: float, flat: bool = False) -> None:
    """Draw triangles that face the camera, shaded, the farthest first; `flat` ones from both sides in their colour."""
    corners, colour = together(parts)
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normal, axis=1)
    middle = corners.mean(axis=1)
    facing = np.sum(normal * (camera.eye - middle), axis=1)
    facing = np.abs(facing) if flat else facing
    places, depth = camera.project(corners)
    seen = (facing > 0) & (length > 0) & (depth.min(axis=1) > 1e-3)
    normal, colour = normal[seen] / length[seen, None], colour[seen]
    light = LIGHT @ np.stack([camera.right, camera.up, camera.back])
    bright = (
        np.ones(len(normal))
        if flat
        else SHADE + (1.0 - SHADE) * np.clip(normal @ light / np.linalg.norm(light), 0.0, 1.0)
    )
    rows = np.argsort(-depth[seen].mean(axis=1))
    shades = np.clip(bright[:, None] * colour, 0.0, 1.0)[rows]
    collection = require("matplotlib.collections").PolyCollection
    axis.add_collection(
        collection(places[seen][rows], facecolors=shades, edgecolors=shades, linewidths=0.4, zorder=order)
    )
