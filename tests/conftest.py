"""Strict by default: float64, no silent rank promotion, shapes and types checked at every call."""

import gc
import importlib.util
import mmap
import os
from collections import Counter
from pathlib import Path


def _quick_compilation() -> list[str]:
    """The suite compiles much and computes little. The second flag halves the time, but a jaxlib without it aborts."""
    flags = ["--xla_backend_optimization_level=1"]
    spec = importlib.util.find_spec("jaxlib")
    folders = (spec.submodule_search_locations if spec else None) or []
    for library in (path for folder in folders for path in Path(folder).glob("libjax_common.*")):
        with library.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
            if content.find(b"xla_cpu_use_fusion_emitters") >= 0:
                flags.append("--xla_cpu_use_fusion_emitters=false")
    return flags


os.environ["XLA_FLAGS"] = " ".join(
    [os.environ.get("XLA_FLAGS", ""), *_quick_compilation()]
).strip()  # read once, by JAX
gc.set_threshold(50_000, 50, 1000)  # tracing makes many small objects that live long
os.environ.setdefault("NPROC", "1")  # XLA's threads would fight with the other workers of the suite

import jax
import jaxtyping
import pytest

SHARED = {"fit", "mixed", "recorded"}
"""Fixtures made from one fitted session, which takes a minute."""

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
_CHECKED = jaxtyping.install_import_hook("icjax", "beartype.beartype")


def pytest_collection_modifyitems(config, items):
    """A file's tests share a worker, and with it what they prepare; so do all that look at the one fit of `fit`. What
    has most slow tests begins, so that no worker waits for the other in the end."""
    group = {
        item: "fit" if item.path.parent.name == "fit" and SHARED & set(item.fixturenames) else str(item.path)
        for item in items
    }
    slow = Counter(group[item] for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: (-slow[group[item]], group[item]))
    if config.pluginmanager.hasplugin("xdist"):
        for item in items:
            item.add_marker(pytest.mark.xdist_group(group[item]))


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Other people's data: beside the repository, or where ICJAX_SHARED_DATA says."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("ICJAX_SHARED_DATA", root.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"other people's data are absent: {folder} (set ICJAX_SHARED_DATA)")
    return folder
