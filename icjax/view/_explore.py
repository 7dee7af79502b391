"""A live page: a record in 3-D in the browser, and what would happen if something of its scene were otherwise."""

import contextlib
import io
import threading
import time
import webbrowser
from typing import Any

import numpy as np

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.synthesis import Policy, Scene, slot_names
from icjax.view._explorer import Explorer
from icjax.view._extras import require
from icjax.view._frames import pick_frames
from icjax.view._panel import Sliders, TimeControls, contacts_html, key_html, status_html
from icjax.view._playback import Playback
from icjax.view._rerun import Told
from icjax.view._stage import Stage
from icjax.view._surfaces import Shape, scene_name, scene_surfaces, surfaces_of

DISTANCE = 1.3
"""Of the camera, in that of an exported page: the panel takes a part of the width."""

FRAME_RATE = 30.0
"""Frames a second that a page is sent."""

KEPT_RATE, KEPT = 120.0, 6000
"""Frames of a record that are kept: a second, and in all."""

TABLE_PERIOD = 0.2
"""s between two states of the table of contacts."""

SHOWN = {"contact forces": True, "friction cones": False, "reference pose": False}
"""What can be hidden, and whether it is shown at first."""


def explore(
    record: Recording | Interaction | Rollout,
    scene: Scene | None = None,
    *,
    policy: Policy | None = None,
    host: str = "127.0.0.1",
    port: int = 8080,
    browser: bool = True,
) -> "LivePage":
    """Serve a live page: the record in 3-D with its contact forces, friction cones, a scrubber and playback.

    With an interaction and a scene, sliders for compliance, friction, mass, size and shape simulate the transfer again
    in the background, while the last result stays on the page; numbers do not compile anything again, another shape
    does once (half a minute). The first result takes as long as that.

    **Arguments**

    - `record`: a rollout, or what was measured; `scene`: what the interaction meets.
    - `policy`: what the hand changes on the way, as for [`icjax.synthesis.transfer`].
    - `host`, `port`: where to listen; ``0.0.0.0`` lets other machines look. A port that is taken, the next free one.
    - `browser`: open it in a browser.

    **Returns**: the page, which is served until its `close` or the end of the program; `wait` blocks until then.

    **Errors**: `ValueError` for a scene with anything but an interaction, where no frame has a pose, or where the
    interaction cannot meet the scene; `ImportError` naming the extra where viser is absent.
    """
    if scene is not None and not isinstance(record, Interaction):
        raise ValueError(f"a scene goes with an interaction; got a {type(record).__name__.lower()}")
    if scene is not None:
        slot_names(record.model, scene)  # errors with the names that people gave
    page = LivePage(record, scene, policy, host, port)
    if browser:
        webbrowser.open(page.url)
    return page


