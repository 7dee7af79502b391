"""Figure 8 of Kry and Pai (2006): a contact whose extrapolated trajectory yields a negative compliance.

    python experiments/kry_pai_2006/figure8.py

Shown is the negative estimate farthest below zero in units of its standard error, and the reference trajectory that
1 rad/Nm would give (Eq. 1), which the extrapolation does not follow. Such an estimate is kept and marked, never used
as the event's compliance. All data are simulated. Writes figure8.png and figure8.json.
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
    """The same session and fits as figure 3."""

    seed: int = 3
    trials: int = 2
    contacts: int = 4
    window: float = 0.05
    degree: int = 1
    out: Path = RESULTS


def main(config: Config) -> dict:
    """Record, capture, estimate, choose, draw."""
    jax.config.update("jax_enable_x64", True)
    options = EstimationOptions(window_before=config.window, window_after=config.window, degree=config.degree)
    interactions, truth = interactions_of(config.seed, config.trials, config.contacts, options)
    per_event = interactions[0].per_event
    negative = np.asarray(per_event.status) == STATUS.index("negative")
    if not negative.any():
        raise ValueError(f"seed {config.seed}: no negative estimate")
    below = np.asarray(per_event.compliance) / np.asarray(per_event.standard_error)
    event, column = np.unravel_index(int(np.argmin(np.where(negative, below, np.inf))), negative.shape)
    joint = per_event.joint_names[int(column)]
    caption = (
        f"Simulated data (virtual laboratory, seed {config.seed}). "
        f"The simulated subject's compliance is {truth[joint]:.3g} rad/Nm."
    )
    usable = np.isin(np.asarray(per_event.status), [STATUS.index("accepted"), STATUS.index("negative")])
    result = {
        "figure": "Kry and Pai 2006, Figure 8",
        "config": {**dataclasses.asdict(config), "out": None},
        "true compliance rad/Nm": truth[joint],
        "negative estimates of all joints": int(negative.sum()),
        "estimates of all joints": int(usable.sum()),
    }
    return write("figure8", config.out, interactions, int(event), joint, caption, result, 0.05)


if __name__ == "__main__":
    print(json.dumps(main(tyro.cli(Config)), indent=1))
