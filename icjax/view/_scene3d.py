"""A record in three dimensions, played over time in the browser: viser's static export, one self-contained page."""

import contextlib
import io

from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._extras import require
from icjax.view._frames import pick_frames
from icjax.view._stage import Stage
from icjax.view._surfaces import Shape, surfaces_of


def export_scene(
    record: Recording | Interaction | Rollout,
    *,
    frames: int = 200,
    rate: float = 30.0,
    markers: bool = False,
    surfaces: tuple[Shape, ...] | None = None,
) -> str:
    """A page with the record in 3-D, a time bar and a play button, that opens from disk with no network.

    The body is drawn as capsules between body origins, translucent so that forces inside it show, the reference
    pose as a fainter ghost of the bodies that differ (a driven root never does), every contact force as an arrow
    from the contact point, coloured by its slip state in a rollout. Surfaces and objects come from a rollout's scene;
    with a measured record they are a level patch through the contact points. A server is opened on this machine only
    (127.0.0.1, a free port) while the page is made, and closed again.

    **Arguments**

    - `frames`: most frames kept; `rate`: most frames a second. Frames are picked, not averaged.
    - `markers`: draw the measured markers (a `Recording` only).
    - `surfaces`: draw these instead.

    **Returns**: the HTML text, about 0.9 MB, most of which is the viewer itself.

    **Errors**: `ValueError` where no frame has a pose; `ImportError` naming the extra where viser is absent.
    """
    viser = require("viser")
    shown = pick_frames(record, frames, rate, markers)
    shapes = surfaces_of(record) if surfaces is None else surfaces
    with contextlib.redirect_stdout(io.StringIO()):
        server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
        try:
            stage = Stage(server, record, shown, shapes)
            stage.look()
            stage.place(0)
            serializer = server.get_scene_serializer()
            for k in range(1, len(shown.time)):
                serializer.insert_sleep(float(shown.time[k] - shown.time[k - 1]))
                stage.place(k)
            if len(shown.time) > 1:
                serializer.insert_sleep(float(shown.time[-1] - shown.time[-2]))
            return serializer.as_html()
        finally:
            server.stop()