class LivePage:
    """What [`explore`] returns: `url`, `explorer` (None where nothing is simulated), `playback`."""

    def __init__(
        self,
        record: Recording | Interaction | Rollout,
        scene: Scene | None,
        policy: Policy | None,
        host: str,
        port: int,
    ):
        viser = require("viser")
        shown = pick_frames(record, KEPT, KEPT_RATE)
        self.playback = Playback(shown.time)
        self.explorer: Explorer | None = None
        self._given, self._number = scene, 0
        self._close = True if scene is not None and scene.objects else None
        with contextlib.redirect_stdout(io.StringIO()):
            self.server: Any = viser.ViserServer(host=host, port=port, verbose=False)
        self._stop, self._lock = threading.Event(), threading.Lock()
        try:
            self._set(record, shown, surfaces_of(record) if scene is None else scene_surfaces(scene.describe()))
            self.stage.look(DISTANCE)
            self._build(record, scene, policy)
        except BaseException:
            self.close()
            raise
        self._thread = threading.Thread(target=self._run, name="icjax page", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Address of the page on this machine."""
        host = self.server.get_host()
        return f"http://{'127.0.0.1' if host in ('0.0.0.0', '::') else host}:{self.server.get_port()}"

    def wait(self) -> None:
        """Until the page is closed."""
        self._stop.wait()

    def close(self) -> None:
        """Stop serving and computing."""
        self._stop.set()
        if self.explorer is not None:
            self.explorer.close()
        thread = getattr(self, "_thread", None)
        if thread is not None and thread is not threading.current_thread():
            thread.join()
        self.server.stop()

    def show(self, record: Any, shown: Any, shapes: tuple[Shape, ...]) -> None:
        """Put another record on the page, at the same moment."""
        with self.server.atomic():
            self.server.scene.reset()
            self._set(record, shown, shapes)
            self._apply_visibility()
        self._say(self._told)

    def tick(self, seconds: float) -> None:
        """Let time pass: take a new result, move on, tell how things stand."""
        with self._lock:
            self._tick(seconds)

    def _tick(self, seconds: float) -> None:
        if self.explorer is not None:
            rollout, told = self.explorer.take()
            if rollout is not None and rollout is not self.record:
                self.show(rollout, pick_frames(rollout, KEPT, KEPT_RATE), scene_surfaces(rollout.scene))
            if told != self._told:
                self._say(told)
        if self.playback.advance(seconds):
            self._time.follow()
        row = self.playback.row
        if row != self._row:
            with self.server.atomic():
                self.stage.place(row)
            self._row = row
        if self._tabled != (id(self.shown), row) and time.monotonic() > self._table_due:
            self._table.content = contacts_html(self.shown, row, isinstance(self.record, Rollout))
            self._tabled, self._table_due = (id(self.shown), row), time.monotonic() + TABLE_PERIOD

    def _set(self, record: Any, shown: Any, shapes: tuple[Shape, ...]) -> None:
        self.record, self.shown = record, shown
        self.playback.replace(shown.time)
        self._number += 1
        root = f"/{self._number}"
        self.stage = Stage(self.server, record, shown, shapes, cones=True, close=self._close, root=root)
        self._row = self.playback.row
        self.stage.place(self._row)

    def _build(self, record: Any, scene: Scene | None, policy: Policy | None) -> None:
        gui = self.server.gui
        self._told, self._tabled, self._table_due = Told("ready"), (0, -1), 0.0
        gui.configure_theme(control_width="medium", show_logo=False, show_share_button=False)
        gui.set_panel_label("icjax")
        if hasattr(gui, "main_panel"):  # viser 1.1 and later; before, the panel floats over the picture
            gui.main_panel.dock_right()
        self._status = gui.add_html("")
        self._bar = gui.add_progress_bar(0.0, animated=True, visible=False)
        self._time = TimeControls(gui, self.playback)
        if scene is not None:
            self.explorer = Explorer(record, scene, policy)
            self.sliders = Sliders(gui, scene, self.explorer.vary)
        with gui.add_folder("Contacts"):
            self._key = gui.add_html("")
            self._table = gui.add_html("")
        with gui.add_folder("Show"):
            self._shown = {name: gui.add_checkbox(name, value) for name, value in SHOWN.items()}
        for handle in self._shown.values():
            handle.on_update(lambda event: self._apply_visibility())
        self._say(self._told)
        self._apply_visibility()

    def _apply_visibility(self) -> None:
        assert self.stage.cones is not None
        roots = (self.stage.arrows.root, self.stage.cones.root, self.stage.reference)
        for root, handle in zip(roots, self._shown.values(), strict=True):
            root.visible = handle.value

    def _say(self, told: Told) -> None:
        self._told = told
        rollout = self.record if isinstance(self.record, Rollout) else None
        shown = "the last result" if rollout is not None else "what was measured"
        self._key.content = key_html(rollout is not None, bool(rollout is not None and rollout.object_names))
        self._status.content = status_html(self._title(), told, shown, _unsolved(rollout))
        self._bar.visible = told.state == "computing"
        self._bar.value = 100.0 * told.fraction if told.fraction > 0 else 100.0

    def _title(self) -> str:
        if self._given is not None:
            return f"{self.record.name} on {self._given.name}"
        if isinstance(self.record, Rollout):
            return f"{self.record.name} on {scene_name(self.record)}"
        return f"{self.record.name}, measured"

    def _run(self) -> None:
        last = time.monotonic()
        while not self._stop.wait(1.0 / FRAME_RATE):
            now = time.monotonic()
            try:
                self.tick(now - last if self.server.get_clients() else 0.0)
            except Exception as error:  # the page stays and says so
                self._say(Told("failed", text=f"the picture: {error}"))
            last = now


def _unsolved(rollout: Rollout | None) -> str:
    if rollout is None:
        return ""
    failed = np.flatnonzero(np.asarray(rollout.status))
    if not len(failed):
        return ""
    first = float(rollout.time[failed[0]])
    return f"{len(failed)} of {len(rollout.time)} steps were not solved, the first at {first:.3f} s"
