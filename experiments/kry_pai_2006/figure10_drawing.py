"""Picture of Figure 10: ellipsoids of compliance at the fingertips, one force that moves all, block norms, shares."""

from typing import Any

import numpy as np
from hand_drawing import COLOURS, GREY, INK, View, draw_arrow, draw_hand, framed, plotting

from icjax.model import Model, forward_kinematics, pad_positions

VIEW = View(np.radians(28.0), np.radians(24.0))
"""From in front, a little from the thumb's side."""

FORCE = 1.0
"""N, of the ellipsoids."""

LOW, HIGH = (-108.0, -122.0), (70.0, 32.0)
"""mm, frame of the pictures."""

OWN, WRIST, ARM = "#56B4E9", "#0072B2", "#E69F00"


def drawn(
    model: Model,
    q: np.ndarray,
    matrices: dict[str, np.ndarray],
    share: dict[str, np.ndarray],
    pull: tuple[np.ndarray, np.ndarray],
) -> Any:
    """Above two pictures of the hand; below the block norms of every matrix and the shares."""
    pyplot = plotting()
    figure = pyplot.figure(figsize=(9.6, 7.4), layout="constrained")
    figure.get_layout_engine().set(h_pad=0.07)
    upper, lower = figure.subfigures(2, 1, height_ratios=[1.25, 1.0])
    left, right = upper.subplots(1, 2)
    ellipsoids(left, model, q, matrices)
    moved_by(right, model, q, matrices["all joints"], *pull)
    grid = lower.subplots(1, 4, width_ratios=[1.0, 1.0, 1.0, 1.05])
    norms(grid[:3], model, matrices)
    shares(grid[3], model, share)
    lower.supxlabel(
        "The shipped hand, wrist and arm as compliant as stated there; pads' own compliance left out. No data are "
        "used. |G$_{ij}$|: how far tip i can move for 1 N on tip j.",
        fontsize=8.0, color="#5B616B")  # fmt: skip
    return figure


def hand(axis: Any, model: Model, q: np.ndarray) -> np.ndarray:
    """Hand with forearm; where the tips are in the picture, mm."""
    poses = forward_kinematics(model, q)
    wrist = np.asarray(poses.position)[model.body("hand")]
    along = np.asarray(poses.rotation)[model.body("forearm")][:, 0]
    place, _ = VIEW.seen(np.stack([wrist - 0.040 * along, wrist]))
    axis.plot(*place.T, color="#C9A58B", linewidth=9, alpha=0.5, solid_capstyle="butt", zorder=0.5)
    axis.plot(*place[1], "o", color="#8C5A3C", markersize=8, zorder=6)
    axis.annotate("wrist", place[1], (0, 9), textcoords="offset points", ha="center", fontsize=8.5, color=INK)
    pads = np.asarray(pad_positions(model, q))
    draw_hand(axis, VIEW, model, q, np.ones(len(pads)), pads.mean(axis=0), size=4.5)
    framed(axis, LOW, HIGH)
    return VIEW.seen(pads)[0]


def outline(G: np.ndarray) -> np.ndarray:
    """Silhouette in the picture of the displacements under `FORCE` in every direction, mm about the tip.

    The set is the ellipsoid of u^T G^-2 u = FORCE^2; its shadow in the plane of axes A is that of A^T G^2 A.
    """
    turn = np.linspace(0.0, 2.0 * np.pi, 120)
    value, vector = np.linalg.eigh(VIEW.axes.T @ G @ G @ VIEW.axes)
    return 1e3 * FORCE * np.stack([np.cos(turn), np.sin(turn)], axis=1) * np.sqrt(np.maximum(value, 0.0)) @ vector.T


def ellipsoids(axis: Any, model: Model, q: np.ndarray, matrices: dict[str, np.ndarray]) -> None:
    """At every tip, with and without the joints that it shares."""
    tips = hand(axis, model, q)
    for number, name in enumerate(model.pad_names):
        for kind, look in (("arm and wrist driven", {"facecolor": COLOURS[name], "alpha": 0.6}),
                           ("arm driven", {"fill": False, "linestyle": "--", "edgecolor": COLOURS[name]}),
                           ("all joints", {"fill": False, "edgecolor": COLOURS[name], "linewidth": 1.4})):  # fmt: skip
            axis.fill(*(tips[number] + outline(matrices[kind][number, :, number])).T, zorder=7, **look)
    pyplot = plotting()
    handles = [
        pyplot.Line2D([], [], color=INK, linewidth=1.4, label="all joints"),
        pyplot.Line2D([], [], color=INK, linewidth=1.0, linestyle="--", label="arm driven"),
        pyplot.Rectangle((0, 0), 1, 1, facecolor=GREY, alpha=0.6, label="arm and wrist driven"),
    ]
    axis.legend(handles=handles, frameon=False, fontsize=8.5, loc="lower right")
    axis.set_title(f"a  displacement of a tip for {FORCE:g} N in any direction", loc="left", fontsize=9.5,
                   fontweight="bold", color=INK)  # fmt: skip


