"""Contact problems for the tests: one contact, and random grasps of a rigid object by compliant fingers."""

import jax.numpy as jnp
import numpy as np

from icjax.contact import ContactProblem, contact_frame


def one_contact(free, gap=0.0, coupling=1e-3, friction=0.5, frame=None) -> ContactProblem:
    """One contact; a scalar coupling means an isotropic one. Everything in SI."""
    frame = contact_frame(np.array([0.0, 0.0, 1.0])) if frame is None else frame
    coupling = jnp.asarray(coupling, float)
    return ContactProblem(
        coupling=coupling * jnp.eye(3) if coupling.ndim == 0 else coupling,
        free_displacement=jnp.asarray(free, float),
        gap=jnp.reshape(jnp.asarray(gap, float), (1,)),
        frames=jnp.asarray(frame)[None],
        friction=jnp.reshape(jnp.asarray(friction, float), (1,)),
        active=np.array([True]),
    )


def random_frame(rng: np.random.Generator) -> np.ndarray:
    normal = rng.normal(size=3)
    return np.asarray(contact_frame(normal / np.linalg.norm(normal)))


def reordered(problem: ContactProblem, order) -> ContactProblem:
    """The same contacts in other slots."""
    wide = (3 * np.asarray(order)[:, None] + np.arange(3)).reshape(-1)
    return ContactProblem(
        problem.coupling[np.ix_(wide, wide)],
        problem.free_displacement[wide],
        problem.gap[order],
        problem.frames[order],
        problem.friction[order],
        problem.active[order],
    )
