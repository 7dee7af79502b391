"""`icjax view`: a live page of a rollout, or of an interaction whose scene is changed while one looks."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from icjax.cli._transfer import PolicyName


@dataclass(frozen=True)
class View:
    """Serve a live page: motion, forces and friction cones in 3-D, with a scrubber and playback.

    With an interaction and --scene, sliders for compliance, friction, mass, size and shape simulate it again. Ctrl-C
    ends it.
    """

    record: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORD.NC")]
    """Rollout written by `icjax transfer`, or interaction written by `icjax estimate`."""
    scene: Path | None = None
    """Scene file (TOML) that the interaction meets."""
    policy: PolicyName = "none"
    """What the hand changes on the way: tighten 100 ms after an object slipped, or adjust before it slips."""
    port: int = 8080
    """Port of the page; the next free one where it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines look."""
    browser: bool = True
    """Open the page in a browser."""

    def run(self) -> None:
        from icjax.cli._transfer import policy_of, read_fitting_scene
        from icjax.files import record_kind
        from icjax.interaction import Interaction
        from icjax.rollout import Rollout
        from icjax.view import explore

        kind = record_kind(self.record)
        if kind not in ("Interaction", "Rollout"):
            raise ValueError(f"{self.record}: holds a {kind}; view takes an interaction or a rollout")
        if not 0 < self.port < 65536:
            raise ValueError(f"--port is {self.port}; it must be 1 to 65535")
        if kind == "Rollout" and self.scene is not None:
            raise ValueError(f"--scene cannot be given with the rollout {self.record}, which has one")
        if self.policy != "none" and self.scene is None:
            raise ValueError("--policy needs --scene")
        record = Interaction.load(self.record) if kind == "Interaction" else Rollout.load(self.record)
        scene = None
        if self.scene is not None:
            scene = read_fitting_scene(self.scene, record)
        page = explore(
            record, scene, policy=policy_of(self.policy), host=self.host, port=self.port, browser=self.browser
        )
        print(f"{page.url} (Ctrl-C ends it)", flush=True)
        if kind == "Interaction" and scene is None:
            print("measured only; --scene SCENE.TOML simulates it")
        try:
            page.wait()
        except KeyboardInterrupt:
            print()
        finally:
            page.close()
