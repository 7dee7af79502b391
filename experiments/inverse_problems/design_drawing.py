"""Figure of design.py: maps of expected widths, curves, expected against found."""

from pathlib import Path
from typing import Any

import numpy as np

OPEN, INK = "#5B616B", ("#0072B2", "#D55E00", "#009E73", "#CC79A7")


def draw(result: dict[str, Any], config: Any, bound: float, path: Path) -> None:
    """Above the maps, one a joint; below the curves and expected against found."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot
    from matplotlib.colors import LogNorm

    figure, axes = pyplot.subplots(2, 4, figsize=(12.0, 6.0), layout="constrained")
    width = np.asarray(result["map"]["width"])
    image = None
    for j, (axis, joint) in enumerate(zip(axes[0], result["joints"], strict=True)):
        image = axis.pcolormesh(
            config.angles, config.flexions, width[:, :, j], norm=LogNorm(1.1, 16.0), cmap="viridis_r", shading="nearest"
        )
        axis.contour(config.angles, config.flexions, width[:, :, j], levels=[4.0], colors="white", linewidths=1.2)
        clear = np.asarray(result["map"]["clear of a whole plate"], float)
        axis.contour(config.angles, config.flexions, clear, levels=[0.5], colors="black", linestyles=":", linewidths=1)
        axis.set_title(joint, loc="left", fontsize=9, fontweight="bold")
        axis.set_xlabel("surface to distal segment, degrees")
    axes[0, 0].set_ylabel("flexion of PIP, degrees")
    bar = figure.colorbar(image, ax=axes[0], label="width, a factor", ticks=[1.2, 2, 4, 8, 16], format="%g", shrink=0.9)
    bar.ax.minorticks_off()
    panels = (("contacts", config.contacts), ("catch trials", config.catches), ("speed", config.speeds))
    for axis, (what, values) in zip(axes[1], panels, strict=False):
        for name, line in zip(tuple(result["curves"]), ("-", "--"), strict=True):
            lines = np.asarray(result["curves"][name][what])
            for j, joint in enumerate(result["joints"]):
                label = joint if line == "-" else None
                axis.plot(values, lines[:, j], line, color=INK[j], marker=".", label=label, linewidth=1.2)
        axis.axhline(4.0, color=OPEN, linewidth=0.8)
        axis.set(xscale="log", yscale="log", xlabel=what + (", m/s" if what == "speed" else ""))
        axis.set_yticks([1.2, 2, 4, 8, 16], ["1.2", "2", "4", "8", "16"])
        axis.set_xticks(values, [f"{value:g}" for value in values])
        axis.minorticks_off()
    axes[1, 0].set_ylabel("width, a factor")
    axes[1, 0].legend(fontsize=7, frameon=False)
    axes[1, 0].set_title(f"- {tuple(result['curves'])[0]}   -- {tuple(result['curves'])[1]}", loc="left", fontsize=7.5)
    axis = axes[1, 3]
    ends = np.array([0.02, 1.0])
    for case in result["validation"].values():
        for j in range(len(result["joints"])):
            axis.plot(case["expected sd, own compliance"][j], case["found sd"][j], "o", color=INK[j], markersize=4)
    for factor in (1 / bound, 1.0, bound):
        axis.plot(ends, factor * ends, color=OPEN, linewidth=0.8 if factor == 1.0 else 0.5)
    axis.set(xscale="log", yscale="log", xlabel="expected sd of log C", ylabel="found by fit_session")
    for axis in axes[1]:
        axis.spines[["top", "right"]].set_visible(False)
    figure.supxlabel(
        "12 contacts, 2 catch trials unless varied; white and grey lines: a factor of 4, above which a joint gets no "
        "number; right of the dots the surface may go on behind the pad, left it must be an edge.\nLower right: "
        f"simulated sessions, lines at factors {1 / bound:.2g}, 1 and {bound:g}.",
        fontsize=7.5, color=OPEN,
    )  # fmt: skip
    figure.savefig(path, dpi=110)
    pyplot.close(figure)
