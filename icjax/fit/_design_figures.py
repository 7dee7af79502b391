"""What a plan says, as plain numbers: for a table or a file."""

from typing import Any

import numpy as np

from icjax.fit._design import Design


def design_figures(plan: Design, best: int = 3) -> dict[str, Any]:
    """What `icjax design --out` writes: of every probe, best first, widths, refused joints, largest torque (Nm),
    deflection and doubt (rad) and contacts needed, then the best sets of one to `best` probes.

    Numbers are rounded to four digits; what is not finite is None. Sets share as many contacts as the probe with the
    most has.

    **Arguments**: `best` above the number of probes counts as that many.

    **Errors**: `ValueError` for a `best` below one.
    """
    if best < 1:
        raise ValueError(f"best = {best}: must be at least 1")
    widths, total = plan.widths, max(probe.contacts for probe in plan.probes)
    return {
        "joints": list(plan.joints),
        "catch trials": plan.catch_trials,
        "widest": plan.options.widest,
        "probes": [_row(plan, item, widths[item]) for item in plan.ranking()],
        "best sets": [_set(plan, count, total) for count in range(1, min(best, len(plan.probes)) + 1)],
    }


def _row(plan: Design, item: int, width: np.ndarray) -> dict[str, Any]:
    return {
        "probe": plan.probes[item].name,
        "contacts": plan.probes[item].contacts,
        "width": _plain(width),
        "refused": [joint for joint, no in zip(plan.joints, plan.expected([item]).refused, strict=True) if no],
        "torque Nm": _plain(plan.torque[item]),
        "deflection rad": _plain(plan.deflection[item]),
        "doubt rad": _plain(plan.doubt[item]),
        "contacts needed": _plain(plan.contacts_needed([item])),
    }


def _set(plan: Design, count: int, contacts: int) -> dict[str, Any]:
    chosen = plan.best_set(count, contacts)
    return {
        "probes": [plan.probes[item].name for item in chosen],
        "contacts": contacts,
        "width": _plain(plan.expected(chosen, contacts).width),
    }


def _plain(values: np.ndarray) -> list[float | None]:
    return [float(f"{value:.4g}") if np.isfinite(value) else None for value in values]
