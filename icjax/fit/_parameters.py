"""What a fit may change: values with units, priors and bounds, as one vector of unconstrained numbers."""

import math
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from icjax.inference import Identity, Transform
from icjax.typing import Float, Real

Values = dict[str, Any]
"""Value of every parameter by its name; what a measurement model is given."""


class Parameter(eqx.Module):
    """One quantity that a measurement depends on.

    The fit moves x with value = transform(x). A prior is normal in x: with `Log`, `prior_sd` is a relative standard
    deviation. `shared_sd` makes it hierarchical: x = x0 + u + z, u of that standard deviation the same along the
    value's first axis (of a person, of all trials), z of `prior_sd` each one's own; u is integrated out. `smooth` is a
    normal prior on the differences of neighbouring values along the first axis, in x: what makes C(t) piecewise
    constant or a spline instead of arbitrary.

    **Fields**

    - `name`: by which measurement models know it. `unit`: for people.
    - `nominal`: value where the fit starts and where the prior is centred, of any shape.
    - `transform`: how x becomes the value (`icjax.inference`: `Log()`, ...); default the value itself.
    - `prior_sd`: of x, one number or one for each of x; None says nothing beforehand.
    - `shared_sd`: of what x has in common along the value's first axis beyond `prior_sd`; None: nothing.
    - `smooth`: standard deviation of (order `smooth_order`) differences of x along the value's first axis; None.
    - `frozen`: the value stays nominal.
    - `labels`: names of the entries of x, for messages.
    """

    name: str = eqx.field(static=True)
    nominal: Float[Real, "..."]
    unit: str = eqx.field(static=True, default="1")
    transform: Transform = Identity()
    prior_sd: Float[Real, "..."] | float | None = None
    shared_sd: float | None = None
    smooth: float | None = None
    smooth_order: int = eqx.field(static=True, default=1)
    frozen: bool = eqx.field(static=True, default=False)
    labels: tuple[str, ...] = eqx.field(static=True, default=())

    def __check_init__(self):
        """**Errors**: `ValueError` naming the parameter, for a value that is not finite or outside its range."""
        if not isinstance(self.unit, str):
            raise ValueError(f"parameter {self.name!r}: unit = {self.unit!r}: must be text; the transform comes after")
        if not isinstance(self.transform, Transform):
            raise ValueError(
                f"parameter {self.name!r}: transform = {self.transform!r}: must be one of icjax.inference, such as "
                "Log()"
            )
        known = _known(self.nominal)
        if known is not None and not np.isfinite(known).all():
            raise ValueError(f"parameter {self.name!r}: its nominal value {known} is not finite")
        sd = None if self.prior_sd is None else _known(self.prior_sd)
        if sd is not None and not (np.isfinite(sd).all() and np.all(sd > 0)):
            raise ValueError(f"parameter {self.name!r}: prior_sd {sd} must be above zero and finite")
        if self.shared_sd is not None and not (math.isfinite(self.shared_sd) and self.shared_sd > 0):
            raise ValueError(f"parameter {self.name!r}: shared_sd {self.shared_sd} must be above zero and finite")
        if self.shared_sd is not None and (self.prior_sd is None or np.ndim(self.nominal) == 0):
            raise ValueError(f"parameter {self.name!r}: shared_sd needs a value with an axis, and prior_sd of its own")
        if self.smooth is not None and not (math.isfinite(self.smooth) and self.smooth > 0):
            raise ValueError(f"parameter {self.name!r}: smooth {self.smooth} must be above zero")
        if self.smooth is not None and not 1 <= self.smooth_order < max(np.shape(self.nominal)[:1], default=0):
            raise ValueError(
                f"parameter {self.name!r}: smooth needs a first axis longer than smooth_order = {self.smooth_order}, "
                f"which must be at least 1; its value has the shape {np.shape(self.nominal)}"
            )
        try:
            count = int(np.size(self.transform.free(self.nominal)))
        except ValueError as error:
            raise ValueError(f"parameter {self.name!r}: {error}") from error
        if self.labels and len(self.labels) != count:
            raise ValueError(f"parameter {self.name!r}: {len(self.labels)} labels for {count} numbers")
        if sd is not None and sd.size not in (1, count):
            raise ValueError(f"parameter {self.name!r}: prior_sd has {sd.size} entries for {count} numbers")

    @property
    def size(self) -> int:
        """How many numbers of x it has."""
        return self.transform.size(self.nominal)

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every number of x."""
        if self.labels:
            return tuple(f"{self.name} {label}" for label in self.labels)
        return (self.name,) if self.size == 1 else tuple(f"{self.name}[{i}]" for i in range(self.size))

    def value(self, x: Float[Real, " size"]) -> Any:
        """The value at x, of the nominal value's shape unless the transform makes a matrix."""
        value = self.transform.value(x)
        shape = np.shape(self.nominal)
        return jnp.reshape(value, shape) if np.size(value) == math.prod(shape) else value

    def _less_shared(self, rows: Float[Real, " size"], shared: float) -> Float[Real, " size"]:
        """Whitened rows of covariance I + a a^T, a = shared_sd / prior_sd along the first axis: with b = a / |a| they
        are (I - D b b^T) r, D = 1 - (1 + |a|^2)^(-1/2)."""
        along = jnp.reshape(rows, (np.shape(self.nominal)[0], -1))
        a = jnp.broadcast_to(shared / jnp.asarray(self.prior_sd), rows.shape).reshape(along.shape)
        square = jnp.sum(a**2, axis=0)
        share = (1.0 - 1.0 / jnp.sqrt(1.0 + square)) / square * jnp.sum(a * along, axis=0)
        return jnp.ravel(along - a * share[None])

    def prior(self, x: Float[Real, " size"]) -> Float[Real, " row"]:
        """Residuals of the prior, each of unit standard deviation; none without a prior."""
        rows = []
        if self.prior_sd is not None:
            apart = (x - self.transform.free(self.nominal)) / jnp.asarray(self.prior_sd)
            rows.append(apart if self.shared_sd is None else self._less_shared(apart, self.shared_sd))
        if self.smooth is not None:
            along = jnp.reshape(x, (np.shape(self.nominal)[0], -1))
            rows.append(jnp.ravel(jnp.diff(along, n=self.smooth_order, axis=0)) / self.smooth)
        return jnp.concatenate(rows) if rows else jnp.zeros(0, jnp.asarray(x).dtype)


