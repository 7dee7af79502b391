"""Write TRC marker files as OpenSim reads them."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from icjax.files._units import length_factor
from icjax.files._whole import check_labels, check_times, write_whole

FINEST = 9
"""Coordinates are printed to 10^-9 m, times to 10^-9 s."""

HEADER = "DataRate CameraRate NumFrames NumMarkers Units OrigDataRate OrigDataStartFrame OrigNumFrames"


def write_trc(
    path: str | os.PathLike,
    *,
    marker_names: Sequence[str],
    markers: Float[np.ndarray, "frame marker 3"],
    time: Float[np.ndarray, " frame"],
    rate: float,
    unit: str = "mm",
) -> Path:
    """Write markers as TRC, complete or not at all.

    A marker with a NaN coordinate is written as NaN NaN NaN, as OpenSim writes it.

    **Arguments**: `markers` m; `time` s; `rate` Hz, of the header; `unit` of length in the file.

    **Returns** the path. **Errors**: `ValueError` naming the argument; `FileError` if it cannot be written.
    """
    path = Path(path)
    factor = length_factor(unit)
    if factor is None:
        raise ValueError(f"unit must be a unit of length, not '{unit}'")
    if len(marker_names) != markers.shape[1] or not len(marker_names):
        raise ValueError(f"marker_names has {len(marker_names)} names for {markers.shape[1]} markers")
    check_labels(marker_names, "marker_names", "\t")
    check_times(time, len(markers))
    if not (np.isfinite(rate) and rate > 0):
        raise ValueError(f"rate must be a positive number of Hz, not {rate}")
    if np.isinf(markers).any():
        raise ValueError("markers holds an infinite coordinate; a missing one is NaN")
    frames, count = markers.shape[:2]
    stated = [f"{rate:.12g}", f"{rate:.12g}", f"{frames}", f"{count}", unit, f"{rate:.12g}", "1", f"{frames}"]
    decimals = max(0, math.ceil(FINEST + math.log10(factor)))
    missing = np.asarray(np.isnan(markers).any(axis=2))
    values = np.where(missing[:, :, None], np.nan, markers / factor).reshape(frames, 3 * count)

    def rows():
        yield f"PathFileType\t4\t(X/Y/Z)\t{path.name}"
        yield "\t".join(HEADER.split())
        yield "\t".join(stated)
        yield "Frame#\tTime\t" + "\t\t\t".join(marker_names) + "\t\t"
        yield "\t\t" + "\t".join(f"{axis}{index + 1}" for index in range(count) for axis in "XYZ")
        yield ""
        for index, (moment, row) in enumerate(zip(time, values, strict=True)):
            cells = ("NaN" if math.isnan(value) else f"{value:.{decimals}f}" for value in row.tolist())
            yield f"{index + 1}\t{moment:.{FINEST}f}\t" + "\t".join(cells)

    return write_whole(path, rows())
