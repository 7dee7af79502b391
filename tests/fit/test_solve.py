"""Parameters and solvers on a problem whose answer is known: a decay y = b exp(-t / C)."""

from types import SimpleNamespace
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax.fit import Parameter, Parameters, Problem, multi_start, solve
from icjax.inference import Log
from icjax.results import RESULTS

TIME = np.linspace(0.0, 1.0, 40)


class Decay(eqx.Module):
    """Measured y at TIME, standard deviation 1e-3."""

    y: jax.Array
    name: str = eqx.field(static=True, default="decay")
    uses: tuple[str, ...] = eqx.field(static=True, default=("C", "b"))

    def residual(self, values):
        return (self.y - values["b"] * jnp.exp(-jnp.asarray(TIME) / values["C"])) / 1e-3


def decay(prior_sd=None, **fields):
    y = jnp.asarray(2.0 * np.exp(-TIME / 0.3))
    C = Parameter("C", np.array(1.0), "s", Log(), prior_sd)
    return Problem(Parameters((C, Parameter("b", np.array(0.3), **fields))), (Decay(y),))


@pytest.mark.parametrize("solver", ["levenberg_marquardt", "bfgs", "lbfgsb"])
def test_every_solver_finds_the_minimum(solver):
    problem = decay()
    found = solve(problem, solver=solver, tolerance=1e-9)
    assert found.result == RESULTS.solved
    values = problem.parameters.values(found.value.x)
    assert float(values["C"]) == pytest.approx(0.3, rel=1e-6)
    assert float(values["b"]) == pytest.approx(2.0, rel=1e-6)


def test_a_prior_pulls_and_a_frozen_one_stays():
    problem = decay(prior_sd=1e-6)
    found = problem.parameters.values(solve(problem).value.x)
    assert float(found["C"]) == pytest.approx(1.0, abs=1e-2)
    frozen = decay(frozen=True)
    assert frozen.parameters.names == ("C",)
    assert float(frozen.parameters.values(solve(frozen).value.x)["b"]) == 0.3
    thawed = frozen.parameters.change("b", frozen=False)
    assert thawed.size == 2


def test_many_starts_agree():
    problem = decay()
    starts = jnp.asarray(np.random.default_rng(2).uniform([-1.5, 0.5], [0.5, 3.0], (8, 2)))
    found = multi_start(problem, starts, tolerance=1e-10)
    assert bool(jnp.all(found.result == RESULTS.solved))
    np.testing.assert_allclose(found.value.x[:, 0], np.log(0.3), atol=1e-6)
    in_batches = multi_start(problem, starts, tolerance=1e-10, batch=3)
    np.testing.assert_allclose(in_batches.value.x, found.value.x, atol=1e-8)


def test_progress_cancel_and_resume(tmp_path):
    problem, file, told = decay(), tmp_path / "fit.npz", []
    broken = solve(problem, progress=told.append, cancelled=lambda: len(told) >= 9, checkpoint=file)
    assert broken.result == RESULTS.not_converged
    assert [item.step for item in told] == list(range(1, 10))
    assert told[-1].cost <= told[0].cost
    assert file.is_file()
    again: list = []
    resumed = solve(problem, checkpoint=file, progress=again.append)
    assert resumed.result == RESULTS.solved
    assert again[-1].cost < again[0].cost <= told[-1].cost
    assert not file.exists()


