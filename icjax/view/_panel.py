"""The controls beside the 3-D view of a live page: widgets and words, no computing."""

import html
from collections.abc import Callable
from typing import Any

import numpy as np

from icjax.rollout import SLIP_STATES
from icjax.synthesis import Scene
from icjax.view._frames import Frames
from icjax.view._playback import Playback
from icjax.view._rerun import Told
from icjax.view._style import INK, MEASURED, QUIET, SLIDING, STICKING
from icjax.view._substitutes import AS_GIVEN
from icjax.view._variation import Variation, can_resize, shapes_for

SPEEDS = {"1/20": 0.05, "1/10": 0.1, "1/4": 0.25, "1/2": 0.5, "1": 1.0, "2": 2.0}
STATE_COLOURS: dict[str, str] = dict(zip(SLIP_STATES, (QUIET, STICKING, SLIDING), strict=True))
MOST_ROWS = 12
"""Contacts in the table."""

FAINT = 1e-3
"""N; a smaller force is none."""


class TimeControls:
    """Scrubber, play and pause, speed; a person who drags the scrubber stops the player."""

    def __init__(self, gui: Any, playback: Playback):
        self._playback = playback
        start, end = float(playback.time[0]), float(playback.time[-1])
        with gui.add_folder("Time"):
            self.slider = gui.add_slider("moment (s)", start, max(end, start + 1e-3), 1e-3, playback.at)
            self.button = gui.add_button("Pause" if playback.playing else "Play")
            nearest = min(SPEEDS, key=lambda name: abs(SPEEDS[name] - playback.speed))
            self.speed = gui.add_dropdown("speed", tuple(SPEEDS), initial_value=nearest)
        self.slider.on_update(self._scrubbed)
        self.button.on_click(lambda event: self.play(not playback.playing))
        self.speed.on_update(lambda event: setattr(playback, "speed", SPEEDS[self.speed.value]))

    def play(self, playing: bool) -> None:
        """Play or pause."""
        self._playback.playing = playing
        self.button.label = "Pause" if playing else "Play"

    def follow(self) -> None:
        """Show where the player is."""
        self.slider.value = round(self._playback.at, 3)

    def _scrubbed(self, event: Any) -> None:
        if event.client is not None:
            self.play(False)
            self._playback.go_to(self.slider.value)


class Sliders:
    """What may be changed of a scene: `changed` is told of every change, `variation` is what they say.

    **Arguments**: `initial` numbers are those of the scene; a slider that has not been moved changes nothing.
    """

    def __init__(self, gui: Any, scene: Scene, changed: Callable[[Variation], None]):
        self._changed = changed
        self._handles: dict[tuple[str, str], tuple[Any, Any, float]] = {}
        with gui.add_folder("What if"):
            self._slider(gui, "compliance", "", "compliance of the hand (times)", 0.1, 4.0, 0.05, 1.0)
            for thing in (*scene.surfaces, *scene.objects):
                with gui.add_folder(thing.name):
                    self._of_thing(gui, scene, thing)
            gui.add_button("As given").on_click(lambda event: self.reset())

    def variation(self) -> Variation:
        """What the sliders say."""
        found: dict[str, dict[str, Any]] = {"friction": {}, "mass": {}, "size": {}, "shape": {}}
        compliance = 1.0
        for (kind, name), (handle, initial, unit) in self._handles.items():
            if kind == "compliance":
                compliance = float(handle.value)
            elif handle.value != initial:
                found[kind][name] = handle.value if isinstance(handle.value, str) else unit * handle.value
        return Variation(compliance=compliance, **found)

    def reset(self) -> None:
        """Everything as given."""
        for handle, initial, _ in self._handles.values():
            handle.value = initial
        self._changed(self.variation())

    def _of_thing(self, gui: Any, scene: Scene, thing: Any) -> None:
        friction = float(thing.friction)
        self._slider(gui, "friction", thing.name, "friction μ", 0.0, max(1.5, 2.0 * friction), 0.01, friction)
        is_object = thing in scene.objects
        if is_object and not thing.driven:
            grams = 1e3 * float(thing.mass)
            step = 10.0 ** np.floor(np.log10(grams) - 1.0)
            most, least = np.ceil(12.0 * grams / step) * step, np.ceil(grams / 4.0 / step) * step
            shown = float(f"{grams:.3g}")
            self._slider(gui, "mass", thing.name, "mass (g)", float(least), float(most), float(step), shown, 1e-3)
        if can_resize(thing.shape):
            self._slider(gui, "size", thing.name, "size (times)", 0.5, 2.0, 0.02, 1.0)
        kinds = shapes_for(scene, thing.name) if is_object and not thing.driven else (AS_GIVEN,)
        if len(kinds) > 1:
            handle = gui.add_dropdown("shape", kinds, initial_value=AS_GIVEN)
            self._keep("shape", thing.name, handle, 1.0)

    def _slider(
        self, gui: Any, kind: str, name: str, label: str, least: float, most: float, step: float, initial: float,
        unit: float = 1.0,
    ) -> None:  # fmt: skip
        handle = gui.add_slider(label, min(least, initial), max(most, initial), step, initial)
        self._keep(kind, name, handle, unit)

    def _keep(self, kind: str, name: str, handle: Any, unit: float) -> None:
        self._handles[kind, name] = handle, handle.value, unit
        handle.on_update(lambda event: self._changed(self.variation()) if event.client is not None else None)


