"""Where the joints and the fingertip went, and where they meant to go."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.typing import Real
from icjax.view._objects import Moving, moving, upward
from icjax.view._skeleton import pad_path, scalar_joints, up_direction
from icjax.view._solids import silhouette
from icjax.view._style import (
    CONTACT,
    INK,
    MEASURED,
    REFERENCE,
    SIMULATED,
    legend_above,
    new_figure,
    styled,
    thinned,
)
from icjax.view._surfaces import Shape, draw_ground, profile, scene_name, scene_surfaces, touched_plane

if TYPE_CHECKING:
    from matplotlib.figure import Figure

BESIDE = 0.1
"""m beyond the fingertip's path within which objects are kept in its picture."""

TOUCH_FORCE = 0.05
"""N; above this a measured force counts as contact when a figure shades intervals."""


def contact_intervals(
    interaction: Interaction | Recording, threshold: float = TOUCH_FORCE
) -> list[tuple[float, float]]:
    """Start and end (s) of every stretch in which some measured contact force exceeds `threshold` (N)."""
    force = np.linalg.norm(np.nan_to_num(np.asarray(interaction.contact_force, dtype=float)), axis=-1)
    touching = np.concatenate([[False], (force > threshold).any(axis=1), [False]])
    edges = np.flatnonzero(np.diff(touching.astype(int)))
    time = np.asarray(interaction.time, dtype=float)
    last = len(time) - 1
    return [
        (float(time[start]), float(time[min(stop, last)])) for start, stop in zip(edges[::2], edges[1::2], strict=True)
    ]


@styled
def plot_angles(interaction: Interaction | Recording, valid: Real | None = None) -> "Figure":
    """Hinges and slides as measured and their reference trajectory theta_r = theta - C tau (Eq. 1), a row a joint.

    A recording has no reference yet: its angles alone. Frames where `valid` (of the recording) is false have no pose
    and are left blank. Shaded: contact. Band: 95 % of the reference's stated uncertainty (its standard deviation times
    1.96).

    **Errors**: `ValueError` where the model has neither a hinge nor a slide.
    """
    joints = scalar_joints(interaction.model)
    if not joints:
        raise ValueError(f"model {interaction.model.name!r} has neither a hinge nor a slide to draw")
    kept = thinned(len(interaction.time))
    time = np.asarray(interaction.time, dtype=float)[kept]
    known = np.ones(len(time), bool) if valid is None else np.asarray(valid, bool)[kept]
    intervals = contact_intervals(interaction)
    figure = new_figure(7.6, 0.5 + 1.25 * len(joints))
    axes = figure.subplots(len(joints), 1, sharex=True, squeeze=False)[:, 0]
    for axis, joint in zip(axes, joints, strict=True):
        for start, stop in intervals:
            axis.axvspan(start, stop, color=CONTACT, alpha=0.8, lw=0)
        measured = joint.scale * np.asarray(interaction.q, dtype=float)[kept, joint.coordinate]
        axis.plot(time, np.where(known, measured, np.nan), color=MEASURED, label="measured θ")
        if isinstance(interaction, Interaction):
            reference = joint.scale * np.asarray(interaction.reference, dtype=float)[kept, joint.coordinate]
            spread = 1.96 * joint.scale * np.asarray(interaction.reference_sd, dtype=float)[kept, joint.dof]
            reference, spread = (np.where(known, course, np.nan) for course in (reference, spread))
            axis.fill_between(time, reference - spread, reference + spread, color=REFERENCE, alpha=0.22, lw=0)
            axis.plot(time, reference, color=REFERENCE, ls=(0, (4, 2)), label="reference θr")
        axis.set_ylabel(f"{joint.name} ({joint.unit})")
        axis.margins(x=0.0)
    axes[-1].set_xlabel("time (s)")
    figure.align_ylabels(list(axes))
    legend_above(axes[0])
    return figure


