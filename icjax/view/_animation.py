"""A record as an animated GLB file, for Blender, slides and viewers."""

import os
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from icjax.files import write_bytes
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import SLIP_STATES, Rollout
from icjax.view._arrows import from_z
from icjax.view._frames import LONGEST, PALETTE, REACH, SEEN, Frames, framing, pick_frames, view_axis
from icjax.view._gltf import Gltf
from icjax.view._meshes import arrow_mesh, bone_mesh
from icjax.view._objects import upward
from icjax.view._scene_things import BUMP_COLOUR, PLATE_COLOUR
from icjax.view._skeleton import bones
from icjax.view._solids import Solid
from icjax.view._stage import BODY_COLOUR, SPREAD
from icjax.view._surfaces import Bump, Shape, bump_mesh, patch_mesh, surfaces_of

PAD_COLOUR = (201, 146, 118)
MOST = 100_000
"""Frames of a file."""


def export_animation(
    record: Recording | Interaction | Rollout,
    path: str | os.PathLike,
    *,
    rate: float = 60.0,
    forces: bool = True,
    surfaces: tuple[Shape, ...] | None = None,
) -> Path:
    """Write a record as a GLB file (glTF 2.0) that moves: segments, pads, objects, surfaces, contact forces.

    Lengths in m, y up as glTF has it: one node turns the world of the record. Every body and object is a node with its
    name and its pose in that world, frame by frame as in the record, straight between frames. An arrow of a force has a
    node for each slip state, scaled to nothing while it is in another one; the largest force on the hand is as long as
    half the scene, and `extras` of the file tell m per N and the time of the first frame.

    **Arguments**: `rate` most frames a second, picked, not averaged; `forces` whether arrows are written; `surfaces`
    instead of those of the record.

    **Returns** the path. **Errors**: `ValueError` where no frame has a pose; `FileError` if it cannot be written.
    """
    shown = pick_frames(record, MOST, rate)
    shapes = surfaces_of(record) if surfaces is None else surfaces
    focus, size = framing(record, shown)
    up = upward(record)
    per_newton = REACH * size / shown.largest
    note = {"first_frame_s": float(shown.time[0]), "metres_per_newton": per_newton if forces else None}
    gltf = Gltf(record.name, note)
    turn = Rotation.align_vectors(np.array([[0.0, 1.0, 0.0]]), up[None])[0].as_quat(scalar_first=True)
    world = gltf.node("scene", rotation=turn)
    times = gltf.times(shown.time - shown.time[0])
    _add_hand(gltf, world, times, record, shown)
    for body in shown.objects:
        mesh = gltf.mesh(body.solid.vertices, body.solid.faces, gltf.material(body.solid.name, body.colour),
                         body.solid.flat)  # fmt: skip
        _add_moving(gltf, world, times, body.solid.name, mesh, body.position, _quaternions(body.rotation))
    along, spread = view_axis(shown, up), SPREAD if shown.objects else 1.0
    for shape in shapes:
        _add_surface(gltf, world, shape, focus, spread * size, along)
    if forces:
        _add_forces(gltf, world, times, shown, size, per_newton)
    return write_bytes(path, gltf.to_bytes())


def _add_hand(gltf: Gltf, world: int, times: int, record: Any, shown: Frames) -> None:
    model, bone, skin = record.model, gltf.material("segment", BODY_COLOUR), gltf.material("pad", PAD_COLOUR)
    parts: dict[int, list[int]] = {number: [] for number in range(1, len(model.body_names))}
    for part in bones(model):
        parts[part.body].append(gltf.mesh(*bone_mesh(part), bone))
    for body, meshes in parts.items():
        turned = _quaternions(shown.rotation[:, body])
        node = _add_moving(gltf, world, times, model.body_names[body], None, shown.position[:, body], turned)
        for number, mesh in enumerate(meshes):
            gltf.node(f"{model.body_names[body]} segment {number}", node, mesh)
        for pad, name in enumerate(model.pad_names):
            if model.pad_bodies[pad] == body and pad not in model.capsule_pads:  # those are bones
                gltf.node(
                    name, node, _ball(gltf, float(model.pad_radius[pad]), skin), np.asarray(model.pad_centre[pad])
                )


def _ball(gltf: Gltf, radius: float, material: int) -> int:
    from trimesh import creation

    ball = creation.icosphere(subdivisions=2, radius=radius)
    return gltf.mesh(np.array(ball.vertices), np.array(ball.faces), material)


def _add_surface(gltf: Gltf, world: int, shape: Shape, focus: np.ndarray, size: float, along: np.ndarray) -> None:
    if isinstance(shape, Solid):
        mesh = gltf.mesh(shape.vertices, shape.faces, gltf.material(shape.name, BUMP_COLOUR), shape.flat)
    elif isinstance(shape, Bump):
        mesh = gltf.mesh(*bump_mesh(shape), gltf.material(shape.name, BUMP_COLOUR, two_sided=True))
    else:
        corners = patch_mesh(shape, focus, (1.15 * size, 0.7 * size), along)
        mesh = gltf.mesh(*corners, gltf.material(shape.name, PLATE_COLOUR, two_sided=True), flat=True)
    gltf.node(shape.name, world, mesh)


def _add_forces(gltf: Gltf, world: int, times: int, shown: Frames, size: float, per_newton: float) -> None:
    pairs = shown.pairs
    length = np.minimum(np.linalg.norm(pairs.force, axis=-1) * per_newton, LONGEST * size)
    seen = (length > SEEN * size) & np.isfinite(pairs.point).all(axis=-1)
    meshes: dict[int, int] = {}
    for pair, bodies in enumerate(pairs.bodies):
        for state in sorted(set(pairs.state[seen[:, pair], pair].tolist())):
            if state not in meshes:
                red, green, blue = (int(part) for part in PALETTE[state])
                own = gltf.material(f"force {SLIP_STATES[state]}", (red, green, blue))
                meshes[state] = gltf.mesh(*arrow_mesh(), own)
            here = seen[:, pair] & (pairs.state[:, pair] == state)
            name = f"force {' on '.join(part for part in bodies if part)} {SLIP_STATES[state]}"
            point = np.where(here[:, None], pairs.point[:, pair], pairs.point[np.argmax(here), pair])
            direction = pairs.force[:, pair] / np.maximum(np.linalg.norm(pairs.force[:, pair], axis=1), 1e-300)[:, None]
            turned = np.array([from_z(axis) if there else [1.0, 0.0, 0.0, 0.0]
                               for axis, there in zip(direction, here, strict=True)])  # fmt: skip
            scale = np.where(here, length[:, pair], 0.0)[:, None] * np.ones(3)
            node = gltf.node(name, world, meshes[state], point[0], turned[0], scale[0])
            for path, values in (("translation", point), ("rotation", turned), ("scale", scale)):
                gltf.move(node, path, times, values, stepwise=True)


def _add_moving(
    gltf: Gltf, world: int, times: int, name: str, mesh: int | None, position: np.ndarray, turned: np.ndarray
) -> int:
    node = gltf.node(name, world, mesh, position[0], turned[0])
    for path, values in (("translation", position), ("rotation", turned)):
        if np.ptp(values, axis=0).any():
            gltf.move(node, path, times, values)
    return node


def _quaternions(rotation: np.ndarray) -> np.ndarray:
    return Rotation.from_matrix(rotation).as_quat(scalar_first=True)
