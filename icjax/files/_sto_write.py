"""Write OpenSim storage files: STO and MOT."""

import math
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from icjax.files._whole import check_labels, check_times, write_whole

DIGITS = 12
"""Significant digits of every number."""


def write_sto(
    path: str | os.PathLike,
    *,
    time: Float[np.ndarray, " row"],
    names: Sequence[str],
    values: Float[np.ndarray, "row column"],
    in_degrees: bool = False,
) -> Path:
    """Write a table over time as STO or MOT (one layout, the suffix is yours), complete or not at all.

    Values are written as they are; `in_degrees` is what the header says about the angles among them. NaN is written
    as NaN.

    **Arguments**: `time` s; `names` one a column, without blanks; `values` in the units that their names imply.

    **Returns** the path. **Errors**: `ValueError` naming the argument; `FileError` if it cannot be written.
    """
    path = Path(path)
    if len(names) != values.shape[1]:
        raise ValueError(f"names has {len(names)} names for {values.shape[1]} columns")
    check_labels(["time", *names], "names", " \t\v\f")
    check_times(time, len(values))
    if np.isinf(values).any():
        raise ValueError(f"values of '{names[int(np.argwhere(np.isinf(values))[0, 1])]}' are infinite")

    def rows():
        yield path.stem
        yield "version=1"
        yield f"nRows={len(values)}"
        yield f"nColumns={len(names) + 1}"
        yield f"inDegrees={'yes' if in_degrees else 'no'}"
        yield "endheader"
        yield "\t".join(["time", *names])
        for row in np.concatenate([time[:, None], values], axis=1).tolist():
            yield "\t".join("NaN" if math.isnan(value) else f"{value:.{DIGITS}g}" for value in row)

    return write_whole(path, rows())
