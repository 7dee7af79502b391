"""Contact forces and friction cones of the 3-D scene: meshes that are moved and scaled."""

from typing import Any

import numpy as np

from icjax.view._frames import LONGEST, REACH, SEEN, Frames
from icjax.view._meshes import arrow_meshes, cone_mesh

CONE = 0.13
"""Height of a friction cone, in scene sizes."""

CONE_COLOUR = (120, 130, 150)


class Arrows:
    """Contact force arrows, one for each pair and colour, shown or hidden and stretched.

    viser's own arrows change their arrays in place, which also changes the copy that a recording has already taken.
    """

    def __init__(self, server: Any, size: float, shown: Frames, root: str = ""):
        self.size, self.scale, self.shown = size, REACH * size / shown.largest, shown
        self.nodes: dict[tuple[int, tuple[int, int, int]], tuple[Any, Any, Any]] = {}
        shaft, head = arrow_meshes(0.01 * size, 0.024 * size, 0.06 * size)
        self.root = server.scene.add_frame(f"{root}/force", show_axes=False)
        colours = shown.colour
        for pair in range(colours.shape[1]):
            for colour in sorted({_tuple(value) for value in colours[:, pair]}):
                path = root + "/force/{}-{:02x}{:02x}{:02x}".format(pair, *colour)
                self.nodes[pair, colour] = (
                    server.scene.add_frame(path, show_axes=False, visible=False),
                    server.scene.add_mesh_simple(f"{path}/shaft", *shaft, color=colour),
                    server.scene.add_mesh_simple(f"{path}/head", *head, color=colour),
                )

    def place(self, k: int) -> None:
        """Show the forces of one frame; a force too small to see is hidden."""
        point, force, colour = self.shown.pairs.point[k], self.shown.pairs.force[k], self.shown.colour[k]
        for (pair, own), (node, shaft, head) in self.nodes.items():
            size = float(np.linalg.norm(force[pair]))
            length = min(size * self.scale, LONGEST * self.size)
            seen = length > SEEN * self.size and bool(np.isfinite(point[pair]).all()) and _tuple(colour[pair]) == own
            node.visible = seen
            if seen:
                node.position, node.wxyz = point[pair], from_z(force[pair] / size)
                shaft.scale = (1.0, 1.0, length)
                head.position = (0.0, 0.0, length)


class Cones:
    """Friction cones of the contacts of the hand, where they press: a force on the surface of one slides."""

    def __init__(self, server: Any, size: float, shown: Frames, root: str = ""):
        self.shown, self.nodes = shown, {}
        self.root = server.scene.add_frame(f"{root}/cone", show_axes=False, visible=False)
        for pair, (bodies, friction) in enumerate(zip(shown.pairs.bodies, shown.pairs.friction, strict=True)):
            if shown.pairs.on_hand[pair] and np.isfinite(friction) and friction > 0:
                path, mesh = f"{root}/cone/{'-'.join(bodies)}", cone_mesh(CONE * size, friction * CONE * size)
                self.nodes[pair] = server.scene.add_mesh_simple(
                    path, *mesh, color=CONE_COLOUR, opacity=0.35, side="double", visible=False, cast_shadow=False
                )

    def place(self, k: int) -> None:
        """Show the cones of one frame."""
        pairs = self.shown.pairs
        for pair, node in self.nodes.items():
            node.visible = bool(pairs.state[k, pair] > 0 and np.isfinite(pairs.point[k, pair]).all())
            if node.visible:
                node.position, node.wxyz = pairs.point[k, pair], from_z(pairs.normal[k, pair])


def from_z(direction: np.ndarray) -> np.ndarray:
    """Shortest rotation from +z to a unit vector, as a quaternion (w, x, y, z)."""
    if direction[2] < -1.0 + 1e-9:
        return np.array([0.0, 1.0, 0.0, 0.0])
    quaternion = np.array([1.0 + direction[2], -direction[1], direction[0], 0.0])
    return quaternion / np.linalg.norm(quaternion)


def _tuple(colour: np.ndarray) -> tuple[int, int, int]:
    return (int(colour[0]), int(colour[1]), int(colour[2]))
