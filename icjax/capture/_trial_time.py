"""One even time axis for markers and forces of a trial: what the files leave open is settled or refused here."""

import dataclasses
from pathlib import Path

import numpy as np

from icjax.files import FileError, MotionFile

JITTER = 0.35
"""Intervals may differ from whole multiples of the usual one by this share of it: printed times are rounded."""

LONGEST = 2.0
"""A file may grow by this factor when missing frames are put in; a larger hole is a mistake in its times."""


def even_markers(motion: MotionFile, path: Path) -> MotionFile:
    """The trial with missing frames put in as gaps, so that frames are evenly spaced.

    Files that leave out the frames in which a marker was lost have a hole in their times. Such rows come back
    as frames without markers; other uneven times cannot be filtered at one rate.

    **Errors**: `FileError` naming the frame, when there are fewer than two frames or times are uneven otherwise.
    """
    time = motion.marker_time
    if len(time) < 2:
        raise FileError(path, f"holds {len(time)} frame; two are needed to know its rate")
    steps = np.diff(time)
    usual = _usual(steps)
    counts = np.rint(steps / usual).astype(int)
    uneven = (np.abs(steps - counts * usual) > JITTER * usual) | (counts < 1)
    if uneven.any():
        frame = int(np.argmax(uneven))
        raise FileError(
            path,
            f"times are not evenly spaced: {steps[frame]:g} s after frame {frame + 1} ({time[frame]:g} s), "
            f"usually {usual:g} s",
        )
    missing = int(np.sum(counts - 1))
    if not missing:
        return motion
    total = len(time) + missing
    if total > LONGEST * len(time):
        raise FileError(path, f"times leave {missing} frames out, more than the {len(time)} that it holds")
    place = np.concatenate([[0], np.cumsum(counts)])
    markers = np.full((total, *motion.markers.shape[1:]), np.nan)
    markers[place] = motion.markers
    return dataclasses.replace(
        motion,
        marker_rate=1.0 / usual,
        marker_time=np.interp(np.arange(total), place, time),
        markers=markers,
        notes=(*motion.notes, f"{missing} frames are missing in the times of {path.name}; they are gaps"),
    )


def check_even(time: np.ndarray, path: Path, what: str) -> None:
    """**Errors**: `FileError` when there are fewer than two samples or their times are not evenly spaced.

    A force that is not known is neither a contact nor the absence of one, so no sample can be put in.
    """
    if len(time) < 2:
        raise FileError(path, f"holds {len(time)} {what} sample; two are needed to know its rate")
    steps = np.diff(time)
    usual = _usual(steps)
    uneven = np.abs(steps - usual) > JITTER * usual
    if uneven.any():
        sample = int(np.argmax(uneven))
        raise FileError(
            path,
            f"{what} times are not evenly spaced: {steps[sample]:g} s after sample {sample + 1} ({time[sample]:g} s), "
            f"usually {usual:g} s",
        )


def common_time(motion: MotionFile, path: Path) -> MotionFile:
    """The frames that the force record covers; frames beyond it are left out and a note says so.

    Where the force is unknown, nobody can say whether something touches.
    """
    time, known = motion.marker_time, motion.analog_time
    frame = float(np.median(np.diff(time)))
    inside = (time >= known[0] - frame) & (time <= known[-1] + frame)
    if inside.all():
        return motion
    kept = time[inside]
    if len(kept) < 2:
        raise FileError(path, "forces and markers do not overlap in time")
    note = (
        f"forces are known from {known[0]:g} to {known[-1]:g} s, markers from {time[0]:g} to {time[-1]:g} s; "
        f"{int((~inside).sum())} frames without a force are left out"
    )
    return dataclasses.replace(motion, marker_time=kept, markers=motion.markers[inside], notes=(*motion.notes, note))


def _usual(steps: np.ndarray) -> float:
    """Mean of the intervals that hold no gap; printed times are rounded, so that single ones are off."""
    return float(np.mean(steps[steps < 1.5 * np.median(steps)]))
