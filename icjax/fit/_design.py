"""Experiment design: how wide every joint's interval would be, before anyone is recorded."""

import dataclasses
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import numpy as np

from icjax.estimation import compliant_dofs
from icjax.fit._expected_contact import angle_errors, movement, touch_of
from icjax.fit._inertia import linear_inertia, segment_groups
from icjax.fit._options import FitOptions
from icjax.fit._parameters import Parameter, Parameters
from icjax.fit._planned import BLOCK, Plan, jacobians
from icjax.fit._planned_movement import PlannedMovement, typical_movement
from icjax.fit._probe import Instruments, Probe, check_probe
from icjax.fit._session import LEAST_EVENTS, _parameters
from icjax.fit._variability import TYPICAL, Variability
from icjax.fit._windows import POINT_SD, _coordinates
from icjax.inference import QUANTILE, Identity, jacobian, laplace
from icjax.model import Model, neutral
from icjax.running import on_full_blocks
from icjax.typing import Bool, Float

MOST_TIMES = 1000
"""Beyond so many times the contacts, more of them are no cure."""


class Expectation(NamedTuple):
    """Of every joint the ratio of the ends of its expected 95 % interval, in which the joint's own prior has no part,
    the standard deviation of log C, in which it has, the share of the prior variance that the data would remove, and
    whether `fit_session` would refuse it."""

    width: Float[np.ndarray, " joint"]
    sd: Float[np.ndarray, " joint"]
    learned: Float[np.ndarray, " joint"]
    refused: Bool[np.ndarray, " joint"]


@dataclasses.dataclass(frozen=True)
class Design:
    """What each probe would tell; information of independent contacts adds, so combinations cost nothing.

    - `probes`, `joints`: their names; `widths` [probe, joint] and `refused`: each probe alone.
    - `torque` Nm (filtered as recorded) and `deflection` rad [probe, joint]: largest of one contact in the window that
      is compared;
      `doubt` rad [probe, joint]: standard deviation of the angle against its repetitions (without catch trials, of the
      angle) at the end of that window, given the time before contact.
    - `factor` [probe, number, number]: R of one contact, R^T R its information on x of `parameters`; `prior`
      the Jacobian of the priors. Without catch trials "common" is one of the parameters: what all contacts of a plan
      share (`Common`).
    """

    probes: tuple[Probe, ...]
    joints: tuple[str, ...]
    options: FitOptions
    catch_trials: int
    parameters: Parameters
    factor: Float[np.ndarray, "probe number number"]
    prior: Float[np.ndarray, "row number"]
    torque: Float[np.ndarray, "probe joint"]
    deflection: Float[np.ndarray, "probe joint"]
    doubt: Float[np.ndarray, "probe joint"]

    def expected(self, chosen: Sequence[int], contacts: float | int | None = None) -> Expectation:
        """Of probes together, by their numbers; a number that stands twice counts twice.

        **Arguments**: `contacts` in all, shared evenly; default each probe's own.

        **Errors**: `ValueError` for no probe or a number that is none's, and for `contacts` that are not above zero.
        """
        if not len(chosen) or any(not 0 <= item < len(self.probes) for item in chosen):
            raise ValueError(f"chosen = {list(chosen)}: must be numbers of probes, 0 to {len(self.probes) - 1}")
        if contacts is not None and not (contacts > 0 and np.isfinite(contacts)):
            raise ValueError(f"contacts = {contacts}: must be above zero and finite")
        times = [self.probes[item].contacts if contacts is None else contacts / len(chosen) for item in chosen]
        data = np.concatenate([np.sqrt(n) * self.factor[item] for item, n in zip(chosen, times, strict=True)])
        known = laplace(data, self.prior, scale=1.0 / np.linalg.norm(self.prior, axis=0))
        at = self.parameters.slices["compliance"]
        sd = np.asarray(known.sd)[at]
        learned = np.asarray(known.learned)[at]
        with np.errstate(divide="ignore", over="ignore"):  # nothing learnt, no interval
            width = np.exp(2.0 * QUANTILE * sd / np.sqrt(learned))
        return Expectation(width, sd, learned, ~(width <= self.options.widest) | (sum(times) < LEAST_EVENTS))

    @property
    def widths(self) -> Float[np.ndarray, "probe joint"]:
        """Of each probe alone, with its own number of contacts."""
        return np.stack([self.expected([item]).width for item in range(len(self.probes))])

    @property
    def refused(self) -> Bool[np.ndarray, "probe joint"]:
        """Of each probe alone."""
        return np.stack([self.expected([item]).refused for item in range(len(self.probes))])

    def ranking(self) -> tuple[int, ...]:
        """Probes by the largest width of any joint, best first, equal ones by the product of all widths."""
        return tuple(sorted(range(len(self.probes)), key=lambda item: _badness(self.expected([item]).width)))

    def best_set(self, k: int, contacts: float | int | None = None) -> tuple[int, ...]:
        """k probes with which the largest width of any joint is small: the next always the one with which it is least
        (greedy), then one exchanged for another while that makes it less. No search of all sets: the best may be
        missed.

        **Arguments**: `contacts` in all, shared evenly among those chosen so far; default each probe's own.

        **Errors**: `ValueError` for a k that is not between one and the number of probes.
        """
        if not 1 <= k <= len(self.probes):
            raise ValueError(f"k = {k}: must be 1 to {len(self.probes)}, the number of probes")

        def badness(chosen: tuple[int, ...]) -> tuple[float, float]:
            return _badness(self.expected(sorted(chosen), contacts).width)

        chosen: tuple[int, ...] = ()
        while len(chosen) < k:
            chosen = min(((*chosen, item) for item in range(len(self.probes)) if item not in chosen), key=badness)
        while k < len(self.probes):
            rest = [item for item in range(len(self.probes)) if item not in chosen]
            swapped = [(*chosen[:at], item, *chosen[at + 1 :]) for at in range(k) for item in rest]
            better = min(swapped, key=badness)
            if badness(better) >= badness(chosen):
                break
            chosen = better
        return chosen

    def contacts_needed(self, chosen: Sequence[int]) -> Float[np.ndarray, " joint"]:
        """Contacts in all, shared evenly, until each joint has a number: at least the three that `fit_session`
        asks for, infinite above `MOST_TIMES` contacts each."""
        needed = np.full(len(self.joints), np.inf)
        for count in np.unique(np.round(np.geomspace(1, MOST_TIMES, 120))):
            told = self.expected(chosen, count * len(chosen)).width <= self.options.widest
            needed = np.where(told & np.isinf(needed), count * len(chosen), needed)
        return np.maximum(needed, LEAST_EVENTS)


