"""A function compiled as one kernel gives the same numbers wherever it stands."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from icjax import compiling, lcp
from icjax.compiling import as_one_kernel, as_primitive
from icjax.contact import assemble, dimensionless, random_grasp
from icjax.lcp import residual

N = 24
REACHED = 1e-10


def halved(x):
    """A loop with a reduction, a slice and a condition in each turn."""

    def turn(state):
        x, count = state
        largest = jnp.max(jnp.abs(x))
        return jnp.where(jnp.abs(x) == largest, 0.5 * x, x) + 0.0 * x[count % x.shape[0]], count + 1

    return jax.lax.while_loop(lambda state: jnp.max(jnp.abs(state[0])) > 1.0, turn, (x, 0))


kernel = as_one_kernel(halved)
X = 10.0 * np.random.default_rng(0).normal(size=200)


def test_the_same_numbers_eager_compiled_and_mapped():
    expected, turns = halved(X)
    for function in (kernel, jax.jit(kernel)):
        found, count = function(X)
        np.testing.assert_array_equal(found, expected)
        assert count == turns
    both = jnp.stack([X, 3 * X])
    np.testing.assert_array_equal(jax.vmap(kernel)(both)[0], [halved(X)[0], halved(3 * X)[0]])
    np.testing.assert_array_equal(jax.lax.map(lambda x: kernel(x)[0], both), [halved(X)[0], halved(3 * X)[0]])


@pytest.mark.skipif(kernel is halved, reason="this version of jaxlib is not known to compile a marked call as a whole")
def test_the_program_holds_one_call_and_no_loop_of_its_own():
    text = jax.jit(kernel).lower(X).compile().as_text()
    entry = text[text.index("\nENTRY") :]
    assert 'xla_cpu_small_call="true"' in entry
    assert " while(" not in entry


def test_an_unknown_version_changes_nothing(monkeypatch):
    monkeypatch.setattr(compiling, "version", lambda package: "99.0.0")
    assert as_one_kernel(halved) is halved


def _root(x):
    """Heron's square root, which knows nothing of derivatives, and the number of its steps."""
    return jax.lax.while_loop(lambda s: s[1] < 30, lambda s: (0.5 * (s[0] + x / s[0]), s[1] + 1), (x, 0))


def _slope(arguments, tangents):
    root, steps = square_root(*arguments)
    return (root, steps), (tangents[0] / (2 * root), None)


square_root = as_primitive(_root, _slope)


def test_an_operation_keeps_its_derivative_in_scans_in_every_order_and_batch():
    """x^(1/4): the rule of a `custom_jvp` would be lost within reverse mode of the scan."""

    def rolled(x):
        return jax.lax.scan(lambda c, _: (jax.checkpoint(lambda c: square_root(c)[0])(c), None), x, None, length=2)[0]

    x = jnp.array([2.0, 3.0])
    for second in (
        jax.hessian(rolled),
        jax.jacrev(jax.jacrev(rolled)),
        jax.jacfwd(jax.jacfwd(rolled)),
        jax.jacrev(jax.jacfwd(rolled)),
    ):
        np.testing.assert_allclose(jax.vmap(second)(x), -3 / 16 * x**-1.75, rtol=1e-12)
        np.testing.assert_allclose(jax.jit(second)(x[0]), -3 / 16 * x[0] ** -1.75, rtol=1e-12)
    root, steps = jax.vmap(jax.vmap(square_root), in_axes=1, out_axes=1)(x[None] * jnp.ones((3, 1)))
    np.testing.assert_allclose(root, jnp.sqrt(x)[None] * jnp.ones((3, 1)), rtol=1e-15)
    assert steps.dtype == jnp.int_


def problem(seed=0, contacts=N // 6):
    M, q = assemble(dimensionless(random_grasp(seed, contacts), 2)[0], 2)
    return jnp.asarray(M), jnp.asarray(q)


def test_lemke_inside_everything():
    """Loops short and long, conditions, checkpoints, derivatives of both modes and orders, batches of batches."""
    M, q = problem()
    alone = lcp.solve(M, q).value
    assert float(residual(M, q, alone)) < REACHED

    def one(scale):
        return lcp.solve(M, scale * q).value

    def total(scale):
        return jnp.sum(one(scale) ** 2)

    scales = jnp.array([0.5, 1.0, 2.0, 4.0])
    expected = scales[:, None] * alone[None]
    close = {"rtol": 1e-9, "atol": 1e-9 * float(jnp.max(alone))}
    np.testing.assert_allclose(jax.jit(jax.vmap(one))(scales), expected, **close)
    np.testing.assert_allclose(jax.vmap(jax.vmap(one))(scales.reshape(2, 2)).reshape(4, -1), expected, **close)
    np.testing.assert_allclose(jax.lax.scan(lambda c, s: (c, one(s)), None, scales)[1], expected, **close)
    np.testing.assert_allclose(jax.jit(lambda s: jax.lax.cond(s > 1, one, lambda s: 0 * q, s))(2.0), 2 * alone, **close)
    looped = jax.lax.while_loop(lambda c: c[0] < 3, lambda c: (c[0] + 1, one(1.0 + 0.0 * c[1][0])), (0, alone))
    np.testing.assert_allclose(looped[1], alone, **close)
    slope = 2 * float(jnp.sum(alone**2))
    np.testing.assert_allclose(jax.jit(jax.jacfwd(total))(1.0), slope, rtol=1e-9)
    np.testing.assert_allclose(jax.jit(jax.vmap(jax.grad(total)))(scales), slope * scales, rtol=1e-9)

    def scanned(scales):
        return jax.lax.scan(lambda carry, s: (carry + jax.checkpoint(total)(s), None), 0.0, scales)[0]

    np.testing.assert_allclose(jax.jit(jax.grad(scanned))(scales), slope * scales, rtol=1e-9)


@pytest.mark.parametrize(
    ("contacts", "dtype"), [(1, np.float64), (2, np.float64), (3, np.float64), (3, np.float32), (4, np.float32)]
)
def test_lemke_of_every_small_size_in_a_short_loop(contacts, dtype):
    """XLA turns loops over little data into one kernel by itself; the two must not meet."""
    M, q = (jnp.asarray(x, dtype) for x in problem(contacts=contacts))
    scales = jnp.asarray([1.0, 2.0], dtype)
    found = jax.jit(lambda s: jax.lax.scan(lambda c, s: (c, lcp.solve(M, s * q).value), None, s)[1])(scales)
    assert float(residual(M, q, found[0])) < (REACHED if dtype == np.float64 else 1e-4)
