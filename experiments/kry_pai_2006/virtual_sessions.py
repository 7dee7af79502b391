"""What the studies on the simulated sessions share: the sessions captured, and their truth apart."""

import dataclasses
import json
import os
from pathlib import Path
from typing import Any

import numpy as np

from icjax.capture import capture, read_session
from icjax.recording import Recording, Session

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
RESULTS = HERE.parent / "results" / "kry_pai_2006"
JOINTS = ("wrist", "MP", "PIP", "DIP")
SIMULATED = "simulated with MuJoCo, independently of icjax; no person was measured"


def shared_data() -> Path:
    """Where the sessions lie: ICJAX_SHARED_DATA, or ../shared/data beside the repository."""
    return Path(os.environ.get("ICJAX_SHARED_DATA", ROOT.parent / "shared" / "data")).resolve()


def trials_of(name: str, cache: Path | None = None) -> tuple[Recording, ...]:
    """The trials of a session, captured (half a minute), or read from `cache/NAME.nc` where that exists."""
    if cache is not None and (cache / f"{name}.nc").exists():
        return Session.load(cache / f"{name}.nc").trials()
    os.environ["ICJAX_SHARED_DATA"] = str(shared_data())
    spec = read_session(ROOT / "experiments" / "sessions" / f"virtual_{name}.toml")
    session = capture(dataclasses.replace(spec, trials=tuple(item for item in spec.trials if item.role == "trial")))
    if cache is not None:
        session.save(cache / f"{name}.nc")
    return session.trials()


def truth_of(name: str, trial: str) -> dict[str, np.ndarray]:
    """Truth of one trial, what of it is numbers; it only judges."""
    with np.load(shared_data() / "virtual_sessions" / name / f"{trial}_truth.npz") as stored:
        return {key: stored[key].astype(float) for key in stored.files if stored[key].dtype.kind != "U"}


def true_compliance(name: str) -> np.ndarray:
    """Of the four joints, rad/Nm; the same in every trial of a session."""
    return truth_of(name, "trial00")["C"]


def write(path: Path, result: dict[str, Any]) -> None:
    """Three significant digits, so that the committed file does not change with the machine; null for no number."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(rounded(result), indent=1) + "\n")


def rounded(value: Any) -> Any:
    """The same with every float to three significant digits, arrays as lists."""
    if isinstance(value, dict):
        return {str(key): rounded(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return rounded(value.tolist())
    if isinstance(value, list | tuple):
        return [rounded(item) for item in value]
    if isinstance(value, float | np.floating):
        return float(f"{value:.3g}") if np.isfinite(value) else None
    return int(value) if isinstance(value, np.integer) else value
