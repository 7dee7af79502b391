"""Compliance and reference from angles and torques, without a simulation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives

from icjax.fit import Parameter, Parameters, Problem, StaticEquilibrium, solve, spline_basis
from icjax.inference import Cholesky, Log, jacobian, laplace

TIME = np.linspace(0.0, 1.0, 12)
BASIS = spline_basis(TIME, 5)
C = np.array([[0.4, 0.1], [0.1, 0.9]])
RANDOM = np.random.default_rng(3)
DEVIATION = 0.1 * RANDOM.standard_normal((5, 2))
TORQUES = RANDOM.uniform(0.0, 0.5, (2, 12, 2))


def trial(number, compliance=C, **fields):
    torque = TORQUES[number]
    angles = BASIS @ DEVIATION + torque @ compliance
    return StaticEquilibrium(f"trial {number}", TIME, angles, torque, 0.001, basis=BASIS, **fields)


def problem(**fields):
    found = Parameter("compliance", np.diag([0.1, 0.1]), transform=Cholesky(2))
    return Problem(
        Parameters((found, Parameter("reference", np.zeros((5, 2))))), (trial(0, **fields), trial(1, **fields))
    )


def test_full_compliance_and_reference_are_found():
    found = solve(problem(), tolerance=1e-12)
    values = problem().parameters.values(found.value.x)
    np.testing.assert_allclose(values["compliance"], C, rtol=1e-6)
    np.testing.assert_allclose(values["reference"], DEVIATION, atol=1e-8)


def test_the_diagonal_with_a_reference_from_catch_trials():
    angles = BASIS @ DEVIATION + TORQUES[0] * np.array([0.4, 0.9])
    measured = StaticEquilibrium(
        "contact", TIME, angles, TORQUES[0], 0.001, uses=("compliance",), nominal=BASIS @ DEVIATION
    )
    parameters = Parameters((Parameter("compliance", np.array([2.0, 0.2]), transform=Log()),))
    found = solve(Problem(parameters, (measured,)), tolerance=1e-12)
    np.testing.assert_allclose(parameters.values(found.value.x)["compliance"], [0.4, 0.9], rtol=1e-6)


def test_derivatives():
    check_derivatives(problem().data, 0.1 * jnp.arange(13.0))
    assert np.isfinite(jax.jacfwd(problem().data)(problem().parameters.start)).all()


def test_a_reference_free_in_every_sample_leaves_the_compliance_undetermined():
    torque = TORQUES[0]
    alone = StaticEquilibrium("alone", TIME, torque @ C, torque, 0.001, basis=np.eye(12))
    parameters = Parameters((Parameter("compliance", np.diag(C), transform=Log()), Parameter("reference", torque @ C)))
    known = Problem(parameters, (alone,)).laplace(parameters.start)
    assert np.isinf(known.sd[:2]).all()
    assert known.blind.shape[1] == 2
    shared = problem()
    known = shared.laplace(shared.parameters.start)
    assert np.isfinite(known.sd).all()
    plain = laplace(jacobian(shared.data, shared.parameters.start), np.zeros((0, 13)))
    np.testing.assert_allclose(known.sd, plain.sd, rtol=1e-9)


def test_samples_that_do_not_count():
    counts = np.arange(12) != 4
    lost = TORQUES[0].copy()
    lost[4] = np.nan
    measured = StaticEquilibrium(
        "gap", TIME, np.zeros((12, 2)), lost, 0.001, uses=(), compliance=np.ones(2), counts=counts
    )
    found = np.asarray(measured.residual({})).reshape(12, 2)
    assert np.all(found[4] == 0)
    np.testing.assert_allclose(found[5], -TORQUES[0][5] / 0.001)


GOOD = {"name": "x", "time": TIME, "angles": np.zeros((12, 2)), "torque": np.zeros((12, 2)), "angle_sd": 0.001}


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"torque": np.zeros((11, 2))}, "torque"),
        ({"angles": np.full((12, 2), np.nan)}, "angles is not finite"),
        ({"angle_sd": 0.0}, "angle_sd"),
        ({"time": TIME[::-1]}, "increase"),
        ({"basis": np.zeros((3, 5))}, "basis"),
        ({"basis": None, "uses": ("compliance", "reference")}, "basis"),
        ({"uses": "compliance"}, "must be several names"),
        ({"uses": ("friction", "reference")}, "friction"),
        ({"uses": ("compliance", "reference", "reference of another")}, "both"),
        ({"counts": np.zeros(12, bool)}, "counts"),
        ({"compliance": np.ones(2), "uses": ("compliance", "reference")}, "compliance"),
    ],
)
def test_bad_input(changed, told):
    with pytest.raises(ValueError, match=told):
        StaticEquilibrium(**({**GOOD, "basis": BASIS} | changed))


def test_values_of_another_size():
    with pytest.raises(ValueError, match="compliance must be"):
        trial(0).residual({"compliance": jnp.ones(3), "reference": jnp.zeros((5, 2))})
    with pytest.raises(ValueError, match="reference must be"):
        trial(0).residual({"compliance": jnp.ones(2), "reference": jnp.zeros((4, 2))})


def test_spline_basis():
    assert BASIS.shape == (12, 5)
    np.testing.assert_allclose(BASIS.sum(axis=1), 1.0, atol=1e-14)
    assert BASIS[0, 0] == BASIS[-1, -1] == 1.0
    with pytest.raises(ValueError, match="count"):
        spline_basis(TIME, 3)
    with pytest.raises(ValueError, match="increase"):
        spline_basis(np.zeros(4), 5)
