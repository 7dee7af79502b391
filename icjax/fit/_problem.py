"""Parameters and the measurements that depend on them, as one vector of residuals."""

from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.fit._parameters import Parameters, Values
from icjax.inference import Laplace, jacobian, laplace
from icjax.typing import Float, Real


@runtime_checkable
class Measurement(Protocol):
    """Anything that compares a model with what was measured.

    `residual(values)` returns measured minus predicted in units of standard deviations, uncorrelated: whitened with
    everything that is known of the noise, so that half the sum of squares is a negative logarithm of the likelihood.
    A sample that does not count is exactly zero. `uses` names the parameters that it looks at. It is derived and
    compiled: written with jax.numpy, its arrays fields of an `equinox.Module`.
    """

    name: str
    uses: tuple[str, ...]

    def residual(self, values: Values) -> Any:
        """Whitened residuals at the values of the parameters, `[row]`."""
        ...


def _several(measurements: Any) -> tuple[Any, ...]:
    if not isinstance(measurements, tuple | list):
        raise ValueError(f"problem: measurements is a {type(measurements).__name__}; must be several, (measurement,)")
    return tuple(measurements)


class Problem(eqx.Module):
    """Minimise half the sum of squares of all residuals: the negative logarithm of the posterior.

    **Fields**: `parameters`; `measurements`, static, dynamic or of contact forces, of any number of trials and
    sessions, all seeing the same parameters.

    **Errors**: `ValueError` for a measurement that uses a parameter that does not exist, or none at all; later, for
    residuals that are no vector.
    """

    parameters: Parameters
    measurements: tuple[Any, ...] = eqx.field(converter=_several)

    def __check_init__(self):
        known = {item.name for item in self.parameters.of}
        if not self.measurements:
            raise ValueError("problem: no measurement")
        for item in self.measurements:
            if not isinstance(item, Measurement) or isinstance(item.uses, str):
                raise ValueError(
                    f"problem: a measurement is a {type(item).__name__}; it must have `name`, `uses` (names of "
                    "parameters, a tuple) and `residual`"
                )
            missing = [name for name in item.uses if name not in known]
            if missing:
                raise ValueError(
                    f"measurement {item.name!r} needs the parameter {missing[0]!r}; "
                    f"there are {', '.join(sorted(known))}"
                )

        for item in self.parameters.of:
            if item.name.split(" of ", 1)[0] == "compliance" and item.shared_sd is not None:
                for measurement in self.measurements:
                    if item.name in measurement.uses and getattr(measurement, "period", None) is None:
                        raise ValueError(
                            f"measurement {measurement.name!r} has no `period`: it cannot tell which row of "
                            f"{item.name!r} is its own; give every trial a parameter, 'compliance of ...'"
                        )

    def data(self, x: Float[Real, " n"]) -> Float[Real, " row"]:
        """Residuals of the measurements."""
        values = self.parameters.values(x)
        rows = [jnp.asarray(item.residual(values)) for item in self.measurements]
        for item, found in zip(self.measurements, rows, strict=True):
            if found.ndim != 1:
                raise ValueError(f"measurement {item.name!r}: its residual has the shape {found.shape}, must be [row]")
        return jnp.concatenate(rows)

    def residual(self, x: Float[Real, " n"]) -> Float[Real, " row"]:
        """Residuals of the measurements, then of the priors."""
        return jnp.concatenate([self.data(x), self.parameters.prior(x)])

    def laplace(self, x: Float[Real, " n"]) -> Laplace:
        """What is known of x at a minimum (`solve`), from the exact Jacobian: standard deviations, correlations, and
        what nothing determines. Numbers count in units of their priors where they have one.

        **Errors**: `ValueError` for an x of another length or with a number that is not finite."""
        if np.shape(x) != (self.parameters.size,) or not np.isfinite(np.asarray(x)).all():
            raise ValueError(f"x has the shape {np.shape(x)}; must be {self.parameters.size} numbers, all finite")
        data, prior = _jacobians(self, jnp.asarray(x))
        return intervals(np.asarray(data), np.asarray(prior))

    def cost(self, x: Float[Real, " n"]) -> Float[Real, ""]:
        """Half the sum of squares."""
        return 0.5 * jnp.sum(self.residual(x) ** 2)


@eqx.filter_jit
def _jacobians(problem: Problem, x):
    return jacobian(problem.data, x), jacobian(problem.parameters.prior, x)


def intervals(data: np.ndarray, prior: np.ndarray) -> Laplace:
    """`laplace` in units of the priors: a delay in seconds beside logarithms is no blind direction."""
    units = np.linalg.norm(prior, axis=0)
    return laplace(data, prior, scale=np.divide(1.0, units, out=np.ones_like(units), where=units > 0))
