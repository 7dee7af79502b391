"""Triangles of the few solids that the 3-D scene is made of."""

import numpy as np

from icjax.view._skeleton import Bone
from icjax.view._surfaces import grid_faces


def bone_mesh(bone: Bone, rings: int = 7, sectors: int = 20) -> tuple[np.ndarray, np.ndarray]:
    """Tapered capsule of a bone in its body frame: vertices `[n, 3]` (m), faces `[m, 3]`."""
    axis = bone.end - bone.start
    length = float(np.linalg.norm(axis))
    first, second, axis = _frame(axis / length)
    polar = np.linspace(0.0, np.pi / 2, rings)
    heights = np.concatenate([-bone.start_radius * np.cos(polar), length + bone.end_radius * np.sin(polar)])
    widths = np.concatenate([bone.start_radius * np.sin(polar), bone.end_radius * np.cos(polar)])
    turn = np.linspace(0.0, 2.0 * np.pi, sectors, endpoint=False)
    circle = np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second
    vertices = bone.start + heights[:, None, None] * axis + widths[:, None, None] * circle[None]
    return vertices.reshape(-1, 3), grid_faces(2 * rings, sectors)[:, ::-1]


def arrow_meshes(
    shaft_radius: float, head_radius: float, head_length: float, sectors: int = 20
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Shaft of unit length from the origin along z, and head whose middle is at the origin: (vertices, faces) each."""
    turn = np.linspace(0.0, 2.0 * np.pi, sectors, endpoint=False)
    circle = np.stack([np.cos(turn), np.sin(turn), np.zeros_like(turn)], axis=-1)

    def turned(profile: list[tuple[float, float]]) -> tuple[np.ndarray, np.ndarray]:
        rings = [radius * circle + np.array([0.0, 0.0, height]) for radius, height in profile]
        return np.concatenate(rings), grid_faces(len(profile), sectors)[:, ::-1]

    shaft = turned([(0.0, 0.0), (shaft_radius, 0.0), (shaft_radius, 1.0), (0.0, 1.0)])
    back = -0.5 * head_length
    return shaft, turned([(0.0, back), (head_radius, back), (head_radius, back), (0.0, back + head_length)])


def _frame(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Right-handed frame whose third direction is `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    first = np.cross(helper, axis)
    first = first / np.linalg.norm(first)
    return first, np.cross(axis, first), axis


def ruled_lines(vertices: np.ndarray, spacing: float) -> np.ndarray:
    """Lines `[n, 2, 3]` on a rectangle with the given corners `[4, 3]`, `spacing` (m) apart in both directions."""
    lines = []
    corner = vertices[0]
    for along, across in ((vertices[1] - corner, vertices[3] - corner), (vertices[3] - corner, vertices[1] - corner)):
        length = float(np.linalg.norm(along))
        count = int(length / spacing + 1e-9)
        rest = 0.5 * (length - count * spacing)
        for k in range(count + 1):
            start = corner + along / length * (rest + k * spacing)
            lines.append(np.stack([start, start + across]))
    return np.array(lines)


def arrow_mesh() -> tuple[np.ndarray, np.ndarray]:
    """Arrow of unit length from the origin along z, to be scaled: vertices `[n, 3]`, faces `[m, 3]`."""
    (shaft, first), (head, second) = arrow_meshes(0.022, 0.055, 0.16)
    shaft = shaft * np.array([1.0, 1.0, 0.9])
    return np.concatenate([shaft, head + np.array([0.0, 0.0, 0.92])]), np.concatenate([first, second + len(shaft)])


def cone_mesh(height: float, radius: float, sectors: int = 32) -> tuple[np.ndarray, np.ndarray]:
    """Mantle of a cone with its apex at the origin that opens along z: vertices `[n, 3]` (m), faces `[m, 3]`."""
    turn = np.linspace(0.0, 2.0 * np.pi, sectors, endpoint=False)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(sectors, height)], axis=-1)
    around = np.arange(1, sectors + 1)
    return np.concatenate([np.zeros((1, 3)), rim]), np.stack([0 * around, np.roll(around, -1), around], axis=1)