def design(
    model: Model,
    probes: Sequence[Probe],
    catch_trials: int = 2,
    options: FitOptions | None = None,
    noise: Instruments | None = None,
    variability: Variability | None = None,
    planned_movement: PlannedMovement | None = None,
) -> Design:
    """Expected 95 % intervals of the compliance of every compliant joint from contacts that might be recorded.

    Each probe's contact is simulated with the nominal compliance C (the model's where it states one, else
    `options.typical_compliance`), damping time and masses: the finger moves against a rigid plane, its pad in series
    with the joints (`contact_force`). The torque of that contact, filtered as a recording's is, goes into the residual
    of `DynamicEquilibrium`; its exact Jacobian, whitened by the covariance of a contact against the mean of n
    repetitions, (1 + 1/n) times `covariance` plus what a shift in time of each repetition does, and the priors of
    `fit_session` give the standard deviations of log C (`laplace`). Unknown with C are damping times, masses, offsets
    of all coordinates, the place of the force, gain and delay of its sensor.

    Without catch trials the covariance is that of a movement foretold from before contact
    (`PlannedMovement.covariance`) at the pace of the intended one, and unknown besides are its `modes`, the same
    numbers for all contacts (`Common`; `alike`, torque against its root mean square over all probes given): they do
    not average out, however many contacts there are.

    Assumed: posture, Jacobian and inertia stay those of the first touch; contacts are independent, their number alone
    makes intervals narrower (without catch trials, independent but for the modes); how much repetitions vary is known
    (`fit_session` learns it from few and counts what it does not know); the force itself is measured without
    noise, by one sensor for all probes; the plane is rigid, at rest, and touches nothing but the named point, whatever
    lies behind it; a root that yields stays at rest too; the window before contact is free of the contact before; there
    are no outliers and no dropouts. The nominal C matters: a stiffer joint deflects less, so its interval is wider. A
    session needs at least three contacts.

    **Arguments**: `catch_trials` of every trial, zero or more; `noise` of the instruments; `variability` of
    repetitions, used where there are catch trials, and `planned_movement`, used where there are none: of a pilot
    session (`session_problem(...).expected.variability` and `.movement`) or typical.

    **Errors**: `ValueError` for no probe, two of one name, a model without compliant joint, `variability` or
    `planned_movement` of another number of joints or a `planned_movement` that is not finite, and those of `Probe`, of
    coordinates beyond the model's range, and of a contact that the model does not have.

    **Source**: the information matrix of a planned experiment: Fedorov 1972, Theory of optimal experiments.
    """
    options, noise = options or FitOptions(), noise or Instruments()
    probes = tuple(probes)
    dofs = tuple(compliant_dofs(model))
    _check(model, probes, catch_trials, dofs)
    if variability is None:
        variability = Variability(np.tile(np.asarray(TYPICAL)[:, None], (1, len(dofs))), np.ones(len(dofs)), 1.0)
    if planned_movement is None:
        planned_movement = typical_movement(len(dofs))
    _check_movement(variability, planned_movement, len(dofs))
    foretold = planned_movement if catch_trials == 0 else None
    modes = None if foretold is None else foretold.modes(options.before, options.after)
    groups, segments = segment_groups(model, dofs)
    offset_names = (*model.dof_names, *(f"contact {axis}" for axis in "xyz"))
    parameters = _parameters(model, dofs, segments, offset_names, options)
    C = np.asarray(parameters["compliance"].nominal)
    touches = [touch_of(model, dofs, probe) for probe in probes]
    moves = [movement(probe, touch, C) for probe, touch in zip(probes, touches, strict=True)]
    at_rest = np.zeros((len(probes), model.nv))
    speed = at_rest.copy()
    speed[:, list(dofs)] = [probe.speed * move for probe, move in zip(probes, moves, strict=True)]
    rows = np.array([probe.q for probe in probes]), speed, at_rest
    inertia = on_full_blocks(partial(linear_inertia, model, groups, dofs), *rows, block=BLOCK)
    plan = Plan(model, dofs, options, noise, variability, catch_trials, foretold, modes)
    events = [
        plan.event(probe, touch, move, tuple(np.asarray(part)[item] for part in inertia), C)
        for item, (probe, touch, move) in enumerate(zip(probes, touches, moves, strict=True))
    ]
    offset = np.zeros((len(offset_names),) * 2)
    offset[: model.nv, : model.nv] = angle_errors(model, np.asarray(neutral(model)), noise)[1]
    offset[model.nv :, model.nv :] = POINT_SD**2 * np.eye(3)
    common = plan.common_of(events, probes, moves)
    J = jacobians(model, dofs, noise.rate, offset, events, parameters)
    if modes is not None:
        alike = np.stack([event["W"] @ own for event, own in zip(events, common, strict=True)])
        J = np.concatenate([J, alike], axis=2)
        shared = Parameter("common", np.zeros(alike.shape[2]), "prior sd", Identity(), 1.0)
        parameters = Parameters((*parameters.of, shared))
    factor = np.stack([np.linalg.qr(np.concatenate([item, np.zeros((item.shape[1],) * 2)]), mode="r") for item in J])
    told = [np.stack([np.asarray(event[key]) for event in events]) for key in ("peak", "deflection")]
    told.append(np.stack([plan.doubt(*each) for each in zip(events, probes, common, strict=True)]))
    names = tuple(model.dof_names[dof] for dof in dofs)
    prior = np.asarray(_prior_rows(parameters))
    return Design(probes, names, options, catch_trials, parameters, factor, prior, *told)


