# pyright: reportGeneralTypeIssues=false
# (the checker does not see that `labelled`, `names` and `static` declare fields without a default)
"""What a fit of a session found, as a file that outlives it."""

import json
import os

import equinox as eqx
import numpy as np

from icjax.files import labelled, load_record, names, save_record, static
from icjax.interaction import JointCompliance
from icjax.typing import Bool, Float, Int, Real


class FitWindows(eqx.Module):
    """Every contact that was fitted, at the compared samples; NaN past the end of a window that has fewer.

    `reference` = `angle` - `deviation`: the movement that would have gone on (`contact_free`). `residual` is
    `angle` - `repetition` - `deviation`, whitened in the order of time: each sample given those before (and without
    repetitions what the contacts have in common). `angle` -
    `repetition` - `drift` is the deviation as measured, to be held against `deviation` within `drift_sd`.
    """

    trial: tuple[str, ...] = names("window")
    joint_names: tuple[str, ...] = names("joint")
    event: Int[Real, " window"] = labelled("window", unit="1", doc="number of the contact among its trial's")
    onset: Float[Real, " window"] = labelled("window", unit="s", doc="first touch, clock of the trial")
    repetitions: Int[Real, " window"] = labelled("window", unit="1", doc="catch trials laid over it")
    time: Float[Real, "window sample"] = labelled("window", "sample", unit="s", doc="clock of the trial")
    angle: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="as measured"
    )
    repetition: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="mean of the catch trials; without, the first angle"
    )
    deviation: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="from the contact-free movement, as predicted by the fit"
    )
    drift: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="of the trial from its repetitions, by what it was before"
    )
    drift_sd: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="what that leaves open; zero before contact"
    )
    reference: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="contact-free movement of the trial"
    )
    reference_sd: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="rad or m", doc="of the fit's numbers and the angles' noise; may be infinite"
    )
    torque: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="Nm", doc="of the contact force, filtered as the angles are"
    )
    residual: Float[Real, "window sample joint"] = labelled(
        "window", "sample", "joint", unit="1", doc="whitened, of unit variance if all that is assumed holds"
    )
    correlation: Float[Real, "window joint"] = labelled(
        "window", "joint", unit="1", doc="of log compliance with the mean of the reference"
    )


class FitPeriods(eqx.Module):
    """Compliance in every period in which it may be another (`FitOptions.compliance_by`): session, trials, contacts.

    `refused` says where the interval is too wide for a number to count.
    """

    period_names: tuple[str, ...] = names("period")
    joint_names: tuple[str, ...] = names("joint")
    compliance: Float[Real, "period joint"] = labelled("period", "joint", unit="rad/Nm", doc="m/N of a slide")
    lower: Float[Real, "period joint"] = labelled("period", "joint", unit="rad/Nm", doc="of the 95 % interval")
    upper: Float[Real, "period joint"] = labelled("period", "joint", unit="rad/Nm")
    refused: Bool[Real, "period joint"] = labelled(
        "period", "joint", unit="1", doc="the interval is too wide, or the period says nothing of its own"
    )
    factor: Float[Real, "period joint"] = labelled("period", "joint", unit="1", doc="over that of the first period")
    factor_lower: Float[Real, "period joint"] = labelled("period", "joint", unit="1", doc="of its 95 % interval")
    factor_upper: Float[Real, "period joint"] = labelled("period", "joint", unit="1", doc="of its 95 % interval")
    learned: Float[Real, "period joint"] = labelled(
        "period", "joint", unit="1", doc="share of what was open about its deviation from the others that was removed"
    )


