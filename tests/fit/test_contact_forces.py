"""Contact forces of a simulated tap and stroke against measured ones."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import ContactForces, Parameter, Parameters, Problem, solve, spline_basis
from icjax.geometry import Plane
from icjax.inference import Log
from icjax.lcp import Smoothed
from icjax.model import index_finger, pad_positions
from icjax.synthesis import Scene, Surface

STEPS = 8
TIME = np.linspace(0.0, 0.07, STEPS)
BASIS = spline_basis(TIME, 4)
FINGER = index_finger(root="fixed")
FINGER = dataclasses.replace(FINGER, lower=np.full(4, -np.inf), upper=np.full(4, np.inf))
POSTURE = np.array([0.1, 0.5, 0.5, 0.3])
BOTTOM = float(pad_positions(FINGER, jnp.asarray(POSTURE))[0, 2]) - float(FINGER.pad_radius[0])
PART = np.linspace(0.0, 1.0, STEPS)[:, None]
USES = ("compliance", "reference", "friction of plate", "pad stiffness")
COMPLIANCE = np.asarray(FINGER.compliance)


def scene(friction=0.5, height=BOTTOM - 0.001):
    plane = Plane(np.array([0.0, 0.0, height]), np.array([0.0, 0.0, 1.0]))
    return Scene("flat", (Surface("plate", plane, friction),))


def pressing(depth=0.15, bend=-0.2):
    """MP presses, PIP extends: a stroke."""
    return POSTURE + PART * np.array([0.0, depth, bend, 0.0])


def measured(nominal, force=None, angles=None, **fields):
    force = np.zeros((STEPS, 1, 3)) if force is None else force
    angles = nominal if angles is None else angles
    stated = {"uses": USES, "basis": BASIS, "angles": angles, "angle_sd": 0.1} | fields
    return ContactForces("tap", FINGER, stated.pop("scene", scene()), TIME, force, 1.0, nominal, **stated)


def parameters(friction=0.5, **change):
    return Parameters(
        (
            Parameter("compliance", change.get("compliance", COMPLIANCE), "rad/Nm", Log()),
            Parameter("reference", np.zeros((4, 4)), "rad"),
            Parameter("friction of plate", np.array(friction), transform=Log()),
            Parameter("pad stiffness", np.array(750.0), "N/m", Log()),
        )
    )


PROBLEM = Problem(parameters(), (measured(pressing()),))


def moved(x, nominal):
    problem = eqx.tree_at(lambda p: (p.measurements[0].nominal, p.measurements[0].angles), PROBLEM, (nominal, nominal))
    return problem.data(x)


RESIDUAL, DERIVATIVES = jax.jit(moved), jax.jit(lambda *x: (jax.jacfwd(moved)(*x), jax.jacrev(moved)(*x)))


@pytest.mark.slow
def test_derivatives():
    """Forward = reverse = central difference where it slides, sticks and does not touch; finite where derivatives are
    one-sided. One test, because compiling takes the time."""
    for case, friction, nominal in (
        ("slides", 0.2, pressing()),
        ("sticks", 2.0, pressing()),
        ("does not touch", 0.5, pressing(-0.1)),
    ):
        x = parameters(friction).start
        info = PROBLEM.measurements[0].simulate(parameters(friction).values(x) | {})
        if case != "does not touch":
            assert np.asarray(info.slip_state)[-1, 0] == {"slides": 2, "sticks": 1}[case]
        forward, reverse = DERIVATIVES(x, jnp.asarray(nominal))
        step = 1e-5
        central = [
            (RESIDUAL(x + step * e, jnp.asarray(nominal)) - RESIDUAL(x - step * e, jnp.asarray(nominal))) / (2 * step)
            for e in jnp.eye(x.size)
        ]
        size = float(jnp.max(jnp.abs(forward)))
        np.testing.assert_allclose(reverse, forward, atol=1e-10 * size, err_msg=case)
        np.testing.assert_allclose(jnp.stack(central, axis=1), forward, atol=1e-7 * size, err_msg=case)
    rest = np.tile(POSTURE, (STEPS, 1))
    touching = np.array([0.0, 0.001 / 0.13, 0.0, 0.0])  # about as deep as the plate
    for nominal in (rest, rest + touching, pressing(bend=0.0), np.zeros((STEPS, 4))):
        for found in DERIVATIVES(parameters().start, jnp.asarray(nominal)):
            assert np.isfinite(found).all()


@pytest.mark.slow
def test_compliance_and_friction_are_found():
    """From one start, of what was simulated; the reference and the pad are known."""
    nominal = pressing(0.2, -0.3)
    truth = measured(nominal, uses=(), basis=None, scene=scene(0.3))
    force, angles = truth.predict({})
    data = measured(
        nominal, force, angles, uses=("compliance", "friction"), basis=None, scene=scene(1.0), adjoint=Smoothed(1e-6)
    )
    stated = Parameters(
        (
            Parameter("compliance", 1.5 * COMPLIANCE, "rad/Nm", Log()),
            Parameter("friction", np.array(0.2), transform=Log()),
        )
    )
    exact = eqx.tree_at(lambda m: m.adjoint, data, None, is_leaf=lambda leaf: leaf is None)
    assert float(jnp.sum(data.residual(stated.values(stated.start)) ** 2)) == pytest.approx(
        float(jnp.sum(exact.residual(stated.values(stated.start)) ** 2))
    )  # another derivative, the same function
    found = solve(Problem(stated, (exact,)), tolerance=1e-12)
    values = stated.values(found.value.x)
    np.testing.assert_allclose(values["friction"], 0.3, rtol=1e-6)
    np.testing.assert_allclose(values["compliance"], COMPLIANCE, rtol=1e-6)
    assert int(exact.unsolved(values)) == 0


def test_what_sensors_see():
    """Normal forces, samples in between, those that do not count, a full matrix."""
    nominal = pressing()
    values = {"compliance": jnp.diag(jnp.asarray(COMPLIANCE))}
    whole = measured(nominal, uses=("compliance",), basis=None)
    force, q = whole.predict(values)
    diagonal, _ = whole.predict({"compliance": jnp.asarray(COMPLIANCE)})
    np.testing.assert_allclose(diagonal, force, rtol=1e-12)
    rows = np.array([1, 4, 7])
    normal = np.asarray(force)[rows, :, 2].copy()
    normal[1] = np.nan
    counts = np.array([True, False, True])
    film = ContactForces(
        "film", FINGER, scene(), TIME[rows], normal, 0.02, nominal,
        uses=("compliance",), reference_time=TIME, counts=counts, angles=np.asarray(q)[rows], angle_sd=0.001,
    )  # fmt: skip
    np.testing.assert_allclose(film.residual(values), np.zeros(15), atol=1e-9)
    assert film.residual(values).shape == (15,)
    # Gain, bias and clock of a sensor: half a row late is the mean of two rows, the first stays.
    sensor = {"sensor gain": jnp.array([1.2]), "sensor bias": jnp.array(0.3), "sensor delay": jnp.array(0.005)}
    whole = measured(nominal, uses=("compliance", *sensor), basis=None)
    shown, _ = whole.predict(values | sensor)
    force = np.asarray(force)
    earlier = np.concatenate([force[:1], 0.5 * (force[1:] + force[:-1])])
    np.testing.assert_allclose(shown, 1.2 * earlier + 0.3, atol=1e-12)
    forward = jax.jacfwd(lambda delay: whole.predict(values | sensor | {"sensor delay": delay})[0])(jnp.array(0.005))
    np.testing.assert_allclose(forward[1:], -1.2 * np.diff(force, axis=0) / 0.01, rtol=1e-9, atol=1e-9)
    with pytest.raises(ValueError, match=r"sensor gain must be \[1\]"):
        whole.residual(values | sensor | {"sensor gain": jnp.ones(2)})


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"force": np.zeros((STEPS, 2, 3))}, "force must be"),
        ({"force": np.full((STEPS, 1, 3), np.nan)}, "force is not finite, first in row 0"),
        ({"nominal": pressing()[:-1]}, "rows"),
        ({"nominal": np.zeros((STEPS, 3))}, "nominal must be"),
        ({"reference_time": TIME - 0.01}, "reference goes from"),
        ({"reference_time": TIME * np.linspace(1.1, 1.0, STEPS)}, "no row of the reference"),
        ({"angles": np.zeros((STEPS, 3))}, "angles must be"),
        ({"angle_sd": None}, "belong together"),
        ({"basis": np.zeros((3, 4))}, "basis"),
        ({"basis": None}, "basis"),
        ({"uses": ("friction of table", "reference")}, "table"),
        ({"uses": ("friction", "friction of plate", "reference")}, "beside"),
        ({"uses": ("stiffness",)}, "stiffness"),
        ({"joints": ("elbow",)}, "elbow"),
        ({"pads": ("thumb",)}, "thumb"),
        ({"counts": np.ones(3, bool)}, "counts"),
    ],
)
def test_bad_input(changed, told):
    nominal = changed.pop("nominal", pressing())
    angles = changed.pop("angles", pressing())
    with pytest.raises(ValueError, match=told):
        measured(nominal, changed.pop("force", None), angles, **changed)


def test_values_of_another_size():
    values = parameters().values(parameters().start)
    with pytest.raises(ValueError, match="compliance must be"):
        measured(pressing()).residual(values | {"compliance": jnp.ones(3)})
    with pytest.raises(ValueError, match="reference must be"):
        measured(pressing()).residual(values | {"reference": jnp.zeros((4, 3))})
    with pytest.raises(ValueError, match="pad stiffness must be"):
        measured(pressing()).residual(values | {"pad stiffness": jnp.ones(3)})
