"""Table 2 of Kry and Pai (2006): k_G from the compliances of Table 1, and simulated perturbation trials against truth.

    python experiments/kry_pai_2006/table2.py --sessions EXPLORE.NC SCRATCH.NC --truth SHARED_DATA/virtual_sessions

First part: which postures of the shipped finger have the k_G that Table 2 prints. It is one equation for four angles
and the hand's length; shown are the posture closest to a stated natural one and the spread over natural postures drawn
around it. Second part (needs recordings of `virtual_perturb_*.toml` by `icjax capture`; skipped without): m, b, k,
secant stiffness and reaction time of the simulated subjects beside the truth. No person was measured. Writes
table2.json.
"""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import tyro
from contact_events import RESULTS, rounded

from icjax.estimation import Perturbation, in_series, perturbation, posture_search
from icjax.model import index_finger
from icjax.recording import Session

JOINTS = ("wrist", "MP", "PIP", "DIP")
TABLE_1 = {"exploring": (0.3488, 0.9882, 0.6715, 2.0052), "scratching": (0.1531, 0.4788, 0.8426, 0.8432)}
"""rad/Nm; the two scratching values of PIP and DIP are upper bounds in the paper."""
K_G = {"exploring": 81.86, "scratching": 285.96}
NATURAL = {"exploring": (0.0, 25.0, 25.0, 15.0), "scratching": (5.0, 30.0, 35.0, 20.0)}
"""Degrees: a relaxed hand that strokes a plate with the pad, and a more curled one that scratches; the palm's pitch
stands for the wrist angle, the forearm being level. A choice, made before the search."""
SPREAD = (10.0, 15.0, 15.0, 10.0)
"""Degrees."""
HAND_LENGTH, HAND_LENGTH_SD = 0.19, 0.01
"""m, adults."""


@dataclasses.dataclass(frozen=True)
class Config:
    """Number of natural postures; recordings (exploring, scratching) and truth of the simulated sessions."""

    draws: int = 60
    seed: int = 0
    sessions: tuple[Path, ...] = ()
    truth: Path | None = None
    out: Path = RESULTS


def postures(task: str, config: Config) -> dict:
    """Closest posture, spread of the family, shares of the joints."""
    model = index_finger(HAND_LENGTH, root="fixed")
    spread = np.radians(SPREAD)
    search = posture_search(
        model, "fingertip", np.array(TABLE_1[task]), K_G[task], spread, HAND_LENGTH_SD / HAND_LENGTH
    )
    natural = np.radians(NATURAL[task])
    best = search(natural, 1.0)
    fixed = posture_search(model, "fingertip", np.array(TABLE_1[task]), K_G[task], spread, 1e-4)(natural, 1.0)
    random = np.random.default_rng(config.seed)
    family = []
    for _ in range(config.draws):
        start = np.clip(natural + spread * random.standard_normal(4), model.lower, model.upper)
        family.append(search(start, 1.0 + HAND_LENGTH_SD / HAND_LENGTH * random.standard_normal()))
    found = [item for item in family if item.found]
    angles = np.degrees([item.q for item in found])
    shares = np.array([item.share for item in found])
    return {
        "k_G N/m": K_G[task],
        "natural degrees": dict(zip(JOINTS, NATURAL[task], strict=True)),
        "closest": described(best),
        "closest with a hand of 0.19 m": described(fixed),
        "family": {
            "drawn": config.draws,
            "found": len(found),
            "degrees, 5 50 95 %": _quantiles(angles),
            "hand length m, 5 50 95 %": list(HAND_LENGTH * np.quantile([x.scale for x in found], [0.05, 0.5, 0.95])),
            "share, 5 50 95 %": _quantiles(shares),
            "share of wrist and MP, 0 50 100 %": list(np.quantile(shares[:, 0] + shares[:, 1], [0, 0.5, 1])),
        },
    }


def described(posture) -> dict:
    """A posture in degrees with its shares."""
    return {
        "found": posture.found,
        "k_G N/m": f"{posture.stiffness:.2f}",
        "degrees": dict(zip(JOINTS, np.degrees(posture.q).tolist(), strict=True)),
        "hand length m": HAND_LENGTH * posture.scale,
        "fingertip below horizontal, degrees": float(np.degrees(posture.tilt)),
        "distance from natural": posture.distance,
        "share": dict(zip(JOINTS, posture.share.tolist(), strict=True)),
    }


def _quantiles(columns: np.ndarray) -> dict:
    rows = np.quantile(columns, [0.05, 0.5, 0.95], axis=0).T
    return {name: list(row) for name, row in zip(JOINTS, rows, strict=True)}


def against_truth(found: Perturbation, truth) -> dict:
    """The measured against what the simulated subject has: endpoint values from M, B, C and J at the release."""
    J, C, M = truth["J"], np.diag(truth["C"]), truth["M"]
    G = J @ C @ J.T
    e = found.secant.direction[[0, 2]]
    up = J[1]
    k_G = float(1 / G[1, 1])
    shape = C @ up * k_G
    fit, secant = found.fit, found.secant
    return {
        "onset error ms": 1e3 * (found.onset - float(truth["release_time"])),
        "reaction ms, true 95": 1e3 * found.reaction.time,
        "reaction 95 % ms": [1e3 * found.reaction.lower, 1e3 * found.reaction.upper],
        "m kg": _interval(fit, 0),
        "true m: 1/(J M^-1 J^T), of the static shape": [
            float(1 / (up @ np.linalg.solve(M, up))),
            float(shape @ M @ shape),
        ],
        "b Ns/m": _interval(fit, 1),
        "true b of the static shape": float(shape @ (truth["B"] * shape)),
        "k N/m": _interval(fit, 2),
        "R2": fit.r_squared,
        "true k_G": k_G,
        "true k_G with pad": in_series(k_G, 1 / 750),
        "secant vertical": [secant.stiffness, secant.lower, secant.upper],
        "error of the vertical secant %": 100 * (secant.stiffness / k_G - 1),
        "secant along the force": [secant.along, secant.along_lower, secant.along_upper],
        "true along the force": float(1 / (e @ G @ e)),
        "error along the force %": 100 * (secant.along * float(e @ G @ e) - 1),
    }


def _interval(fit, index: int) -> list[float]:
    return [float(fit.value[index]), float(fit.lower[index]), float(fit.upper[index])]


def simulated(path: Path, truth: Path) -> dict:
    """Every trial of a session at the window of the design and at the last 20 ms before the reaction."""
    session = Session.load(path)
    result = {}
    for window in ((0.05, 0.09), (0.07, 0.09)):
        for trial in session.trials():
            own = np.load(truth / session.name / f"{trial.name}_truth.npz")
            key = f"{session.name} {trial.name}, secant {1e3 * window[0]:.0f}-{1e3 * window[1]:.0f} ms"
            short = 0.025 if "explore" in session.name else 0.02
            result[key] = against_truth(perturbation(trial, window=short, secant_window=window), own)
    return result


def main(config: Config) -> dict:
    """Both parts; a run without recordings keeps the second part of an earlier one out of the file."""
    jax.config.update("jax_enable_x64", True)
    result: dict = {"figure": "Kry and Pai 2006, Table 2", "posture": {task: postures(task, config) for task in K_G}}
    if config.sessions and config.truth:
        result["data"] = "simulated with MuJoCo; no person was measured"
        result["perturbation"] = {}
        for path in config.sessions:
            result["perturbation"] |= simulated(path, config.truth)
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "table2.json").write_text(json.dumps(rounded(result), indent=1) + "\n")
    return rounded(result)


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Config)), indent=1))
