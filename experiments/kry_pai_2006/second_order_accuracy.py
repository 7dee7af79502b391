"""How well can m, b and k of Table 2 be known? Cramer-Rao bound and repeated simulated trials.

    python experiments/kry_pai_2006/second_order_accuracy.py

One degree of freedom with the paper's exploring values rests on a sprung platform (25 Hz, damping ratio 0.9) that
jumps by 5 to 7 mm, recorded at 500 Hz with 10 mN of force noise. The position is that of one marker (0.2 mm), of a
plate with four markers (0.1 mm), or of a platform whose path is known from calibration (2 um). The data are simulated.
Writes second_order_accuracy.json: the bound in percent, the trials that a standard deviation of 1 % needs (so that
95 % of results are within 2 %), and mean error, spread and coverage of 95 % intervals over the trials.
"""

import dataclasses
import json
from pathlib import Path

import numpy as np
import tyro
from contact_events import RESULTS, rounded

from icjax.estimation import PARAMETERS, fit_second_order, pool_fits

TRUE = np.array([0.017, 2.04, 89.16, 0.677])
PLATFORM = 2 * np.pi * 25, 0.9
STEP = 0.002
FORCE_NOISE = 0.01
NOISES = {"one marker": 0.2e-3, "four markers": 0.1e-3, "calibrated platform": 2e-6}


@dataclasses.dataclass(frozen=True)
class Config:
    """Windows (s) and number of trials."""

    windows: tuple[float, ...] = (0.025, 0.06, 0.09)
    trials: int = 200
    seed: int = 1
    out: Path = RESULTS


def platform(s: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Displacement, velocity, acceleration at `s` after the release of a damped spring."""
    w, damping = PLATFORM
    wd = w * np.sqrt(1 - damping**2)
    on = s >= 0
    s = np.maximum(s, 0.0)
    decay = height * np.exp(-damping * w * s)
    z = on * (height - decay * (np.cos(wd * s) + damping * w / wd * np.sin(wd * s)))
    v = on * decay * w * w / wd * np.sin(wd * s)
    return z, v, on * (w * w * (height - z) - 2 * damping * w * v)


def trial(random: np.random.Generator, position_noise: float, force_noise: float):
    """Time, position, force of one trial and its onset, anywhere between two samples."""
    time = np.arange(-0.2, 0.15, STEP)
    onset = random.uniform(0, STEP)
    z, v, a = platform(time - onset, random.uniform(0.005, 0.007))
    force = TRUE[0] * a + TRUE[1] * v + TRUE[2] * z + TRUE[3]
    z = z + position_noise * random.standard_normal(len(time))
    return time, z, force + force_noise * random.standard_normal(len(time)), onset


def study(config: Config, method: str, noise: float, window: float) -> dict:
    """Bound, and what the trials give."""
    random = np.random.default_rng(config.seed)
    settings = {"window": window, "method": method, "position_noise": noise, "force_noise": FORCE_NOISE}
    time, z, force, onset = trial(random, 0.0, 0.0)
    clean = fit_second_order(time, z, force, onset, **settings)
    fits = []
    for _ in range(config.trials):
        time, z, force, onset = trial(random, noise, FORCE_NOISE)
        fits.append(fit_second_order(time, z, force, round(onset / STEP) * STEP, **settings))
    values = np.stack([fit.value for fit in fits])
    covered = np.mean([(fit.lower <= TRUE) & (fit.upper >= TRUE) for fit in fits], axis=0)
    pooled, _ = pool_fits(tuple(fits))
    percent = {
        "error without noise %": 100 * (clean.value / TRUE - 1),
        "standard deviation over trials %": 100 * values.std(axis=0) / TRUE,
        "error of the mean of all trials %": 100 * (pooled / TRUE - 1),
        "intervals that cover %": 100 * covered,
    }
    if method == "path":
        bound = 100 * np.sqrt(np.diag(clean.covariance)) / TRUE
        percent = {"bound %": bound, "trials needed for 1 %": np.ceil(bound**2), **percent}
    result = {key: dict(zip(PARAMETERS, map(float, row), strict=True)) for key, row in percent.items()}
    return {**result, "median R2": float(np.median([fit.r_squared for fit in fits])), "condition": clean.condition}


def main(config: Config) -> dict:
    """All windows, noises and methods."""
    result: dict = {"data": "simulated; no person was measured", "trials": config.trials, "seed": config.seed}
    for name, noise in NOISES.items():
        for window in config.windows:
            for method in ("path", "derivative"):
                result[f"{name}, {1e3 * window:g} ms, {method}"] = study(config, method, noise, window)
                print(name, window, method, json.dumps(rounded(result[f"{name}, {1e3 * window:g} ms, {method}"])))
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "second_order_accuracy.json").write_text(json.dumps(rounded(result), indent=1) + "\n")
    return result


if __name__ == "__main__":
    main(tyro.cli(Config))
