"""`icjax calibrate`: film sensors pressed against a reference, to the curves that turn their voltage into force."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

LARGE_RESIDUAL = 0.2
"""Of the range; film sensors with their hysteresis stay below half of it."""


@dataclass(frozen=True)
class Calibrate:
    """Fit a monotone curve force = g(voltage) to each film sensor (FSR); a session's source names the file written."""

    calibration: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CALIBRATION.TOML")]
    """What was pressed against what; its keys are explained in the guide "Instruments"."""
    out: Path = Path("fsr.toml")
    """File for the curves."""

    def run(self) -> None:
        from icjax.capture import calibrate, write_curves

        curves = calibrate(self.calibration)
        print(f"{'channel':16s} {'range N':>9s} {'residual N':>11s} {'hysteresis %':>16s} {'drift %/min':>18s}")
        for curve in curves:
            hysteresis = f"{curve.hysteresis_percent:.1f} +- {curve.hysteresis_noise_percent:.1f}"
            if curve.hysteresis_percent != curve.hysteresis_percent:
                hysteresis = "not seen"
            drift = f"{curve.drift_percent_per_minute:.2f} +- {curve.drift_sd:.2f}"
            print(
                f"{curve.channel:16s} {curve.force[-1]:9.3g} {curve.residual_sd:11.3g} {hysteresis:>16s} {drift:>18s}"
            )
        for curve in curves:
            if curve.residual_sd > LARGE_RESIDUAL * curve.force[-1]:
                print(
                    f"suspicious: {curve.channel}: the residual is {curve.residual_sd / curve.force[-1]:.0%} of the "
                    "range: is it the sensor that was pressed, at the same time, below saturation?"
                )
        write_curves(self.out, curves, self.calibration.name)
        print(f"wrote {self.out}")