def test_a_checkpoint_of_another_problem(tmp_path):
    file = tmp_path / "fit.npz"
    cost = float(decay().cost(decay().parameters.start))
    np.savez(file, stage=0, x=np.zeros(5), mark=cost)
    with pytest.raises(ValueError, match="belongs to another"):
        solve(decay(), checkpoint=file)
    np.savez(file, stage=0, x=np.zeros(2), mark=1.1 * cost)
    with pytest.raises(ValueError, match="nominal values cost .* belongs to another"):
        solve(decay(), checkpoint=file)
    np.savez(file, stage=0, x=np.array([0.0, np.nan]), mark=cost)
    with pytest.raises(ValueError, match="not finite"):
        solve(decay(), checkpoint=file)
    np.savez(file, stage=1, x=np.zeros(2), mark=cost)
    with pytest.raises(ValueError, match="is of stage 1, there are 1"):  # it had passed for solved, without a step
        solve(decay(), checkpoint=file)
    whole = file.read_bytes()
    for broken in (b"nothing", whole[: len(whole) // 2]):
        file.write_bytes(broken)
        with pytest.raises(ValueError, match="cannot be read"):
            solve(decay(), checkpoint=file)


def test_stages_go_on_from_each_other():
    rough, problem = decay(prior_sd=0.1), decay()
    found = solve((rough, problem), tolerance=1e-9)
    assert float(problem.parameters.values(found.value.x)["C"]) == pytest.approx(0.3, rel=1e-6)


def test_not_finite_at_the_start():
    problem = eqx.tree_at(lambda p: p.measurements[0].y, decay(), jnp.full(40, jnp.nan))
    assert solve(problem).result == RESULTS.invalid_input


def test_smooth_prior_and_labels():
    item = Parameter("C", np.ones((4, 2)), transform=Log(), smooth=0.5, labels=tuple("abcdefgh"))
    x = item.transform.free(np.ones((4, 2)))
    np.testing.assert_allclose(item.prior(x.at[2].set(1.0)), [2.0, 0, -2.0, 0, 0, 0])
    assert item.value(x).shape == (4, 2)
    assert item.names[0] == "C a"


class Square(eqx.Module):
    """What a measurement must not be."""

    name: str = eqx.field(static=True, default="square")
    uses: Any = eqx.field(static=True, default=())

    def residual(self, values):
        return jnp.zeros((2, 2))


def test_measurements_may_be_a_list():
    problem = decay()
    again = Problem(problem.parameters, list(problem.measurements))
    assert again.measurements == problem.measurements


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Parameter("C", np.array(np.nan)), "'C': its nominal value"),
        (lambda: Parameter("C", np.array(-1.0), transform=Log()), "'C': value"),
        (lambda: Parameter("C", np.array(1.0), prior_sd=0.0), "prior_sd"),
        (lambda: Parameter("C", np.ones(3), prior_sd=np.ones(2)), "2 entries for 3"),
        (lambda: Parameter("C", np.ones(3), labels=("a",)), "1 labels for 3"),
        (lambda: Parameter("C", np.ones(3), smooth=-1.0), "smooth"),
        (lambda: Parameters((Parameter("C", np.array(1.0)), Parameter("C", np.array(1.0)))), "two are named 'C'"),
        (
            lambda: Problem(Parameters((Parameter("C", np.array(1.0)),)), (Decay(jnp.zeros(40)),)),
            "needs the parameter 'b'",
        ),
        (lambda: Problem(Parameters((Parameter("C", np.array(1.0)),)), ()), "no measurement"),
        (lambda: solve(decay(), jnp.zeros(3)), r"start has the shape \(3,\)"),
        (lambda: solve(()), "empty"),
        (lambda: solve(decay(), tolerance=10.0), "tolerance = 10.0: must be between 0 and 1"),
        (lambda: solve(decay(), max_steps=-1), "max_steps"),
        (lambda: multi_start(decay(), jnp.zeros((3, 3))), r"starts has the shape \(3, 3\)"),
        (lambda: multi_start(decay(), jnp.zeros((3, 2)), tolerance=float("nan")), "tolerance"),
        (lambda: decay().laplace(jnp.zeros(3)), r"x has the shape \(3,\)"),
        (lambda: decay().laplace(jnp.full(2, jnp.nan)), "all finite"),
        (lambda: Parameter("C", np.ones(3), smooth=0.1, smooth_order=3), "first axis longer than smooth_order = 3"),
        (lambda: Parameter("C", np.array(1.0), smooth=0.1), "needs a first axis"),
        (lambda: Problem(decay().parameters, (SimpleNamespace(name="m", uses=()),)), "a measurement is a SimpleName"),
        (lambda: Problem(decay().parameters, (Square(uses="b"),)), "names of parameters, a tuple"),
        (lambda: solve(Problem(decay().parameters, (Square(),))), r"'square': its residual has the shape \(2, 2\)"),
    ],
)
def test_bad_input(make, match):
    with pytest.raises(ValueError, match=match):
        make()
