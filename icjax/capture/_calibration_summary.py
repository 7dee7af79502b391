"""What a calibration changed, as provenance and in words."""

from typing import Any

import numpy as np

from icjax.capture._calibrate import Calibration

SHOWN = {"1": ("%", 100.0), "rad": ("deg", 180.0 / np.pi), "m": ("mm", 1000.0)}
"""Units for people."""


def calibration_record(calibration: Calibration) -> dict[str, Any]:
    """Numbers of a calibration for the provenance of a recording, SI units."""
    columns = zip(
        calibration.names,
        calibration.units,
        calibration.value.tolist(),
        calibration.sd.tolist(),
        calibration.prior_sd.tolist(),
        calibration.determined.tolist(),
        strict=True,
    )
    keys = ("name", "unit", "value", "sd", "prior_sd", "determined")
    return {
        "frames": calibration.frames,
        "converged": calibration.converged,
        "marker_sd_m": calibration.marker_sd,
        "residual_before_m": calibration.residual_before,
        "residual_after_m": calibration.residual_after,
        "parameters": [dict(zip(keys, column, strict=True)) for column in columns],
    }


def calibration_lines(record: dict[str, Any]) -> list[str]:
    """Lines of text: residuals before and after, every size and axis, and the places taken together."""
    lines = [
        f"calibration on {record['frames']} frames: markers {1e3 * record['residual_before_m']:.2f} mm RMS from the "
        f"model before, {1e3 * record['residual_after_m']:.2f} mm after"
        + ("" if record["converged"] else "; NOT CONVERGED")
    ]
    places = [item for item in record["parameters"] if item["unit"] == "m"]
    for item in record["parameters"]:
        if item["unit"] == "m":
            continue
        unit, factor = SHOWN[item["unit"]]
        weak = (
            "" if item["determined"] else f"; the recordings hardly say (prior {factor * item['prior_sd']:.2g} {unit})"
        )
        lines.append(
            f"{item['name']}: {factor * item['value']:+.2f} {unit} (sd {factor * item['sd']:.2g} {unit}){weak}"
        )
    if places:
        sizes = 1e3 * np.array([item["value"] for item in places])
        weak = [item["name"].removeprefix("place ") for item in places if not item["determined"]]
        lines.append(
            f"{len(places) // 3} markers moved by {np.sqrt(np.mean(sizes**2)):.2f} mm RMS an axis, "
            f"{np.abs(sizes).max():.2f} mm at most; the recordings hardly say {len(weak)} of {len(places)} coordinates"
        )
    return lines
