"""Which runs of the identification benchmark came to the best fit, when, and after how much work."""

import identify_scene as press
import numpy as np

CLOSE = 0.01
"""Relative, of every stiffness."""


def near(value, best) -> bool:
    """Within 1 % in every stiffness."""
    return bool(np.all(np.abs(np.asarray(value) / np.asarray(best) - 1.0) < CLOSE))


def told(runs: list[dict], best) -> dict:
    """Medians of the runs that came within 1 %."""
    rows: dict = {"starts": len(runs), "succeeded": sum(near(run["value"], best) for run in runs)}
    rows["best"] = {name: float(k) for name, k in zip(press.JOINTS, best, strict=True)}
    rows["error of best %"] = (100 * np.abs(np.asarray(best) / press.STIFFNESS - 1)).tolist()
    rows["cost"] = min(run["cost"] for run in runs)
    for key in (
        "s",
        "CPU s",
        "evaluations",
        "rollouts",
        "whole s",
        "whole CPU s",
        "whole evaluations",
        "whole rollouts",
    ):
        values = [run[key] for run in runs if key in run]
        if values:
            rows[f"{key}, median"], rows[f"{key}, most"] = float(np.median(values)), float(max(values))
    return rows


def reached(run: dict, best) -> dict:
    """When a run came near and stayed: its best candidate so far."""
    lead, since = None, None
    for number, row in enumerate(run["rows"]):
        if np.isfinite(row[2]) and (lead is None or row[2] < lead[2]):
            lead = row
            since = (number, row) if near(row[3], best) and since is None else since if near(row[3], best) else None
    found = {"cost": lead[2], "whole s": run.get("seconds", run["rows"][-1][0]), "value": lead[3]}
    found |= {"whole CPU s": run["CPU"], "whole rollouts": run.get("rollouts", run["rows"][-1][1])}
    if since is not None:
        found |= {"s": since[1][0], "CPU s": since[1][4], "rollouts": since[1][1], "evaluations": since[0] + 1}
    return found