class FittedParameters(eqx.Module):
    """Every number that the fit moved, or held: value, 95 % interval and standard deviation.

    `scales` says of what `sd` is the standard deviation: "log" of the value's logarithm, "linear" of the value
    itself, "x" of the number behind the value (its transform's). A number that was held has the deviation zero.
    """

    parameter_names: tuple[str, ...] = names("parameter")
    units: tuple[str, ...] = static()
    scales: tuple[str, ...] = static()
    value: Float[Real, " parameter"] = labelled("parameter", unit="as in units")
    lower: Float[Real, " parameter"] = labelled("parameter", unit="as in units")
    upper: Float[Real, " parameter"] = labelled("parameter", unit="as in units")
    sd: Float[Real, " parameter"] = labelled("parameter", unit="1", doc="in the scale named in `scales`")
    nominal: Float[Real, " parameter"] = labelled("parameter", unit="as in units", doc="centre of the prior")
    prior_sd: Float[Real, " parameter"] = labelled(
        "parameter", unit="1", doc="in the scale named in `scales`; infinite without a prior"
    )
    learned: Float[Real, " parameter"] = labelled(
        "parameter", unit="1", doc="share of the prior variance that the data removed"
    )

    def prior_distance(self) -> Float[np.ndarray, " parameter"]:
        """How many standard deviations of its prior each value is from the centre; NaN without a prior."""
        log = np.array([scale == "log" for scale in self.scales])
        value, nominal = np.asarray(self.value), np.asarray(self.nominal)
        with np.errstate(divide="ignore", invalid="ignore"):
            apart = np.where(log, np.log(np.abs(value)) - np.log(np.abs(nominal)), value - nominal)
            distance = np.abs(apart) / np.asarray(self.prior_sd)
        stated = np.isfinite(np.asarray(self.prior_sd)) & np.array([scale != "x" for scale in self.scales])
        return np.where(stated & (np.asarray(self.prior_sd) > 0), distance, np.nan)


class FitRecord(eqx.Module):
    """Fitted compliance of every joint with what it rests on, beside the paper's estimate of the same session.

    `refused` holds a reason for each joint, empty where there is none: of a refused joint only the bounds count.
    """

    name: str = static()
    subject: str = static()
    trials: tuple[str, ...] = static()
    catch_trials: int = static()
    joint_names: tuple[str, ...] = names("joint")
    joint_kinds: tuple[str, ...] = static()  # hinge or slide
    compliance: Float[Real, " joint"] = labelled("joint", unit="rad/Nm", doc="m/N of a slide")
    lower: Float[Real, " joint"] = labelled("joint", unit="rad/Nm")
    upper: Float[Real, " joint"] = labelled("joint", unit="rad/Nm")
    width: Float[Real, " joint"] = labelled("joint", unit="1", doc="upper over lower")
    learned: Float[Real, " joint"] = labelled("joint", unit="1", doc="share of the prior variance the data removed")
    profile: Float[Real, "end joint"] = labelled(
        "end", "joint", unit="rad/Nm", doc="ends of the interval by profile likelihood; NaN where it was not asked for"
    )
    refused: tuple[str, ...] = static()
    chi2: float = static()  # mean square of the whitened residuals
    result: str = static()  # of the solver, a name of RESULTS
    warnings: tuple[str, ...] = static()
    periods: FitPeriods
    parameters: FittedParameters
    windows: FitWindows
    variability: Float[Real, "process joint"] = labelled(
        "process", "joint", unit="rad or m", doc="of a repetition about the intended movement: fast, slow"
    )
    noise: Float[Real, " joint"] = labelled(
        "joint", unit="1", doc="factor of the instruments' standard deviation, learnt from repetitions"
    )
    inflation: float = static()  # of that variance and the noise
    planned_movement: Float[Real, "quantity joint"] = labelled(
        "quantity", "joint", unit="s, s, rad, 1", doc="of trials without catch trials: reach, length, tremor, noise"
    )
    planned_inflation: float = static()  # of that variance and the noise
    paper: JointCompliance
    options: str = static()  # JSON text
    provenance: str = static()  # JSON text

    @property
    def title(self) -> str:
        """The session's name, and what tells this fit from others of it."""
        try:
            by = json.loads(self.options).get("compliance_by", "session")
        except (ValueError, AttributeError):
            by = "session"
        changing = f", compliance by {by}" if by != "session" else ""
        return self.name + changing + ("" if self.catch_trials else ", no catch trials")

    @property
    def units(self) -> dict[str, str]:
        """Unit of each joint's compliance."""
        return {
            name: "m/N" if kind == "slide" else "rad/Nm"
            for name, kind in zip(self.joint_names, self.joint_kinds, strict=True)
        }

    def save(self, path: str | os.PathLike) -> None:
        """Write one labelled netCDF file, complete or not at all."""
        save_record(path, self)

    @staticmethod
    def load(path: str | os.PathLike) -> "FitRecord":
        """Read a fit back, equal to what was saved. **Errors**: `FileError` naming the file."""
        return load_record(path, FitRecord)
