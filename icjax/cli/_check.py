"""`icjax check`: what a session or a record file says, before anything is computed."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Check:
    """Print what icjax understands of a session: rates, channels, units, gaps, plates, suspicious values."""

    session: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SESSION.TOML")]
    """Session file; its keys are explained in the guide "A first session on your own files"."""

    def run(self) -> None:
        from icjax.capture import check, read_session

        lines = check(read_session(self.session))
        print("\n".join(lines))
        refused = [line for line in lines if line.startswith("error: ")]
        if refused:
            raise ValueError(f"{self.session}: {len(refused)} of the lines above would stop capture")