def _check(model: Model, probes: tuple[Probe, ...], catch_trials: int, dofs: tuple[int, ...]) -> None:
    if not dofs:
        raise ValueError(f"model {model.name!r} has no compliant joint")
    _coordinates(model, dofs)
    if not probes:
        raise ValueError("probes: none given")
    if isinstance(catch_trials, bool) or not isinstance(catch_trials, int) or catch_trials < 0:
        raise ValueError(f"catch_trials = {catch_trials}: must be a whole number of at least 0")
    names = [probe.name for probe in probes]
    for probe in probes:
        if names.count(probe.name) > 1:
            raise ValueError(f"probes: two are named {probe.name!r}")
        check_probe(model, probe)


def _check_movement(variability: Variability, planned: PlannedMovement, dofs: int) -> None:
    if np.shape(variability.amplitude) != (2, dofs) or np.shape(variability.noise) != (dofs,):
        raise ValueError(
            f"variability: amplitude is {list(np.shape(variability.amplitude))} and noise "
            f"{list(np.shape(variability.noise))}; the model has {dofs} compliant degrees of freedom, they must be "
            "[2, that many] and [that many]"
        )
    for name, value in variability._replace(doubt=None)._asdict().items():
        least = 0.0 if name == "amplitude" else 1e-9
        if value is not None and not (np.isfinite(value).all() and np.all(np.asarray(value) >= least)):
            raise ValueError(f"variability: {name} = {value}: must be finite and not negative")
    if not isinstance(planned, PlannedMovement):
        raise ValueError(
            f"planned_movement is a {type(planned).__name__}: must be a PlannedMovement, such as "
            "session_problem(pilot).expected.movement of a pilot without catch trials"
        )
    for name, value in planned._replace(doubt=None)._asdict().items():
        if value is None:
            continue
        wanted = () if name == "inflation" else (dofs,)
        if np.shape(value) != wanted:
            raise ValueError(
                f"planned_movement: {name} is {list(np.shape(value))}; the model has {dofs} compliant degrees of "
                f"freedom, it must be {list(wanted)}"
            )
        if not (np.isfinite(value).all() and np.all(np.asarray(value) > 0)):
            raise ValueError(f"planned_movement: {name} = {value}: must be above zero and finite")


@eqx.filter_jit
def _prior_rows(parameters: Parameters):
    return jacobian(parameters.prior, parameters.start)


def _badness(width: np.ndarray) -> tuple[float, float]:
    return float(np.max(width)), float(np.sum(np.log(width)))
