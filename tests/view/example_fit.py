"""A made-up fit of two joints and four contacts, for pictures, pages and files; no evidence about any estimator."""

import json

import numpy as np

from icjax.fit import FitPeriods, FitRecord, FittedParameters, FitWindows
from icjax.inference import QUANTILE
from icjax.interaction import JointCompliance

JOINTS = ("wrist", "MP")
REASON = "its interval spans a factor of 9.4 (at most 4); missing: more contacts, or contacts that load it more"


def make_fit(name: str = "session", refused: tuple[str, ...] = ("", REASON)) -> FitRecord:
    windows = _windows()
    x, sd = np.log([0.25, 0.7]), np.array([0.05, 0.571])
    lower, upper = np.exp(x - QUANTILE * sd), np.exp(x + QUANTILE * sd)
    residual = windows.residual[np.isfinite(windows.residual)]
    return FitRecord(
        name=name,
        subject="S",
        trials=("trial00", "trial01"),
        catch_trials=4,
        joint_names=JOINTS,
        joint_kinds=("hinge", "hinge"),
        compliance=np.exp(x),
        lower=lower,
        upper=upper,
        width=upper / lower,
        learned=np.array([0.99, 0.6]),
        profile=np.full((2, len(JOINTS)), np.nan),
        refused=refused,
        chi2=float(np.mean(residual**2)),
        result="solved",
        warnings=(),
        periods=FitPeriods(
            period_names=("session",),
            joint_names=JOINTS,
            compliance=np.exp(x)[None],
            lower=lower[None],
            upper=upper[None],
            refused=np.array([[bool(reason) for reason in refused]]),
            factor=np.ones((1, len(JOINTS))),
            factor_lower=np.ones((1, len(JOINTS))),
            factor_upper=np.ones((1, len(JOINTS))),
            learned=np.array([[0.99, 0.6]]),
        ),
        parameters=FittedParameters(
            parameter_names=("compliance wrist", "compliance MP", "sensor delay"),
            units=("rad/Nm", "rad/Nm", "s"),
            scales=("log", "log", "linear"),
            value=np.array([*np.exp(x), 1e-4]),
            lower=np.array([*lower, -8e-4]),
            upper=np.array([*upper, 1e-3]),
            sd=np.array([*sd, 4.6e-4]),
            nominal=np.array([0.5, 0.5, 0.0]),
            prior_sd=np.array([1.0, 1.0, 5e-4]),
            learned=np.array([0.99, 0.6, 0.15]),
        ),
        windows=windows,
        variability=np.radians([[0.05, 0.06], [0.3, 0.4]]),
        noise=np.array([0.8, 0.9]),
        inflation=1.2,
        planned_movement=np.full((4, len(JOINTS)), np.nan),
        planned_inflation=1.0,
        paper=JointCompliance(
            joint_names=JOINTS,
            compliance=np.array([0.18, np.nan]),
            lower=np.array([0.1, 0.0]),
            upper=np.array([0.26, 2.0]),
            accepted=np.array([4, 1]),
            negative=np.array([0, 2]),
            events=np.array([4, 4]),
        ),
        options=json.dumps({"after": 0.1, "widest": 4.0}),
        provenance=json.dumps({"recording": {"simulated": True}}),
    )


def _windows() -> FitWindows:
    """The last one is shorter than the others."""
    rng = np.random.default_rng(3)
    count, shape = 40, (4, 40, 2)
    s = -0.2 + 0.008 * np.arange(count)
    push = np.clip(s, 0.0, None)[None, :, None] * np.array([1.0, 0.4])
    deviation = -push * np.array([1.0, 0.7, 0.5, 0.2])[:, None, None]
    onset = np.array([0.6, 1.5, 0.7, 1.6])
    repetition = 0.3 * np.sin(5.0 * (onset[:, None] + s))[:, :, None] * np.ones(2)
    drift = np.broadcast_to(rng.normal(size=(4, 1, 2)) * 5e-3, shape)
    angle = repetition + drift + deviation + 1e-3 * rng.normal(size=shape)
    rows = {
        "time": onset[:, None] + s,
        "angle": angle,
        "repetition": repetition,
        "deviation": deviation,
        "drift": drift,
        "drift_sd": np.broadcast_to(np.clip(s + 0.02, 0.0, None)[None, :, None] * 0.05, shape),
        "reference": angle - deviation,
        "reference_sd": np.full(shape, 1.5e-3),
        "torque": -4.0 * deviation,
        "residual": rng.normal(size=shape),
    }
    rows = {key: np.array(value) for key, value in rows.items()}
    for value in rows.values():
        value[3, 35:] = np.nan
    return FitWindows(
        trial=("trial00", "trial00", "trial01", "trial01"),
        joint_names=JOINTS,
        event=np.array([0, 1, 0, 1]),
        onset=onset,
        repetitions=np.array([2, 2, 2, 2]),
        correlation=np.array([[0.5, 0.6]] * 4),
        **rows,
    )
