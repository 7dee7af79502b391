"""Figure 3 of Kry and Pai (2006): index MP flexion and torque at the time of contact, and the compliance read there.

    python experiments/kry_pai_2006/figure3.py

Shown is the contact with the smallest standard error of the MP compliance among the accepted ones. All data are
simulated. The simulated finger arrives at about 0.1 m/s on a stiff plate, so its torque rises within 10 ms and a
line over the window fits it less well than the paper's gentler contact. Writes figure3.png and figure3.json.
"""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import tyro
from contact_events import RESULTS, interactions_of, write

from icjax.estimation import EstimationOptions
from icjax.interaction import STATUS


@dataclasses.dataclass(frozen=True)
class Config:
    """The session, and the linear fits of the paper's figure."""

    seed: int = 3
    trials: int = 2
    contacts: int = 4
    joint: str = "MP"
    window: float = 0.05
    degree: int = 1
    out: Path = RESULTS


def main(config: Config) -> dict:
    """Record, capture, estimate, choose, draw."""
    jax.config.update("jax_enable_x64", True)
    options = EstimationOptions(window_before=config.window, window_after=config.window, degree=config.degree)
    interactions, truth = interactions_of(config.seed, config.trials, config.contacts, options)
    per_event = interactions[0].per_event
    column = per_event.joint_names.index(config.joint)
    accepted = np.asarray(per_event.status)[:, column] == STATUS.index("accepted")
    if not accepted.any():
        raise ValueError(f"seed {config.seed}: no accepted {config.joint} estimate")
    event = int(np.argmin(np.where(accepted, np.asarray(per_event.standard_error)[:, column], np.inf)))
    value = truth[config.joint]
    caption = (
        f"Simulated data (virtual laboratory, seed {config.seed}). "
        f"The simulated subject's compliance is {value:.3g} rad/Nm."
    )
    result = {
        "figure": "Kry and Pai 2006, Figure 3",
        "config": {**dataclasses.asdict(config), "out": None},
        "true compliance rad/Nm": value,
    }
    return write("figure3", config.out, interactions, event, config.joint, caption, result, 0.05)


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Config)), indent=1))
