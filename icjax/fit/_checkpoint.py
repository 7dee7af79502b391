"""Where a fit stands, kept in a file from which it goes on."""

import os
import tempfile
from pathlib import Path
from zipfile import BadZipFile

import jax
import jax.numpy as jnp
import numpy as np

SAME_COST = 1e-6
"""Relative; costs of one problem on two machines differ less."""


def write_checkpoint(path: Path, stage: int, x: np.ndarray, mark: float) -> None:
    """Complete or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, stage=stage, x=x, mark=mark)
        os.replace(temporary, path)
    finally:
        Path(temporary).unlink(missing_ok=True)


def read_checkpoint(path: Path, size: int, stages: int, mark: float) -> tuple[int, jax.Array]:
    """Stage and x. **Errors**: `ValueError` for a file that cannot be read, or of another problem."""
    try:
        with path.open("rb") as file, np.load(file) as stored:
            stage, x, found = int(stored["stage"]), np.asarray(stored["x"], float), float(stored["mark"])
    except (OSError, ValueError, TypeError, KeyError, EOFError, BadZipFile) as error:
        raise ValueError(f"checkpoint {path} cannot be read: {error}; remove it to start anew") from error
    if x.shape != (size,):
        raise ValueError(
            f"checkpoint {path} has {x.size} numbers, this problem {size}; it belongs to another: remove it"
        )
    if not 0 <= stage < stages:
        raise ValueError(f"checkpoint {path} is of stage {stage}, there are {stages}; it belongs to another: remove it")
    if not np.isclose(found, mark, rtol=SAME_COST, atol=0.0, equal_nan=True):
        raise ValueError(
            f"checkpoint {path} is of a problem whose nominal values cost {found:.6g}, those of this one {mark:.6g}; "
            "it belongs to another: remove it"
        )
    if not np.isfinite(x).all():
        raise ValueError(f"checkpoint {path} holds a number that is not finite; remove it to start anew")
    return stage, jnp.asarray(x)
