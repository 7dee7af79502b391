"""Force of a film sensor from its voltage: a monotone curve, fitted against a reference sensor."""

import dataclasses
import json
from pathlib import Path

import numpy as np
from jaxtyping import Float

from icjax.files import FileError, Table, read_toml

KNOTS = 12
"""Groups of samples along the force range; each gives one point of the curve."""

BRANCHES = 8
"""Groups along the force range in which loading and unloading are compared."""

FEWEST = 20
"""Samples of a group that says something."""

NEVER_FLAT = 1e-3
"""A curve whose voltage rises by less than this share of its range over a group cannot be inverted there."""


@dataclasses.dataclass(frozen=True)
class Curve:
    """Calibration of one channel.

    - `voltage`, `force`: knots of the curve, both increasing (V or what the channel holds; N).
    - `residual_sd` N; `hysteresis_percent`: largest difference of the loading and the unloading branch, percent of
      the range, and `hysteresis_noise_percent`, its standard error; NaN where no force was met on both.
    - `drift_percent_per_minute`: change of the gain, with `drift_sd`.
    """

    channel: str
    voltage: Float[np.ndarray, " knot"]
    force: Float[np.ndarray, " knot"]
    residual_sd: float
    hysteresis_percent: float
    hysteresis_noise_percent: float
    drift_percent_per_minute: float
    drift_sd: float
    samples: int

    def __call__(self, voltage: Float[np.ndarray, " sample"]) -> Float[np.ndarray, " sample"]:
        """Force, N: monotone cubic between the knots, zero below, the last slope continued above."""
        from scipy.interpolate import PchipInterpolator

        curve = PchipInterpolator(self.voltage, self.force)
        last = float(self.voltage[-1])
        slope = float((self.force[-1] - self.force[-2]) / (self.voltage[-1] - self.voltage[-2]))
        inside = curve(np.clip(voltage, self.voltage[0], last))
        return np.asarray(inside + slope * np.maximum(voltage - last, 0.0))


def fit_curve(
    channel: str,
    time: Float[np.ndarray, " sample"],
    voltage: Float[np.ndarray, " sample"],
    force: Float[np.ndarray, " sample"],
    noise: float,
) -> Curve:
    """Monotone curve force = g(voltage) from a sensor that was pressed against a reference.

    The voltage is the noisier of the two, so it is averaged over groups of equal force (averaging force over
    groups of equal voltage would flatten the curve); the means are made monotone by isotonic regression and the
    curve through them, a monotone cubic (PCHIP), is read the other way round. Its first knot is zero force at the
    unloaded voltage. Hysteresis: mean of g(v) - F while F rises minus while it falls, largest over groups.
    Drift: slope b of (g(v) - F) = F (a + b t).

    **Arguments**: `time` s; `voltage` of the channel; `force` N, of the reference, tared; `noise` N: standard
    deviation of the reference when unloaded.

    **Errors**: `ValueError` with too few loaded samples, or a channel that does not rise with force.
    """
    from scipy.optimize import isotonic_regression

    least = max(5 * noise, 0.02 * float(np.max(force)))
    loaded = force > least
    if loaded.sum() < 2 * FEWEST or (~loaded).sum() < FEWEST:
        raise ValueError(
            f"channel '{channel}': {loaded.sum()} loaded and {(~loaded).sum()} unloaded samples are too few"
        )
    x, v = force[loaded], voltage[loaded]
    edges = np.linspace(least, float(np.max(x)), KNOTS + 1)
    edges[-1] += 1e-9 + 1e-9 * edges[-1]
    group = np.digitize(x, edges) - 1
    counts = np.bincount(group, minlength=KNOTS)
    used = counts >= FEWEST
    if used.sum() < 2:
        raise ValueError(f"channel '{channel}': fewer than two of {KNOTS} force groups hold {FEWEST} samples")
    mean_x = (np.bincount(group, x, KNOTS)[used] / counts[used]).tolist()
    mean_v = (np.bincount(group, v, KNOTS)[used] / counts[used]).tolist()
    rest = ~loaded & (force < 2 * noise) if noise > 0 else ~loaded
    start = float(np.mean(voltage[rest]))
    knots_x = np.array([0.0, *mean_x])
    knots_v = np.array([start, *mean_v])
    weights = np.array([counts.max(), *counts[used]], dtype=float)
    knots_v = isotonic_regression(knots_v, weights=weights).x
    span = float(knots_v[-1] - knots_v[0])
    spread = float(np.std(voltage[rest]))
    if span <= 3 * spread / np.sqrt(FEWEST) or span <= 0:
        raise ValueError(f"channel '{channel}' does not rise with the reference force")
    keep = np.concatenate([[True], np.diff(knots_v) > NEVER_FLAT * span])
    curve = Curve(channel, knots_v[keep], knots_x[keep], 0.0, 0.0, 0.0, 0.0, 0.0, int(loaded.sum()))
    if len(curve.force) < 2:
        raise ValueError(f"channel '{channel}' saturates at once; it cannot be inverted")
    error = curve(voltage[loaded]) - x
    hysteresis, uncertainty = _hysteresis(time[loaded], x, error, curve.force[-1])
    drift, drift_sd = _drift(time[loaded], x, error)
    return dataclasses.replace(
        curve,
        residual_sd=float(np.sqrt(np.mean(error**2))),
        hysteresis_percent=hysteresis,
        hysteresis_noise_percent=uncertainty,
        drift_percent_per_minute=drift,
        drift_sd=drift_sd,
    )


