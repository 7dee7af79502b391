"""One contact in closed form: separate, stick, slip along a facet, slip between facets; and its derivative.

With an isotropic coupling W = w I, gap s, free displacement d (normal part d_n, tangential part d_t):

- separate, s + d_n >= 0:       f = 0
- else f_n = -(s + d_n) / w, and
- stick:                        f_t = -d_t / w, inside the polygon of mu f_n
- slip, force in a corner:      f_t = mu f_n d_j, the corner with the largest -d_j . du
- slip, force on an edge:       the edge's normal e sees mu f_n cos(pi/2m); along the edge the contact does not move:
                                f_t = -mu f_n cos(pi/2m) e - (d . a / w) a, a along the edge

For a general symmetric positive definite W: f_n = -(s + d_n) / (n^T W (n + mu d_j)) in a corner.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from contact_scenes import one_contact, random_frame

from icjax.contact import OPEN, SLIDING, STICKING, solve
from icjax.results import RESULTS

EXACT = 1e-12  # relative to the largest force or displacement
DIFFERENCES = 1e-7  # relative; rounding 1e-16 over a relative step of 1e-6, times ten pivots
STEP = 1e-9  # m, against displacements of 1e-3 m
w, mu = 2e-3, 0.6
NAMES = ("separate", "stick", "stick_on_axis", "stick_at_rest", "facet", "between", "edge")
STATE = {"separate": OPEN, "facet": SLIDING, "between": SLIDING, "edge": SLIDING}


@eqx.filter_jit
def answer(problem, facets):
    return solve(problem, facets=facets)


def local_force(x, frame, facets):
    """Force in the frame's axes as a function of (free displacement in those axes, gap)."""
    problem = one_contact(frame @ x[:3], x[3], w, mu, frame)
    return frame.T @ solve(problem, facets=facets).value.force[0]


force = jax.jit(local_force, static_argnums=2)
forward_jacobian = jax.jit(jax.jacfwd(local_force), static_argnums=2)
reverse_jacobian = jax.jit(jax.jacrev(local_force), static_argnums=2)


def directions(m):
    """Unit vectors in the tangent plane: corner j = 0, the middle of the edge after it, and along that edge."""
    half = 0.5 * np.pi / m
    return (
        np.array([1.0, 0.0]),
        np.array([np.cos(half), np.sin(half)]),
        np.array([-np.sin(half), np.cos(half)]),
    )


def case(name, m):
    """Local free displacement (n, t1, t2), gap, and the closed form of the local force as a function of them."""
    corner, middle, along = directions(m)
    reach = mu * np.cos(0.5 * np.pi / m)

    def pressed(d, s):
        return -(s + d[0]) / w

    def stick(d, s):
        return jnp.concatenate([pressed(d, s)[None], -d[1:] / w])

    def slip_at_corner(d, s):
        return pressed(d, s) * jnp.concatenate([jnp.ones(1), -mu * corner])

    def slip_on_edge(d, s):
        tangential = -reach * pressed(d, s) * middle - (d[1:] @ along) / w * along
        return jnp.concatenate([pressed(d, s)[None], tangential])

    return {
        "separate": (np.array([-1e-3, 2e-3, -1e-3]), 1.5e-3, lambda d, s: 0.0 * d * s),
        "stick": (np.array([-1e-3, 1e-4, -2e-4]), -0.5e-3, stick),
        "stick_on_axis": (np.array([-1e-3, 2e-4, 0.0]), 0.0, stick),
        "stick_at_rest": (np.array([-1e-3, 0.0, 0.0]), 0.0, stick),
        "facet": (np.array([-1e-3, *(3e-3 * corner)]), 0.2e-3, slip_at_corner),
        "between": (np.array([-1e-3, *(3e-3 * (0.8 * corner + 0.2 * middle))]), 0.0, slip_at_corner),
        "edge": (np.array([-1e-3, *(3e-3 * middle + 3e-5 * along)]), 0.0, slip_on_edge),
    }[name]


@pytest.mark.parametrize("m", [2, 4])
@pytest.mark.parametrize("name", NAMES)
def test_closed_form(name, m):
    local, gap, closed_form = case(name, m)
    frame = random_frame(np.random.default_rng(m))
    solution = answer(one_contact(frame @ local, gap, w, mu, frame), m)
    assert bool(solution.result == RESULTS.solved)
    expected = np.asarray(closed_form(jnp.asarray(local), jnp.asarray(gap)))
    value = solution.value
    np.testing.assert_allclose(frame.T @ value.force[0], expected, atol=EXACT * 1.0)
    np.testing.assert_allclose(frame.T @ value.displacement[0], local + w * expected, atol=EXACT * 1e-3)
    assert int(value.slip_state[0]) == STATE.get(name, STICKING)
    assert float(value.margin) > 1e-3


