"""A record as a short clip: GIF, or MP4 where ffmpeg is installed."""

import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from icjax.files import FileError, write_bytes
from icjax.interaction import Interaction
from icjax.recording import Recording
from icjax.rollout import Rollout
from icjax.view._extras import require
from icjax.view._frames import frames_at
from icjax.view._scene_picture import ScenePicture
from icjax.view._style import style
from icjax.view._surfaces import Shape, surfaces_of

CLIP_SUFFIXES = (".gif", ".mp4")

MOST_FRAMES = 2000
"""Longer was meant to be faster."""

SIZES = (64, 4096)
"""Pixels of a side, least and most."""


def export_clip(
    record: Recording | Interaction | Rollout,
    path: str | os.PathLike,
    *,
    speed: float = 1.0,
    frames_per_second: float = 25.0,
    size: tuple[int, int] = (640, 480),
    times: tuple[float, float] | None = None,
    surfaces: tuple[Shape, ...] | None = None,
    progress: Callable[[float], Any] = lambda fraction: None,
) -> Path:
    """Write a record as a clip to be shown: the 3-D scene with its contact forces, the time written in a corner.

    A GIF counts its frames in hundredths of a second, so that 25, 20 or 10 frames a second are shown in time and others
    at the nearest such rate, with the moments chosen for it.

    **Arguments**

    - `path`: its suffix says what is written, ``.gif`` or ``.mp4``.
    - `speed`: times real time, 0.25 for a quarter of it; `frames_per_second` of the clip.
    - `size`: width and height, pixels; `times`: begin and end, s, by default those of the record.
    - `surfaces` instead of those of the record; `progress` is told the fraction done.

    **Returns** the path. **Errors**: `ValueError` for another suffix, numbers that are none, more than 2000 frames, or
    where no frame has a pose; `FileError` where it cannot be written, or where ffmpeg is absent or fails;
    `ImportError` naming the extra where matplotlib is absent.
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in CLIP_SUFFIXES:
        raise ValueError(f"{path}: a clip is one of {', '.join(CLIP_SUFFIXES)}")
    if kind == ".mp4" and shutil.which("ffmpeg") is None:
        raise FileError(path, "needs the program ffmpeg, which is not installed; a .gif does not")
    step = _step(kind, speed, frames_per_second, size)
    rows = _rows(record, step * speed, times)
    shown = frames_at(record, rows)
    picture = ScenePicture(record, shown, surfaces_of(record) if surfaces is None else surfaces, size)

    def drawn() -> Iterator[np.ndarray]:
        with style():
            for k in range(len(rows)):
                yield picture.draw(k, speed)
                progress((k + 1) / len(rows))

    if kind == ".gif":
        return write_bytes(path, _gif(drawn(), step))
    return _mp4(path, drawn(), step, size)


def _step(kind: str, speed: float, rate: float, size: tuple[int, int]) -> float:
    """Seconds between frames of the clip."""
    for name, value in (("speed", speed), ("frames_per_second", rate)):
        if not (np.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive; got {value}")
    if len(size) != 2 or not all(SIZES[0] <= side <= SIZES[1] for side in size):
        raise ValueError(f"size must be {SIZES[0]} to {SIZES[1]} pixels each way; got {size}")
    if rate > 100.0:
        raise ValueError(f"frames_per_second must be at most 100; got {rate:g}")
    return max(round(100.0 / rate), 1) / 100.0 if kind == ".gif" else 1.0 / rate


def _rows(record: Recording | Interaction | Rollout, step: float, times: tuple[float, float] | None) -> np.ndarray:
    """Rows of the record at every so many seconds, of those that have a pose."""
    good = np.flatnonzero(np.isfinite(np.asarray(record.q, float)).all(axis=1))
    if not len(good):
        raise ValueError(f"{record.name}: no frame has a pose, there is nothing to show")
    time = np.asarray(record.time, float)[good]
    start, end = (time[0], time[-1]) if times is None else times
    if not (start < end and end > time[0] and start < time[-1]) and len(time) > 1:
        raise ValueError(f"times {start:g} to {end:g} s are none of {record.name}: {time[0]:g} to {time[-1]:g} s")
    moments = np.arange(max(start, time[0]), min(end, time[-1]) + 1e-9, step)
    if len(moments) > MOST_FRAMES:
        raise ValueError(f"{len(moments)} frames are more than {MOST_FRAMES}; raise speed or show a part (times)")
    after = np.clip(np.searchsorted(time, moments), 1, max(len(time) - 1, 1))
    nearest = after - (moments - time[after - 1] <= time[np.minimum(after, len(time) - 1)] - moments)
    return good[nearest]


def _gif(frames: Iterator[np.ndarray], step: float) -> bytes:
    import io

    image = require("PIL.Image")
    # One palette for all, from the first frame and the last: no flicker.
    pictures = [image.fromarray(frame) for frame in frames]
    pair = np.concatenate([np.asarray(pictures[0]), np.asarray(pictures[len(pictures) // 2])])
    palette = image.fromarray(pair).quantize(colors=255, dither=image.Dither.NONE)
    flat = [picture.quantize(palette=palette, dither=image.Dither.NONE) for picture in pictures]
    out = io.BytesIO()
    flat[0].save(out, "GIF", save_all=True, append_images=flat[1:], duration=round(1000 * step), loop=0, optimize=False)
    return out.getvalue()


def _mp4(path: Path, frames: Iterator[np.ndarray], step: float, size: tuple[int, int]) -> Path:
    """Frames piped to ffmpeg; even sides, which its usual colour format needs."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder) / "clip.mp4"
        command = [
            "ffmpeg", "-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}",
            "-r", f"{1.0 / step:.6g}", "-i", "-", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-pix_fmt", "yuv420p",
            str(made),
        ]  # fmt: skip
        with tempfile.TemporaryFile() as told:
            process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=told)
            assert process.stdin is not None
            try:
                for frame in frames:
                    process.stdin.write(frame.tobytes())
                process.stdin.close()
            except BrokenPipeError:
                pass
            finally:
                failed = process.wait()
            told.seek(0)
            words = " ".join(told.read().decode(errors="replace").split())
        if failed or not made.is_file():
            raise FileError(path, f"ffmpeg failed: {words or f'exit code {failed}'}")
        return write_bytes(path, made.read_bytes())
