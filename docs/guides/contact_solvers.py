# ---
# jupyter:
#   jupytext:
#     text_representation:
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # Contact forces by themselves
#
# `contact.solve` takes the contact problem of one time step from any simulator: how displacements answer to forces (W),
# where bodies would go without contact, gaps, frames and friction. [The contact problem](../contact_problem.md) has the
# theory; the rollout of `icjax.synthesis` makes these problems by itself.

# %%
from functools import partial

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from icjax.contact import (
    SLIDING,
    ContactProblem,
    InteriorPoint,
    Projected,
    contact_frame,
    random_grasp,
    solve,
)
from icjax.lcp import Lemke, Smoothed
from icjax.results import RESULTS

up = jnp.array([0.0, 0.0, 1.0])


def pressed(free):
    """A fingertip of compliance 1 mm/N that touches a table and would move by `free` (world, m)."""
    return ContactProblem(
        coupling=1e-3 * jnp.eye(3),
        free_displacement=free,
        gap=jnp.zeros(1),
        frames=contact_frame(up)[None],
        friction=jnp.full(1, 0.5),
        active=jnp.ones(1, bool),
    )


solution = jax.jit(solve)(pressed(jnp.array([3e-3, 0.0, -2e-3])))
assert solution.result == RESULTS.solved
print("force (N)        ", np.round(solution.value.force[0], 3))
print("displacement (mm)", np.round(1e3 * solution.value.displacement[0], 3))
print("slides           ", bool(solution.value.slip_state[0] == SLIDING))
print(f"residual          {solution.stats['residual']:.0e}, margin {solution.value.margin:.2f}")

# %% [markdown]
# Two newtons of normal force hold one newton of friction; the tip wanted to pull with three, so it slides 2 mm.
#
# ## A body with inertia, and a limit
#
# A box of 1 kg stands on four corners and is pushed sideways; in a step of time h forces move it by $h^2 M^{-1}$. A
# stop (one more row: its clearance, and how it moves with the box) lets it go 20 micrometres.

# %%
h, mass, side = 0.01, 1.0, np.array([0.2, 0.2, 0.1])
mobility = h**2 * np.linalg.inv(
    np.diag([mass] * 3 + list(mass / 12 * (np.sum(side**2) - side**2)))  # of translation and rotation
)
corners = np.array([[x, y, -1.0] for x in (-1, 1) for y in (-1, 1)]) * side / 2


def jacobian(r):
    """Of a point r of the box, with respect to the translation and rotation of the box."""
    x, y, z = r
    return np.hstack([np.eye(3), [[0, z, -y], [-z, 0, x], [y, -x, 0]]])


stop = -np.eye(1, 6)  # its clearance shrinks as the box moves along x
J = np.vstack([*map(jacobian, corners), stop])


def box(push):
    """The step from rest, pushed at the centre (N)."""
    return ContactProblem(
        coupling=jnp.asarray(J @ mobility @ J.T),
        free_displacement=jnp.asarray(J @ mobility) @ jnp.stack([push, 0.0, -9.81 * mass, 0.0, 0.0, 0.0]),
        gap=jnp.zeros(4),
        frames=jnp.tile(contact_frame(up)[None], (4, 1, 1)),
        friction=jnp.full(4, 0.5),
        active=jnp.ones(4, bool),
        limit_gap=jnp.full(1, 20e-6),
    )


for push in (3.0, 5.0, 8.0):
    value = jax.jit(solve)(box(jnp.array(push))).value
    print(
        f"pushed with {push} N: moves {1e6 * value.displacement[0, 0]:5.1f} micrometres, "
        f"friction {value.force[:, 0].sum():6.3f} N, stop {value.limit_force[0]:.3f} N"
    )

# %% [markdown]
# ## Four solvers, one problem
#
# A grasp of eight contacts. The residual is recomputed from the forces, whoever found them; a point of the central
# path is not an exact solution and does not claim to be one.

# %%
grasp = random_grasp(seed=2, contacts=8)
for name, solver in {
    "Lemke": Lemke(),
    "interior point, polished": InteriorPoint(1e-6, polish=True, fallback=Lemke()),
    "interior point, kappa 1e-4": InteriorPoint(1e-4),
    "Tresca, projected gradient": Projected(),
}.items():
    solution = jax.jit(partial(solve, solver=solver))(grasp)
    normal = np.einsum("ia,ia->i", grasp.frames[:, :, 0], solution.value.force)
    print(
        f"{name:27s} residual {solution.stats['residual']:.0e}, {int(solution.stats['pivots']):3d} iterations, "
        f"normal forces {np.array2string(normal, precision=3, suppress_small=True)} N"
    )

# %% [markdown]
# ## A sweep with `vmap`
#
# Pull the fingertip in all directions by 3 mm: the friction force lies on a polygon, or on a circle with
# `facets=None`.

# %%
angle = jnp.linspace(0.0, 2 * jnp.pi, 361)


def friction(angle, facets, solver):
    free = jnp.stack([3e-3 * jnp.cos(angle), 3e-3 * jnp.sin(angle), jnp.array(-2e-3)])
    return solve(pressed(free), facets=facets, solver=solver).value.force[0]


figure, axis = plt.subplots(figsize=(3.4, 3.4), layout="constrained")
for facets, solver, label in ((2, Lemke(), "m = 2"), (4, Lemke(), "m = 4"), (None, InteriorPoint(1e-9), "circle")):
    force = jax.jit(jax.vmap(partial(friction, facets=facets, solver=solver)))(angle)
    axis.plot(force[:, 0], force[:, 1], ".", markersize=3, label=label)
axis.set(xlabel="friction along x (N)", ylabel="along y (N)", aspect="equal")
axis.legend(frameon=False)

# %% [markdown]
# On the polygon the force is the nearest that its facet allows: with m = 2 as little as 0.71 of mu times the normal
# force, and up to 45 degrees off the slip.
#
# ## Two derivatives
#
# Exactly, a fingertip above the table feels nothing, and its derivative is zero: nothing for a fit to hold on to.
# `Smoothed(kappa)` leaves the forces as they are and takes the derivative of the central path, which sees the table
# coming, from as far as $\sqrt{\kappa W}$: 0.03 and 0.1 mm here.

# %%
depth = jnp.linspace(-1e-3, 1e-3, 81)


def normal_force(depth, adjoint=None):
    return solve(pressed(-depth * up), adjoint=adjoint).value.force[0, 2]


figure, (above, below) = plt.subplots(1, 2, figsize=(7, 2.6), layout="constrained")
above.plot(1e3 * depth, jax.jit(jax.vmap(normal_force))(depth), color="0.2")
above.set(xlabel="depth (mm)", ylabel="normal force (N)")
for adjoint, label in (
    (None, "exact"),
    (Smoothed(1e-6, unit=1.0), "smoothed, 1e-6 J"),
    (Smoothed(1e-5, unit=1.0), "1e-5 J"),
):
    slope = jax.jit(jax.vmap(jax.grad(partial(normal_force, adjoint=adjoint))))(depth)
    below.plot(1e3 * depth, slope / 1e3, label=label)
below.set(xlabel="depth (mm)", ylabel="its derivative (N/mm)")
below.legend(frameon=False, loc="upper left")
