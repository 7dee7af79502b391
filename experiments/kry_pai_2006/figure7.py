"""Figure 7 of Kry and Pai (2006): fingertip elevation and force when the platform jumps, and the reaction time.

    icjax capture experiments/sessions/virtual_perturb_explore.toml --out explore   (and _scratch)
    python experiments/kry_pai_2006/figure7.py explore/recording.nc scratch/recording.nc

Exploring left, scratching right, the second-order fit of Table 2 over the paper's windows (25 and 20 ms), secant
stiffness and first reaction. The data are simulated (MuJoCo, independently of icjax): no person was measured. Writes
figure7.png and figure7.json.
"""

import dataclasses
import json
from pathlib import Path

import jax
import tyro
from contact_events import RESULTS, rounded

from icjax.estimation import Perturbation, perturbation
from icjax.recording import Session
from icjax.view import plot_perturbations, save


@dataclasses.dataclass(frozen=True)
class Config:
    """Recordings of the exploring and the scratching session, and which trial of each."""

    exploring: tyro.conf.Positional[Path]
    scratching: tyro.conf.Positional[Path]
    trial: str = "trial00"
    secant: tuple[float, float] = (0.07, 0.09)
    out: Path = RESULTS


def numbers(found: Perturbation) -> dict:
    """What the figure shows."""
    fit, secant = found.fit, found.secant
    names = ("m kg", "b Ns/m", "k N/m", "f0 N")
    return {
        **{name: list(map(float, (fit.value[i], fit.lower[i], fit.upper[i]))) for i, name in enumerate(names)},
        "window s": fit.window,
        "R2": fit.r_squared,
        "secant N/m": [secant.stiffness, secant.lower, secant.upper],
        "along the force N/m": [secant.along, secant.along_lower, secant.along_upper],
        "reaction s": list(found.reaction),
    }


def main(config: Config) -> dict:
    """Analyse, draw, write."""
    jax.config.update("jax_enable_x64", True)
    found = []
    for path, window in ((config.exploring, 0.025), (config.scratching, 0.020)):
        trials = [item for item in Session.load(path).trials() if item.name == config.trial]
        if not trials:
            raise ValueError(f"{path} has no trial {config.trial}")
        found.append(perturbation(trials[0], window=window, secant_window=config.secant))
    figure = plot_perturbations(tuple(found), ("exploring", "scratching"))
    caption = "Simulated data (MuJoCo subjects A and B); no person was measured. They withdraw 95 ms after the jump."
    figure.supxlabel(caption, fontsize=7.5, color="#5B616B")
    save(figure, config.out / "figure7.png")
    result = {
        "figure": "Kry and Pai 2006, Figure 7",
        "data": "simulated with MuJoCo; no person was measured",
        "exploring": numbers(found[0]),
        "scratching": numbers(found[1]),
    }
    (config.out / "figure7.json").write_text(json.dumps(rounded(result), indent=1) + "\n")
    return rounded(result)


if __name__ == "__main__":
    main(tyro.cli(Config))