def moved_by(axis: Any, model: Model, q: np.ndarray, G: np.ndarray, force: np.ndarray, moved: np.ndarray) -> None:
    """One force, where every tip goes, and what G says of it."""
    tips = hand(axis, model, q)
    linear = np.einsum("iajb,jb->ia", G, force)
    pulled = int(np.argmax(np.linalg.norm(force, axis=1)))
    for number in range(len(tips)):
        by = VIEW.seen(moved[number][None])[0][0]
        said = VIEW.seen(linear[number][None])[0][0]
        axis.plot(*(tips[number] + said), "+", color=INK, markersize=9, markeredgewidth=1.6, zorder=11)
        draw_arrow(axis, tips[number], tips[number] + by, INK if number == pulled else GREY, 1.8)
    axis.set_title(f"b  {np.linalg.norm(force):g} N on the {model.pad_names[pulled]} fingertip moves all", loc="left",
                   fontsize=9.5, fontweight="bold", color=INK)  # fmt: skip
    pyplot = plotting()
    handles = [
        pyplot.Line2D([], [], color=INK, linewidth=1.8, label=f"where the {model.pad_names[pulled]} goes"),
        pyplot.Line2D([], [], color=GREY, linewidth=1.8, label="where the others go"),
        pyplot.Line2D([], [], color=INK, marker="+", markersize=8, linewidth=0, label="G f, to first order"),
    ]
    axis.legend(handles=handles, frameon=False, fontsize=8.5, loc="lower right")


def block_norms(G: np.ndarray) -> np.ndarray:
    """Largest singular value of every block `[tip, tip]`: how far tip i can move for a unit force on tip j, m/N."""
    return np.linalg.norm(G.transpose(0, 2, 1, 3), ord=2, axis=(2, 3))


def norms(axes: Any, model: Model, matrices: dict[str, np.ndarray]) -> None:
    """|G_ij| of every matrix, mm/N, one scale of colours."""
    found = {kind: 1e3 * block_norms(matrix) for kind, matrix in matrices.items()}
    most = max(values.max() for values in found.values())
    names = model.pad_names
    for letter, axis, (kind, values) in zip("cde", axes, found.items(), strict=True):
        axis.imshow(values, cmap="Blues", vmin=0.0, vmax=most)
        for (row, column), value in np.ndenumerate(values):
            dark = value > 0.6 * most
            text = "0" if value < 1e-6 else f"{value:.0f}" if value >= 9.95 else f"{value:.1f}"
            axis.text(column, row, text, ha="center", va="center", fontsize=8, color="white" if dark else INK)
        axis.set_xticks(range(len(names)), names, rotation=90, fontsize=8)
        axis.set_yticks(range(len(names)), names if letter == "c" else [], fontsize=8)
        axis.tick_params(length=0)
        axis.spines[:].set_visible(False)
        axis.set_title(f"{letter}  {kind}", loc="left", fontsize=9, fontweight="bold", color=INK)
    axes[0].set_ylabel("tip that moves", fontsize=9)
    axes[1].set_xlabel("tip that is pushed;  |G$_{ij}$| in mm/N", fontsize=9)


def shares(axis: Any, model: Model, share: dict[str, np.ndarray]) -> None:
    """Of every tip's own compliance, which joints give way."""
    low = np.zeros(len(model.pad_names))
    looks = (("own", OWN, "finger's own joints"), ("wrist", WRIST, "wrist (shared)"), ("arm", ARM, "arm (shared)"))
    rows = np.arange(len(low))
    for kind, colour, label in looks:
        axis.barh(rows, 100 * share[kind], left=low, color=colour, height=0.72, label=label)
        for row, (start, part) in enumerate(zip(low, 100 * share[kind], strict=True)):
            if part > 8:
                axis.text(start + part / 2, row, f"{part:.0f}", ha="center", va="center", fontsize=8,
                          color="white" if kind == "wrist" else INK)  # fmt: skip
        low = low + 100 * share[kind]
    axis.set_yticks(rows, model.pad_names, fontsize=8)
    axis.invert_yaxis()
    axis.set_xlim(0, 100)
    axis.set_xlabel("share of trace G$_{ii}$, %", fontsize=9)
    axis.tick_params(axis="x", labelsize=8)
    axis.spines[["top", "right", "left"]].set_visible(False)
    axis.tick_params(axis="y", length=0)
    axis.set_title("f  which joints give way", loc="left", fontsize=9, fontweight="bold", color=INK, pad=42)
    axis.legend(frameon=False, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1,
                labelspacing=0.2)  # fmt: skip
