"""A record as one file, whose suffix says what it is."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from icjax.export._mujoco import export_mujoco
from icjax.export._opensim import rollout_coordinates, rollout_forces
from icjax.files import write_sto
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view import CLIP_SUFFIXES, export_animation, export_clip

PICTURES = (".glb", *CLIP_SUFFIXES)
OF_ROLLOUTS = (".xml", ".sto", ".mot", ".nc")


def export_record(
    record: Recording | Interaction | Rollout,
    path: Path,
    *,
    turn: np.ndarray | None = None,
    progress: Callable[[float], Any] = lambda fraction: None,
    **clip: Any,
) -> list[str]:
    """Write a record as one file: an animation (.glb), a clip (.gif, .mp4), and of a rollout a MuJoCo model (.xml with
    a table beside it), a table of coordinates and contact forces (.sto, .mot) or a copy (.nc).

    **Arguments**: `turn` of the world of a table, as by `Y_UP`; `progress` is told the fraction done; `clip` options of
    [`icjax.view.export_clip`], refused for anything else.

    **Returns** what was done, a line a file. **Errors**: `ValueError` for another suffix; those of the writers.
    """
    kind = path.suffix.lower()
    known = (*PICTURES, *OF_ROLLOUTS) if isinstance(record, Rollout) else PICTURES
    if kind not in known:
        what = type(record).__name__.lower()
        raise ValueError(f"{path}: one file of a {what} is one of {', '.join(known)}; not {kind or 'without a suffix'}")
    if clip and kind not in CLIP_SUFFIXES:
        raise ValueError(f"{path}: {', '.join(clip)} is said of clips only ({', '.join(CLIP_SUFFIXES)})")
    if kind in CLIP_SUFFIXES:
        return [f"wrote {export_clip(record, path, progress=progress, **clip)}"]
    if kind == ".glb":
        return [f"wrote {export_animation(record, path)} (animated, y up)"]
    assert isinstance(record, Rollout)
    if kind == ".nc":
        record.save(path)
        return [f"wrote {path}"]
    if kind == ".xml":
        model, table = export_mujoco(record, path)
        return [f"wrote {model} (MuJoCo) and {table} (its qpos)"]
    turn = np.eye(3) if turn is None else turn
    tables = rollout_coordinates(record, turn), rollout_forces(record, turn)
    names = [name for table in tables for name in table.names]
    values = np.concatenate([table.values for table in tables], axis=1)
    write_sto(path, time=np.asarray(record.time), names=names, values=values, in_degrees=True)
    counts = len(tables[0].names), len(tables[1].names) // 9
    return [f"wrote {path} ({counts[0]} coordinates, degrees and m; forces of {counts[1]} pairs on the first of each)"]
