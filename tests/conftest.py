"""Strict by default: float64, no silent rank promotion, shapes and types checked at every call."""

import gc
import importlib.util
import mmap
import os
from pathlib import Path


def _quick_compilation() -> list[str]:
    """The suite compiles much and computes little: code is not optimised, which saves a sixth of its time. The second
    flag halves it, but a jaxlib without it aborts."""
    flags = ["--xla_backend_optimization_level=0"]
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
for _threads in ("NPROC", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):  # they would fight with those of other workers
    os.environ.setdefault(_threads, "1")

import jax
import jaxtyping
import pytest

MOST_MAPPINGS = 40_000

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")
_CHECKED = jaxtyping.install_import_hook("icjax", "beartype.beartype")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Those first whose modules prepare much: a worker begins with the first half in order, and prepares it once."""
    first = {"fit": 0, "report": 1}
    items.sort(key=lambda item: first.get(item.path.parent.name, 2))


@pytest.fixture(autouse=True, scope="module")
def _room_for_programs():
    """Forget compiled programs before they fill the process' table of mappings, thousands a file of tests: at
    65 530 Linux gives no more memory, and XLA ends in a segmentation fault."""
    yield
    mappings = Path("/proc/self/maps")
    if mappings.is_file() and mappings.read_bytes().count(b"\n") > MOST_MAPPINGS:
        jax.clear_caches()
        gc.collect()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """Other people's data: beside the repository, or where ICJAX_SHARED_DATA says."""
    root = Path(__file__).resolve().parents[1]
    folder = Path(os.environ.get("ICJAX_SHARED_DATA", root.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"other people's data are absent: {folder} (set ICJAX_SHARED_DATA)")
    return folder
