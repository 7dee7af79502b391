"""Every number that a fit moved or held, with its interval."""

from collections.abc import Sequence

import numpy as np

from icjax.fit._joints import JointFit
from icjax.fit._parameters import Parameter, Parameters
from icjax.fit._record import FittedParameters
from icjax.inference import QUANTILE, Identity, Laplace, Log
from icjax.typing import Float


def fitted_parameters(
    parameters: Parameters, x: Float[np.ndarray, " n"], known: Laplace, periods: Sequence[Sequence[JointFit]]
) -> FittedParameters:
    """One row a number of x, in its order, then those that were held; intervals of compliances are those of `periods`,
    the others 1.96 standard deviations of x long to both sides."""
    rows = []
    for item in (*parameters.free, *(item for item in parameters.of if item.frozen)):
        if item.frozen:
            centre = np.asarray(item.transform.free(item.nominal))
            sd, learned = np.zeros(len(centre)), np.zeros(len(centre))
        else:
            place = parameters.slices[item.name]
            centre = x[place]
            sd, learned = np.asarray(known.sd)[place], np.asarray(known.learned)[place]
        ends = [_value(item, centre + sign * QUANTILE * sd) for sign in (0.0, -1.0, 1.0)]
        if item.name == "compliance" and not item.frozen:  # ends as everywhere else
            ends[1:] = (np.array([getattr(j, end) for row in periods for j in row]) for end in ("lower", "upper"))
        own = np.inf if item.prior_sd is None else np.asarray(item.prior_sd, float)
        prior = np.broadcast_to(np.hypot(own, item.shared_sd or 0.0), centre.shape)
        nominal = _value(item, np.asarray(item.transform.free(item.nominal)))
        scale, unit = _scale(item)
        rows += zip(
            item.names, item.size * [unit], item.size * [scale], *ends, sd, nominal, prior, learned, strict=True
        )
    name, unit, scale, *numbers = zip(*rows, strict=True)
    return FittedParameters(tuple(name), tuple(unit), tuple(scale), *(np.array(column, float) for column in numbers))


def _scale(item: Parameter) -> tuple[str, str]:
    kind = type(item.transform)
    if kind in (Log, Identity):
        return ("log" if kind is Log else "linear"), item.unit
    return "x", item.unit if _one_to_one(item) else f"x of {item.unit}"


def _one_to_one(item: Parameter) -> bool:
    """Whether every number of x has a value of its own."""
    return int(np.size(item.nominal)) == item.size


def _value(item: Parameter, x: np.ndarray) -> np.ndarray:
    with np.errstate(over="ignore"):
        return np.ravel(np.asarray(item.value(x))) if _one_to_one(item) else x
