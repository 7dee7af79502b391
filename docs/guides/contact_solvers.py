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

from icjax.contact import ContactProblem, InteriorPoint, Projected, random_grasp, solve
from icjax.lcp import Lemke, Smoothed


def pressed(depth, pull):
    """A fingertip of compliance 1 mm/N, driven `depth` below a table and `pull` along it (m)."""
    return ContactProblem(
        coupling=1e-3 * jnp.eye(3),
        free_displacement=jnp.stack([pull, jnp.zeros_like(pull), -depth]),  # world: x, y, z
        gap=jnp.zeros(1),
        frames=jnp.eye(3)[None][:, :, [2, 0, 1]],  # columns: normal z, tangents x and y
        friction=jnp.full(1, 0.5),
        active=jnp.ones(1, bool),
    )


solution = solve(pressed(jnp.array(2e-3), jnp.array(3e-3)))
print("force (N)        ", np.round(solution.value.force[0], 3))
print("displacement (mm)", np.round(1e3 * solution.value.displacement[0], 3))
print("state            ", ["open", "sticking", "sliding"][int(solution.value.slip_state[0])])
print(f"residual          {solution.stats['residual']:.0e}, margin {solution.value.margin:.2f}")

# %% [markdown]
# Two newtons of normal force hold one newton of friction; the tip wanted to pull with three, so it slides 2 mm.
#
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
    problem = pressed(jnp.array(2e-3), jnp.array(0.0))
    free = jnp.stack([3e-3 * jnp.cos(angle), 3e-3 * jnp.sin(angle), jnp.array(-2e-3)])
    moved = ContactProblem(problem.coupling, free, problem.gap, problem.frames, problem.friction, problem.active)
    return solve(moved, facets=facets, solver=solver).value.force[0]


figure, axis = plt.subplots(figsize=(3.4, 3.4), layout="constrained")
for facets, solver, label in ((2, Lemke(), "m = 2"), (4, Lemke(), "m = 4"), (None, InteriorPoint(1e-9), "circle")):
    force = jax.jit(jax.vmap(partial(friction, facets=facets, solver=solver)))(angle)
    axis.plot(force[:, 0], force[:, 1], ".", markersize=3, label=label)
axis.set(xlabel="friction along x (N)", ylabel="along y (N)", aspect="equal")
axis.legend(frameon=False)

# %% [markdown]
# With m = 2 all directions but four end in the same corners: the force is off the slip by up to 45 degrees.
#
# ## Two derivatives
#
# Exactly, a fingertip above the table feels nothing, and its derivative is zero: nothing for a fit to hold on to.
# `Smoothed(kappa)` leaves the forces as they are and takes the derivative of the central path, which sees the table
# coming.

# %%
depth = jnp.linspace(-1e-3, 1e-3, 81)


def normal_force(depth, adjoint=None):
    return solve(pressed(depth, jnp.array(0.0)), adjoint=adjoint).value.force[0, 2]


figure, (above, below) = plt.subplots(1, 2, figsize=(7, 2.6), layout="constrained")
above.plot(1e3 * depth, jax.jit(jax.vmap(normal_force))(depth), color="0.2")
above.set(xlabel="depth (mm)", ylabel="normal force (N)")
for adjoint, label in (
    (None, "exact"),
    (Smoothed(1e-8, unit=1.0), "smoothed, 1e-8 J"),
    (Smoothed(1e-7, unit=1.0), "1e-7 J"),
):
    slope = jax.jit(jax.vmap(jax.grad(partial(normal_force, adjoint=adjoint))))(depth)
    below.plot(1e3 * depth, slope / 1e3, label=label)
below.set(xlabel="depth (mm)", ylabel="its derivative (N/mm)")
below.legend(frameon=False)