class Parameters(eqx.Module):
    """Several parameters as one vector x of those that are not frozen, in their order.

    **Errors**: `ValueError` for two of one name.
    """

    of: tuple[Parameter, ...]

    def __check_init__(self):
        if isinstance(self.of, Parameter):
            raise ValueError(f"parameters: must be several, (parameter,); got the one {self.of.name!r}")
        names = [item.name for item in self.of]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"parameters: two are named {name!r}")

    @property
    def free(self) -> tuple[Parameter, ...]:
        """Those that the fit moves."""
        return tuple(item for item in self.of if not item.frozen)

    @property
    def size(self) -> int:
        """Length of x."""
        return sum(item.size for item in self.free)

    @property
    def names(self) -> tuple[str, ...]:
        """A name for every entry of x."""
        return tuple(name for item in self.free for name in item.names)

    @property
    def slices(self) -> dict[str, slice]:
        """Where each free parameter stands in x."""
        ends = np.cumsum([0, *(item.size for item in self.free)]).tolist()
        return {item.name: slice(a, b) for item, a, b in zip(self.free, ends, ends[1:], strict=False)}

    @property
    def start(self) -> Float[Real, " size"]:
        """x of the nominal values."""
        parts = [item.transform.free(item.nominal) for item in self.free]
        return jnp.concatenate(parts) if parts else jnp.zeros(0)

    def values(self, x: Float[Real, " size"]) -> Values:
        """Every parameter's value, frozen ones too."""
        places = self.slices
        return {
            item.name: jnp.asarray(item.nominal) if item.frozen else item.value(x[places[item.name]])
            for item in self.of
        }

    def prior(self, x: Float[Real, " size"]) -> Float[Real, " row"]:
        """Residuals of all priors."""
        places = self.slices
        return jnp.concatenate([jnp.zeros(0), *(item.prior(x[places[item.name]]) for item in self.free)])

    def __getitem__(self, name: str) -> Parameter:
        """**Errors**: `KeyError` naming those that there are."""
        for item in self.of:
            if item.name == name:
                return item
        raise KeyError(f"no parameter {name!r}; there are {', '.join(item.name for item in self.of)}")

    def change(self, name: str, **fields: Any) -> "Parameters":
        """The same with fields of one parameter changed: `change("friction", frozen=True)`."""
        old = self[name]
        stated = {key: getattr(old, key) for key in old.__dataclass_fields__} | fields
        return Parameters(tuple(Parameter(**stated) if item is old else item for item in self.of))


def _known(value: Any) -> np.ndarray | None:
    """As NumPy, None for a tracer."""
    try:
        return np.asarray(value, float)
    except Exception:  # a tracer of any transformation
        return None
