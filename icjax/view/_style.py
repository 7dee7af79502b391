"""One look for every figure: colours by meaning (Okabe and Ito, safe for colour-blind readers), thin frames."""

import contextlib
import functools
import io
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec

from icjax.view._extras import require

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Arguments = ParamSpec("Arguments")

MEASURED = "#0072B2"
REFERENCE = "#E69F00"
STICKING = "#009E73"
SLIDING = "#D55E00"
NEGATIVE = "#D55E00"
TORQUE = "#7A5195"
QUIET = "#8A8F98"
INK = "#1F2430"
CONTACT = "#DCE6EE"
SURFACE = "#D9D2C5"
RIM = "#8C8371"
SIMULATED = ("#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#7A5195")
"""Colours of the simulated variants, in the order in which they are given."""
OBJECTS = ("#7A5195", "#2A7F8E", "#A23B72", "#6B705C")
"""Colours of the objects of a scene, in their order."""

_RC = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.labelcolor": INK,
    "axes.edgecolor": "#9AA0A8",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#ECEEF1",
    "grid.linewidth": 0.7,
    "xtick.color": "#5B616B",
    "ytick.color": "#5B616B",
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "text.color": INK,
    "lines.linewidth": 1.4,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "legend.handlelength": 1.8,
    "svg.fonttype": "none",
    "svg.hashsalt": "icjax",  # the same page from the same records
    "figure.dpi": 100.0,
}


@contextlib.contextmanager
def style() -> Iterator[None]:
    """Apply the style while the block runs; the caller's matplotlib settings come back after it."""
    matplotlib = require("matplotlib")
    with matplotlib.rc_context(_RC):
        yield


def styled(draw: "Callable[Arguments, Figure]") -> "Callable[Arguments, Figure]":
    """Run a drawing function under `style`."""

    @functools.wraps(draw)
    def wrapped(*args: Arguments.args, **kwargs: Arguments.kwargs) -> "Figure":
        with style():
            return draw(*args, **kwargs)

    return wrapped


def new_figure(width: float, height: float) -> "Figure":
    """Empty figure of the given size in inches, outside pyplot (no global state, no window)."""
    figure = require("matplotlib.figure").Figure(figsize=(width, height), layout="constrained")
    figure.set_facecolor("white")
    return figure


def rgb(colour: str) -> tuple[int, int, int]:
    """Red, green and blue, 0 to 255, of a colour written as ``#rrggbb``."""
    return (int(colour[1:3], 16), int(colour[3:5], 16), int(colour[5:7], 16))


def thinned(count: int) -> slice:
    """Every so many samples of a series, so that a page stays small: at most 1500 to 3000 are drawn."""
    return slice(None, None, max(1, count // 1500))


def legend_above(axis: Any, columns: int = 5, **keywords: Any) -> None:
    """Legend in one line above the axes, where it hides no data."""
    axis.legend(
        loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=columns, borderaxespad=0.1, columnspacing=1.2, **keywords
    )


def joint_title(joint: str, units: Mapping[str, str] | None) -> str:
    """Name of a joint, with its unit where that is not rad/Nm."""
    unit = (units or {}).get(joint, "rad/Nm")
    return joint if unit == "rad/Nm" else f"{joint} ({unit})"


def compliance_label(joints: Sequence[str], units: Mapping[str, str] | None) -> str:
    """Label of an axis of compliance over several joints."""
    found = {(units or {}).get(joint, "rad/Nm") for joint in joints}
    if len(found) == 1:
        return f"compliance ({found.pop()})"
    return "compliance (rad/Nm where no unit is named)"


def svg(figure: "Figure", prefix: str, description: str = "") -> str:
    """A figure as SVG text to be placed inside an HTML page.

    **Arguments**

    - `figure`: what the plot functions return.
    - `prefix`: put before every id, so that several figures live in one page; letters, digits and hyphens.
    - `description`: for readers who cannot see the figure.

    **Returns**: one ``<svg>`` element that scales with its container; text stays text in the page's own font; it
    refers to nothing outside itself.
    """
    buffer = io.StringIO()
    with style():
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r'<style type="text/css">.*?</style>', "", text, flags=re.DOTALL)
    text = re.sub(r"font-family: [^;\"]*", "font-family: inherit", text)
    text = re.sub(r"(font: [^;\"]*?\d(?:\.\d+)?px) [^;\"]*", r"\1 sans-serif", text)
    text = re.sub(r'\b(?:d|x|y)="[^"]*"', lambda match: re.sub(r"(\.\d\d)\d+", r"\1", match.group()), text)
    text = re.sub(r'\bid="', f'id="{prefix}-', text)
    text = re.sub(r"url\(#", f"url(#{prefix}-", text)
    text = re.sub(r'(xlink:href|href)="#', rf'\1="#{prefix}-', text)
    label = description.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    return re.sub(
        r'^<svg ([^>]*?)width="[^"]*" height="[^"]*"', rf'<svg role="img" aria-label="{label}" \1', text, count=1
    )


def save(figure: "Figure", path: str | os.PathLike) -> Path:
    """Write a figure (SVG, PDF or PNG by the name's ending), complete or not at all. Returns the path."""
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        with style():
            figure.savefig(temporary, dpi=200)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path
