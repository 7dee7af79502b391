"""Contact forces before and after the interaction is carried to another surface."""

from typing import TYPE_CHECKING, Any

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import SLIP_STATES, Rollout
from icjax.view._skeleton import up_direction
from icjax.view._style import (
    INK,
    MEASURED,
    QUIET,
    SIMULATED,
    SLIDING,
    STICKING,
    legend_above,
    new_figure,
    styled,
    thinned,
)
from icjax.view._surfaces import scene_content, scene_name

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def force_components(record: Recording | Interaction | Rollout) -> tuple[np.ndarray, np.ndarray]:
    """Total normal force on the hand and size of its total tangential force over time.

    In a rollout the normals are those of its contacts; a measured record does not know the surface, so its
    normal is the vertical (a level plate).

    **Returns**: two arrays `[time]`, N.
    """
    force = np.nan_to_num(np.asarray(record.contact_force, dtype=float))
    if isinstance(record, Rollout):
        on_hand = np.array(record.on_hand())
        normal = np.nan_to_num(np.asarray(record.contact_normal, dtype=float))[:, on_hand]
        force = force[:, on_hand]
    else:
        normal = np.broadcast_to(up_direction(record.model), force.shape)
    size = np.sum(force * normal, axis=-1)
    tangential = np.sum(force - size[..., None] * normal, axis=1)
    return size.sum(axis=1), np.linalg.norm(tangential, axis=-1)


def stated_friction(scene: str, pads: tuple[str, ...] = ()) -> float | None:
    """The friction coefficient of a scene when all that the pads may touch shares one, else None.

    Of the pairs with a friction of their own, those with a pad count.
    """
    content = dict(scene_content(scene))
    content["frictions"] = [pair for pair in content.get("frictions", ()) if set(pair["names"]) & set(pads)]
    found: set[float] = set()

    def collect(value: Any) -> None:
        if isinstance(value, dict):
            for key, item in value.items():
                if key == "friction" and isinstance(item, int | float):
                    found.add(float(item))
                elif key == "friction" and isinstance(item, list):
                    found.update(float(entry) for entry in item if isinstance(entry, int | float))
                else:
                    collect(item)
        elif isinstance(value, list):
            for item in value:
                collect(item)

    collect(content)
    return found.pop() if len(found) == 1 else None


@styled
def plot_forces(interaction: Interaction | None, rollouts: tuple[Rollout, ...]) -> "Figure":
    """Normal and tangential contact force on the hand after transfer over the measured ones, as in Figure 4.

    One column a rollout. Dotted: the friction bound mu times the normal force, where the scene states one mu.
    The strip below says whether the contact was open, sticking or sliding.

    **Errors**: `ValueError` where there is neither an interaction nor a rollout.
    """
    if interaction is None and not rollouts:
        raise ValueError("nothing to draw: give an interaction or at least one rollout")
    columns = max(len(rollouts), 1)
    figure = new_figure(max(2.6 * columns, 5.2), 4.2)
    grid = figure.subplots(3, columns, sharex=True, sharey="row", squeeze=False, height_ratios=[1.0, 0.8, 0.09])
    for column in range(columns):
        normal_axis, tangent_axis, strip = grid[:, column]
        if interaction is not None:
            kept = thinned(len(interaction.time))
            time = np.asarray(interaction.time)[kept]
            normal, tangential = (values[kept] for values in force_components(interaction))
            normal_axis.plot(time, normal, color=QUIET, lw=1.1, label="measured")
            tangent_axis.plot(time, tangential, color=QUIET, lw=1.1)
        if rollouts:
            _draw_rollout(normal_axis, tangent_axis, strip, rollouts[column], SIMULATED[column % len(SIMULATED)])
            normal_axis.set_title(scene_name(rollouts[column]))
        strip.set_ylim(0.0, 1.0)
        strip.set_yticks([])
        strip.grid(False)
        strip.spines[:].set_visible(False)
        strip.set_xlabel("time (s)")
        strip.margins(x=0.0)
        legend_above(normal_axis, columns=1 if columns > 2 else 3)
    grid[0, 0].set_ylabel("normal force (N)")
    grid[1, 0].set_ylabel("tangential force (N)")
    if rollouts:
        figure.legend(handles=_strip_handles(), loc="outside lower right", ncols=3, fontsize=8.0)
    figure.align_ylabels(list(grid[:2, 0]))
    return figure


def _draw_rollout(normal_axis: Any, tangent_axis: Any, strip: Any, rollout: Rollout, colour: str) -> None:
    kept = thinned(len(rollout.time))
    time = np.asarray(rollout.time)[kept]
    normal, tangential = (values[kept] for values in force_components(rollout))
    normal_axis.plot(time, normal, color=colour, lw=1.4, label="simulated")
    tangent_axis.plot(time, tangential, color=colour, lw=1.4)
    friction = stated_friction(rollout.scene, rollout.model.pad_names)
    if friction is not None:
        tangent_axis.plot(time, friction * normal, color=INK, lw=0.8, ls=":", label=f"μ × normal, μ = {friction:g}")
        legend_above(tangent_axis)
    state = np.asarray(rollout.slip_state)[kept][:, np.array(rollout.on_hand())].max(axis=1, initial=0)
    for value, shade in ((1, STICKING), (2, SLIDING)):
        strip.fill_between(time, 0.0, 1.0, where=state == value, color=shade, lw=0, step="post")


def _strip_handles() -> list[Any]:
    from matplotlib.patches import Patch

    return [Patch(color=colour, label=SLIP_STATES[i]) for i, colour in ((1, STICKING), (2, SLIDING))] + [
        Patch(facecolor="none", edgecolor=QUIET, lw=0.6, label=SLIP_STATES[0])
    ]


@styled
def plot_measured_forces(recording: Recording) -> "Figure":
    """Measured normal and tangential force of a recording with the onsets and releases found in it."""
    kept = thinned(len(recording.time))
    normal, tangential = (values[kept] for values in force_components(recording))
    time = np.asarray(recording.time)[kept]
    figure = new_figure(7.6, 2.1)
    axis = figure.subplots()
    for onset, release in zip(np.asarray(recording.events.onset), np.asarray(recording.events.release), strict=True):
        axis.axvspan(onset, release if np.isfinite(release) else time[-1], color="#DCE6EE", alpha=0.8, lw=0)
    axis.plot(time, normal, color=MEASURED, label="vertical force")
    axis.plot(time, tangential, color=SLIDING, label="horizontal force")
    axis.set_ylabel("force on the subject (N)")
    axis.set_xlabel("time (s)")
    axis.margins(x=0.0)
    legend_above(axis)
    return figure