@pytest.mark.parametrize("m", [4])
@pytest.mark.parametrize("name", NAMES)
def test_derivative_of_the_closed_form(name, m):
    """By free displacement and gap: closed form = forward = reverse = central difference."""
    local, gap, closed_form = case(name, m)
    frame = random_frame(np.random.default_rng(10 + m))
    x = jnp.concatenate([jnp.asarray(local), jnp.asarray(gap)[None]])
    expected = jax.jacfwd(lambda x: closed_form(x[:3], x[3]))(x)
    largest = 1.0 / w
    forward, reverse = forward_jacobian(x, frame, m), reverse_jacobian(x, frame, m)
    np.testing.assert_allclose(forward, expected, atol=EXACT * largest)
    np.testing.assert_allclose(reverse, expected, atol=EXACT * largest)
    steps = STEP * np.eye(4)
    difference = np.stack([(force(x + e, frame, m) - force(x - e, frame, m)) / (2 * STEP) for e in steps], axis=1)
    np.testing.assert_allclose(forward, difference, atol=DIFFERENCES * largest)


def test_general_coupling():
    """Any W: the answer is built from a state of the contact, then the free displacement that leads to it."""
    rng = np.random.default_rng(7)
    corner, middle, _ = directions(4)
    for _ in range(5):
        frame = random_frame(rng)
        root = rng.normal(size=(3, 3))
        W = 1e-3 * (np.eye(3) + 0.1 * root @ root.T)
        slide = 0.9 * corner + 0.1 * middle
        states = {
            STICKING: (np.array([1.3, 0.2, -0.3]), np.array([0.0, 0.0, 0.0])),
            SLIDING: (np.array([1.3, *(-mu * 1.3 * corner)]), np.array([0.0, *(1e-3 * slide)])),
            OPEN: (np.zeros(3), np.array([2e-3, 1e-3, -3e-3])),
        }
        for state, (force, displacement) in states.items():
            free = frame @ displacement - W @ (frame @ force)
            value = answer(one_contact(free, 0.0, W, mu, frame), 4).value
            np.testing.assert_allclose(value.force[0], frame @ force, atol=EXACT)
            np.testing.assert_allclose(value.displacement[0], frame @ displacement, atol=EXACT * 1e-3)
            assert int(value.slip_state[0]) == state


def test_frictionless_contact():
    """mu = 0: only the normal force, sliding if it moves at all, no tangential derivative."""
    jacobian_without_friction = jax.jit(
        jax.jacrev(lambda d: solve(one_contact(d, friction=0.0), facets=4).value.force[0])
    )
    for tangential, state in ((1e-3, SLIDING), (0.0, STICKING)):
        free = jnp.array([tangential, 0.0, -1e-3])
        value = answer(one_contact(free, friction=0.0), 4).value
        np.testing.assert_allclose(value.force[0], [0.0, 0.0, 1.0], atol=EXACT)
        assert int(value.slip_state[0]) == state
        jacobian = jacobian_without_friction(free)
        np.testing.assert_allclose(jacobian, np.diag([0.0, 0.0, -1000.0]), atol=EXACT * 1000)


def test_derivative_by_friction_and_coupling():
    """Slip at a corner: df_t/dmu = f_n d_j; pressed: df_n/dw = -f_n / w."""
    free = np.array([0.0, 0.0, -1e-3])
    frame = np.asarray(one_contact(free).frames[0])
    slide = free + 4e-3 * frame[:, 1]

    def sliding_force(mu, w):
        return frame.T @ answer(one_contact(slide, 0.0, w, mu), 4).value.force[0]

    by_mu, by_w = jax.jit(jax.jacrev(sliding_force, (0, 1)))(0.5, 1e-3)
    np.testing.assert_allclose(by_mu, [0.0, -1.0, 0.0], atol=EXACT)
    np.testing.assert_allclose(by_w, [-1e3, 0.5e3, 0.0], atol=EXACT * 1e3)


def test_second_derivative_is_finite_and_right():
    """Pressed: f_n = -d_n / w, so d2 f_n / dw2 = -2 d_n / w^3."""

    def normal_force(w):
        return answer(one_contact(np.array([0.0, 0.0, -1e-3]), coupling=w), 4).value.force[0, 2]

    np.testing.assert_allclose(jax.jit(jax.hessian(normal_force))(1e-3), 2e-3 / 1e-9, rtol=EXACT)
