"""What the figures of a hand share: a parallel view, fingers and pads, solids on a table, arrows of forces."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from icjax.model import Model, forward_kinematics, pad_positions
from icjax.view import Solid

COLOURS = {"thumb": "#D55E00", "index": "#0072B2", "middle": "#009E73", "ring": "#CC79A7", "little": "#B8860B"}
INK, GREY, TABLE, SHADOW = "#1F2430", "#8A8F98", "#F1EEE8", "#DDD7CC"


class View(NamedTuple):
    """Where the viewer is, rad; far away, so that parallels stay parallel."""

    azimuth: float
    elevation: float

    @property
    def towards(self) -> np.ndarray:
        """Unit vector to the viewer."""
        level = np.cos(self.elevation)
        return np.array([level * np.cos(self.azimuth), level * np.sin(self.azimuth), np.sin(self.elevation)])

    @property
    def axes(self) -> np.ndarray:
        """Unit vectors `[3, 2]` to the right and upwards in the picture."""
        right = np.array([-np.sin(self.azimuth), np.cos(self.azimuth), 0.0])
        return np.stack([right, np.cross(self.towards, right)], axis=1)

    def seen(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Place in the picture `[n, 2]` and nearness to the viewer `[n]`, both in mm."""
        points = 1e3 * np.asarray(points)
        return points @ self.axes, points @ self.towards


def plotting() -> Any:
    """Matplotlib without a screen."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    return pyplot


def bones(model: Model, q: np.ndarray) -> tuple[list[tuple[str, np.ndarray]], np.ndarray]:
    """Lines of the fingers with the names of these, and the places of the pads, m."""
    origins = np.asarray(forward_kinematics(model, q).position)
    pads = np.asarray(pad_positions(model, q))
    found = []
    for body, parent in enumerate(model.body_parents):
        if parent > 0 and "_" in model.body_names[body]:
            found.append((model.body_names[body].split("_")[0], origins[[parent, body]]))
    for pad, body in zip(pads, model.pad_bodies, strict=True):
        found.append((model.body_names[body].split("_")[0], np.stack([origins[body], pad])))
    return found, pads


def draw_hand(
    axis: Any,
    view: View,
    model: Model,
    q: np.ndarray,
    pressing: np.ndarray,
    middle: np.ndarray,
    rim: str | None = None,
    size: float = 8.5,
) -> None:
    """Fingers, and pads that are filled where they press; what lies behind `middle` (m) is drawn first.

    `rim` is a colour for the edge of the pads, in place of the finger's own; `size` their diameter, points.
    """
    ends, pads = bones(model, q)
    between = view.seen(middle[None])[1][0]
    for behind in (True, False):
        order = 1 if behind else 5
        for finger, line in ends:
            place, near = view.seen(line)
            if (near.mean() < between) == behind:
                axis.plot(*place.T, color=COLOURS.get(finger, "#C9A58B"), linewidth=4, alpha=0.55, zorder=order,
                          solid_capstyle="round")  # fmt: skip
        for number, name in enumerate(model.pad_names):
            place, near = view.seen(pads[number][None])
            if (near[0] < between) == behind:
                face = COLOURS[name] if pressing[number] else "white"
                axis.plot(*place[0], "o", color=rim or COLOURS[name], markerfacecolor=face, markersize=size,
                          zorder=order + 1)  # fmt: skip


def draw_solid(axis: Any, view: View, solid: Solid, rotation: np.ndarray, position: np.ndarray, colour: str) -> None:
    """A convex solid where it is, with the edges (or circles) that can be seen, and its shadow on a table at z = 0."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgb

    vertices = solid.vertices @ rotation.T + position
    lines = solid.lines @ rotation.T + position
    below = view.seen(vertices * [1.0, 1.0, 0.0])[0]
    axis.fill(*below[ConvexHull(below).vertices].T, facecolor=SHADOW, edgecolor="none", zorder=0.2)
    corners = vertices[solid.faces]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    facing = normal @ view.towards > 0
    light = 0.80 + 0.20 * np.clip(normal[facing] @ np.array([-0.2, -0.75, 0.63]), 0.0, 1.0)
    paint = np.clip(light[:, None] * np.array(to_rgb(colour)), 0.0, 1.0)
    faces = view.seen(corners[facing])[0]
    axis.add_collection(PolyCollection(faces, facecolors=paint, edgecolors=paint, linewidths=0.3, zorder=3))
    over = lines.mean(axis=1) @ normal[facing].T > np.sum(normal * corners[:, 0], axis=1)[facing]
    axis.add_collection(LineCollection(view.seen(lines[over.any(axis=1)])[0], colors=GREY, linewidths=0.8, zorder=3.5))


def draw_table(axis: Any, view: View, low: tuple[float, float], high: tuple[float, float]) -> None:
    """A piece of the plane z = 0 between two corners, m."""
    corners = np.array([[low[0], low[1], 0], [high[0], low[1], 0], [high[0], high[1], 0], [low[0], high[1], 0]])
    axis.fill(*view.seen(corners)[0].T, facecolor=TABLE, edgecolor=SHADOW, linewidth=0.8, zorder=0)


def draw_arrow(axis: Any, start: np.ndarray, end: np.ndarray, colour: str = INK, width: float = 1.8) -> None:
    """From one place of the picture to another, with a white border; nothing where it is shorter than 1 mm."""
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.patheffects import withStroke

    length = float(np.linalg.norm(end - start))
    if length < 1.0:
        return
    head, size = "-|>,head_width=0.22,head_length=0.38", min(9.0, 3.0 + 0.4 * length)
    arrow = FancyArrowPatch(start, end, arrowstyle=head, mutation_scale=size, color=colour, linewidth=width,
                            shrinkA=0, shrinkB=0, joinstyle="miter", capstyle="butt", zorder=9)  # fmt: skip
    arrow.set_path_effects([withStroke(linewidth=width + 1.6, foreground="white")])
    axis.add_patch(arrow)


def framed(axis: Any, low: tuple[float, float], high: tuple[float, float]) -> None:
    """Limits of a picture in mm, equal scales, no frame."""
    axis.set_xlim(low[0], high[0])
    axis.set_ylim(low[1], high[1])
    axis.set_aspect("equal")
    axis.axis("off")