def _hysteresis(time: np.ndarray, force: np.ndarray, error: np.ndarray, full: float) -> tuple[float, float]:
    rate = np.gradient(force, time)
    quiet = 0.05 * float(np.max(np.abs(rate)))
    edges = np.linspace(0.0, float(np.max(force)) * (1 + 1e-9), BRANCHES + 1)
    largest, uncertain = float("nan"), float("nan")
    for low, high in zip(edges[:-1], edges[1:], strict=True):
        here = (force >= low) & (force < high)
        up, down = error[here & (rate > quiet)], error[here & (rate < -quiet)]
        if min(len(up), len(down)) < FEWEST:
            continue
        difference = abs(float(up.mean() - down.mean()))
        if not difference <= largest:
            largest = difference
            uncertain = float(np.sqrt(up.var() / len(up) + down.var() / len(down)))
    return 100 * largest / full, 100 * uncertain / full


def _drift(time: np.ndarray, force: np.ndarray, error: np.ndarray) -> tuple[float, float]:
    minutes = (time - time.mean()) / 60.0
    X = np.stack([force, force * minutes], axis=1)
    if np.linalg.matrix_rank(X) < 2:
        return 0.0, float("inf")
    solution = np.linalg.lstsq(X, error, rcond=None)[0]
    scatter = float(np.sum((error - X @ solution) ** 2)) / max(len(error) - 2, 1)
    return 100 * float(solution[1]), 100 * float(np.sqrt(scatter * np.linalg.inv(X.T @ X)[1, 1]))


def curves_text(curves: tuple[Curve, ...], title: str) -> str:
    """The TOML text of a calibration file, which `read_curves` reads back."""
    lines = [f"# {title}", "# knots of a monotone cubic (PCHIP): value of the channel, force in N"]
    for curve in curves:
        lines += [
            "",
            "[[curve]]",
            f"channel = {json.dumps(curve.channel)}",
            f"voltage = {[float(f'{value:.8g}') for value in curve.voltage]}",
            f"force = {[float(f'{value:.8g}') for value in curve.force]}",
        ]
        for key in ("residual_sd", "hysteresis_percent", "hysteresis_noise_percent", "drift_percent_per_minute"):
            lines.append(f"{key} = {getattr(curve, key):.5g}")
        lines += [f"drift_sd = {curve.drift_sd:.5g}", f"samples = {curve.samples}"]
    return "\n".join(lines) + "\n"


def read_curves(path: Path) -> dict[str, Curve]:
    """Curves of a calibration file by channel. **Errors**: `FileError` naming file, curve and key."""
    top = Table(path, "", read_toml(path))
    curves = {}
    for table in top.tables("curve"):
        channel = table.text("channel")
        voltage, force = (
            table.take(key, _rising, "a list of two or more increasing numbers") for key in ("voltage", "force")
        )
        if len(voltage) != len(force):
            raise table.error(f"lists {len(voltage)} voltages and {len(force)} forces")
        numbers = {
            key: _any(table, key)
            for key in ("residual_sd", "hysteresis_percent", "hysteresis_noise_percent", "drift_percent_per_minute")
        }
        curve = Curve(
            channel, voltage, force, **numbers, drift_sd=_any(table, "drift_sd"), samples=table.whole("samples")
        )
        if channel in curves:
            raise table.error(f"channel '{channel}' has two curves")
        curves[channel] = curve
        table.close()
    top.close()
    if not curves:
        raise FileError(path, "holds no [[curve]]; is it what `icjax calibrate` wrote?")
    return curves


def _any(table: Table, key: str) -> float:
    return table.take(key, float, "a number")


def _rising(value: object) -> np.ndarray:
    numbers = np.array(value, dtype=float)
    if numbers.ndim != 1 or len(numbers) < 2 or not np.isfinite(numbers).all() or not (np.diff(numbers) > 0).all():
        raise ValueError
    return numbers