def status_html(title: str, told: Told, shown: str, unsolved: str = "") -> str:
    """What is shown and how the computation stands."""
    words = {"ready": "", "computing": "computing…", "failed": f"failed: {told.text}"}[told.state]
    colour = {"ready": INK, "computing": MEASURED, "failed": SLIDING}[told.state]
    if words:
        words += f" Shown: {shown}."
    lines = [f"<b>{html.escape(title)}</b>"]
    lines += [f'<span style="color:{colour}">{html.escape(words)}</span>'] if words else []
    lines += [f'<span style="color:{SLIDING}">{html.escape(unsolved)}</span>'] if unsolved else []
    return f'<div style="padding:0.4em 0.9em;font-size:0.85em;line-height:1.45">{"<br>".join(lines)}</div>'


def contacts_html(shown: Frames, k: int, simulated: bool) -> str:
    """What touches in one frame: force, slip state and how close to slipping, the hand's contacts first."""
    pairs = shown.pairs
    size, ratio = np.linalg.norm(pairs.force[k], axis=-1), pairs.ratio()[k]
    order = [*np.flatnonzero(pairs.on_hand), *np.flatnonzero(~pairs.on_hand)]
    rows = []
    order = [pair for pair in order if pairs.state[k, pair] > 0 or size[pair] > FAINT]
    if not order:
        return '<div style="padding:0.2em 0.9em 0.5em;font-size:0.8em;color:#5B616B">Nothing touches.</div>'
    for pair in order[:MOST_ROWS]:
        state: str = SLIP_STATES[int(pairs.state[k, pair])] if simulated else ""
        share = ratio[pair] / pairs.friction[pair] if pairs.friction[pair] > 0 else np.nan
        cells = (
            html.escape(" on ".join(name for name in pairs.bodies[pair] if name)),
            f"{size[pair]:.2f} N",
            f'<span style="color:{STATE_COLOURS.get(state, QUIET)}">{state}</span>',
            f"{share:.0%}" if np.isfinite(share) else "",
        )
        first, *others = (f'<td style="padding:0 0.7em 0 0">{cell}</td>' for cell in cells)
        rows.append(f"<tr>{first}{''.join(others)}</tr>")
    more = f"<tr><td>and {len(order) - MOST_ROWS} more</td></tr>" if len(order) > MOST_ROWS else ""
    head = '<tr style="text-align:left;color:#5B616B"><th>contact</th><th>force</th><th>state</th><th>of μ</th></tr>'
    table = f'<table style="font-size:0.78em;border-collapse:collapse">{head}{"".join(rows)}{more}</table>'
    return f'<div style="padding:0.2em 0.9em 0.5em">{table}</div>'


def key_html(simulated: bool, objects: bool) -> str:
    """What the colours of the arrows mean."""
    colours = ((STICKING, "sticking"), (SLIDING, "sliding")) if simulated else ((MEASURED, "measured"),)
    parts = [f'<span style="color:{colour}">■</span> {word}' for colour, word in colours]
    what = "on the hand and the objects" if objects else "on the hand"
    return f'<div style="padding:0.2em 0.9em;font-size:0.8em">Contact force {what}: {" ".join(parts)}</div>'