@styled
def plot_path(interaction: Interaction | None, rollouts: tuple[Rollout, ...] = ()) -> "Figure":
    """Path of the fingertip over each surface, seen from the side; both axes in mm at the same scale.

    The lines are the pad's lowest point (its centre less its radius along the vertical); a pad pressed into a
    surface therefore runs slightly below it. Heights are those of the world, along its vertical. Fixed solids are cut
    in the plane of the path; objects are seen from the side, dashed where they began and filled where they ended.

    **Errors**: `ValueError` where there is neither an interaction nor a rollout, or no frame has a pose.
    """
    if interaction is None and not rollouts:
        raise ValueError("nothing to draw: give an interaction or at least one rollout")
    model = interaction.model if interaction is not None else rollouts[0].model
    up = next((upward(item) for item in rollouts if item.object_names), up_direction(model))
    drop = (float(model.pad_radius[0]) if len(model.pad_names) else 0.0) * up
    measured = None if interaction is None else pad_path(model, interaction.q[thinned(len(interaction.q))]) - drop
    panels: list[_Panel] = [
        _Panel(
            scene_name(item),
            scene_surfaces(item.scene),
            pad_path(item.model, item.q[thinned(len(item.q))]) - drop,
            SIMULATED[i % len(SIMULATED)],
            moving(item, np.array([0, -1])),
        )
        for i, item in enumerate(rollouts)
    ]
    if not panels and interaction is not None:
        panels = [_Panel(interaction.name, touched_plane(interaction), None, MEASURED, ())]
    paths = [path for path in (measured, *(panel.path for panel in panels)) if path is not None]
    everything = np.concatenate(paths)
    everything = everything[np.isfinite(everything).all(axis=1)]
    if not len(everything):
        raise ValueError("no frame has a pose, there is no path to draw")
    along = _main_direction(everything, up)
    origin = everything.mean(axis=0)
    origin = origin - up * (origin @ up)

    distance, levels = (everything - origin) @ along, (everything - origin) @ up
    start, stop = distance.min() - 0.01, distance.max() + 0.01
    outlines = [panel.outlines(origin, along, up) for panel in panels]
    highest = [float(levels.max())]
    farthest = start - BESIDE, stop + BESIDE
    for outline in (outline for found in outlines for outline in found):
        left, right = outline[:, 0].min() - 0.005, outline[:, 0].max() + 0.005
        if farthest[0] < right and left < farthest[1]:
            start, stop = min(start, max(left, farthest[0])), max(stop, min(right, farthest[1]))
            highest.append(float(outline[:, 1].max()))
    reach = np.linspace(start, stop, 400)
    heights = [profile(panel.surfaces, origin, along, up, reach) for panel in panels]
    lowest = [float(np.nanmin(height)) for height in heights if np.isfinite(height).any()]
    floor = min([float(levels.min()), *lowest]) - 0.006
    ceiling = min(max(highest), float(levels.max()) + BESIDE) + 0.004
    shape = np.clip((ceiling - floor) / (reach[-1] - reach[0]), 0.12, 0.5)
    figure = new_figure(7.6, 0.3 + len(panels) * (0.35 + 6.6 * float(shape)))
    axes = figure.subplots(len(panels), 1, sharex=True, sharey=True, squeeze=False)[:, 0]
    for axis, panel, found in zip(axes, panels, outlines, strict=True):
        path = panel.path
        draw_ground(axis, panel.surfaces, origin, along, up, reach, floor, 1.0)
        for body, (first, last) in zip(panel.objects, zip(found[::2], found[1::2], strict=True), strict=True):
            axis.plot(*1e3 * first.T, color=body.colour, lw=0.9, ls=(0, (3, 2)))
            axis.fill(*1e3 * last.T, facecolor=body.colour, edgecolor=body.colour, alpha=0.4, lw=0.9, zorder=1.5)
            shown = first if last[:, 0].max() < start or last[:, 0].min() > stop else last
            middle = 500.0 * (shown.min(axis=0) + shown.max(axis=0))
            axis.annotate(body.solid.name, middle, color=body.colour, fontsize=8.0, ha="center", va="center")
        if path is not None:
            axis.plot(*_cut(path, origin, along, up), color=panel.colour, lw=2.0, label="simulated")
        if measured is not None:
            dash = "-" if path is None else (0, (3, 2))
            axis.plot(*_cut(measured, origin, along, up), color=MEASURED, lw=1.0, ls=dash, label="measured")
        axis.set_title(panel.title, color=INK)
        axis.set_ylabel("height (mm)")
        axis.set_aspect("equal")
        axis.set_ylim(1e3 * floor, 1e3 * ceiling)
        axis.set_xlim(1e3 * reach[0], 1e3 * reach[-1])
        legend_above(axis)
    axes[-1].set_xlabel("distance along the stroke (mm)")
    return figure


class _Panel(NamedTuple):
    """What `plot_path` draws of one record; `objects` at the start and at the end."""

    title: str
    surfaces: tuple[Shape, ...]
    path: np.ndarray | None
    colour: str
    objects: tuple[Moving, ...]

    def outlines(self, origin: np.ndarray, along: np.ndarray, up: np.ndarray) -> list[np.ndarray]:
        """Of every object at the start and at the end, seen from the side, m."""
        views = [body.at(row, body.solid.vertices) - origin for body in self.objects for row in (0, 1)]
        return [silhouette(np.stack([points @ along, points @ up], axis=1)) for points in views]


def _main_direction(points: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Horizontal unit direction in which the points spread most."""
    level = points - points.mean(axis=0)
    level = level - np.outer(level @ up, up)
    direction = np.linalg.svd(level, full_matrices=False)[2][0]
    largest = np.argmax(np.abs(direction))
    return direction * np.sign(direction[largest])


def _cut(path: np.ndarray, origin: np.ndarray, along: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return 1e3 * (path - origin) @ along, 1e3 * (path - origin) @ up
