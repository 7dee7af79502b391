"""Strict by default: float64, no silent rank promotion, shapes and types checked at every call."""

import os
from pathlib import Path

# The suite compiles much and computes little; read when JAX starts.
os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=1".strip()

import jax
import jaxtyping
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
_CHECKED = jaxtyping.install_import_hook("icjax", "beartype.beartype")


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Other people's data: beside the repository, or where ICJAX_SHARED_DATA says."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("ICJAX_SHARED_DATA", root.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"other people's data are absent: {folder} (set ICJAX_SHARED_DATA)")
    return folder
