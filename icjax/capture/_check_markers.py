"""Are the markers of a stored recording where the model has them, all the time?"""

from collections.abc import Iterator

import numpy as np

from icjax.capture._check import EXTENT, SUSPICIOUS
from icjax.capture._check_contacts import Finding
from icjax.recording import Recording

LARGE_RESIDUAL = 0.01
"""m RMS; markers farther than this from the model belong to another model or map."""

PLACEMENTS = 3.0
"""Markers whose RMS distance to the model is this many times the stated placement (of three axes) do not fit it."""

ONE_PLACEMENT = 6.0
"""The same for a single marker, which then belongs elsewhere."""

OTHERS = 3.0
"""A single marker stands out that is this many times farther off than the median of all."""

HELD = 0.1
"""s; a measured marker is never at exactly the same place for that long."""

SAME_PLACE = 1e-4
"""m; no two markers are that near to each other."""


def marker_findings(recording: Recording, placement: float | None) -> Iterator[Finding]:
    """Markers far from the model, held, at the origin, at one place or in another unit.

    **Arguments**: `placement` is the stated standard deviation of a marker's place, m, None where it is unknown.
    """
    residual = np.asarray(recording.marker_residual)[np.asarray(recording.valid)]
    seen = np.isfinite(residual)
    if seen.any():
        square, count = np.where(seen, residual, 0.0) ** 2, np.maximum(seen.sum(axis=0), 1)
        each = np.sqrt(square.sum(axis=0) / count)
        rms = float(np.sqrt(square.sum() / seen.sum()))
        worst = int(np.argmax(each))
        spread = 3**0.5 * placement if placement else np.inf
        if rms > min(LARGE_RESIDUAL, PLACEMENTS * spread):
            yield (
                SUSPICIOUS,
                f"markers lie {1e3 * rms:.1f} mm RMS from the model, '{recording.marker_names[worst]}' most: wrong "
                "map, unit or size?",
            )
        else:
            off = (each > ONE_PLACEMENT * spread) & (each > OTHERS * np.median(each))
            if off.any():
                told = ", ".join(f"'{recording.marker_names[i]}' {1e3 * each[i]:.0f} mm" for i in np.flatnonzero(off))
                yield SUSPICIOUS, f"single markers lie far from their sites ({told} RMS): swapped, or misplaced?"
    markers, time = np.asarray(recording.markers), np.asarray(recording.time)
    if not markers.size:
        return
    for index, name in enumerate(recording.marker_names):
        course = markers[:, index]
        origin = (course == 0).all(axis=1)
        if origin.any() and not origin.all():
            yield (
                SUSPICIOUS,
                f"marker '{name}' is exactly at the origin in {origin.sum()} frames, the first at {time[origin][0]:g} "
                "s: does the file write zeros for a missing marker?",
            )
    yield from _held(recording, markers, time)
    yield from _together(recording, markers)
    places = markers.reshape(-1, 3)
    places = places[np.isfinite(places).all(axis=1)]
    if len(places):
        extent = float(np.max(places.max(axis=0) - places.min(axis=0)))
        if not EXTENT[0] <= extent <= EXTENT[1]:
            yield SUSPICIOUS, f"markers spread over {extent:g} m; they must be in m"


def _held(recording: Recording, markers: np.ndarray, time: np.ndarray) -> Iterator[Finding]:
    """Runs of frames without the slightest movement: gaps that some software filled with the last place."""
    still = np.zeros((len(time) + 1, markers.shape[1]), bool)
    still[1:-1] = (np.diff(markers, axis=0) == 0).all(axis=2) & (markers[1:] != 0).any(axis=2)
    told, least = [], max(20, int(HELD * recording.rate))
    for index, name in enumerate(recording.marker_names):
        edges = np.diff(still[:, index].astype(int))
        start, stop = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
        if len(start) and np.max(stop - start) >= least:
            longest = int(np.argmax(stop - start))
            told.append(
                f"'{name}' for {time[stop[longest]] - time[start[longest]]:.2g} s at {time[start[longest]]:g} s"
            )
    if told:
        more = f" and {len(told) - 3} more" if len(told) > 3 else ""
        yield (
            SUSPICIOUS,
            f"markers stand exactly still: {', '.join(told[:3])}{more}; are gaps filled with the last place?",
        )


def _together(recording: Recording, markers: np.ndarray) -> Iterator[Finding]:
    """Two names for one marker."""
    middle = markers[:: max(1, len(markers) // 50)]
    apart = np.linalg.norm(middle[:, :, None] - middle[:, None, :], axis=3)
    count = np.isfinite(apart).sum(axis=0)
    typical = np.where(count > 0, np.where(np.isfinite(apart), apart, 0.0).sum(axis=0) / np.maximum(count, 1), np.inf)
    for first, second in zip(*np.nonzero(np.triu(typical < SAME_PLACE, 1)), strict=True):
        names = recording.marker_names
        yield SUSPICIOUS, f"markers '{names[first]}' and '{names[second]}' are at the same place"
