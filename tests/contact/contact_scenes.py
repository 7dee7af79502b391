"""Contact problems for the tests: one contact, and random grasps of a rigid object by compliant fingers."""

import jax
import jax.numpy as jnp
import numpy as np

from icjax.contact import ContactProblem, contact_frame

KINDS = ("random", "planar", "normal", "face", "duplicated")


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


def grasp(seed: int, slots: int, kind: str = "random", live: int | None = None) -> ContactProblem:
    """Fingers of compliance 0.1 to 2 rad/Nm on an object of 12 g to 1 kg, steps of 2 to 10 ms; some slots masked.

    `planar`: no motion or normal out of a plane, so tangential forces lie along a facet. `normal`: no tangential
    motion. `face`: parallel normals and no finger compliance, so that W is singular. `duplicated`: one contact many
    times. Gaps are positive, zero or negative (penetration) and friction may be zero.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    singular = kind in ("face", "duplicated")
    normal = rng.normal(size=(slots, 3))
    arm = 0.03 * rng.normal(size=(slots, 3))
    free = 1e-3 * rng.normal(size=(slots, 3))
    friction = rng.choice([0.0, 0.3, 0.8, 1.2], size=slots)
    gap = rng.choice([0.0, 0.0, 1.0, -1.0], size=slots) * rng.uniform(0, 1e-3, slots)
    if kind == "planar":
        normal[:, 1], arm[:, 1], free[:, 1] = 0.0, 0.0, 0.0
    if kind == "face":
        normal[:], gap[:], free[:, 2] = [0.0, 0.0, 1.0], 0.0, -np.abs(free[:, 2])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    if kind == "normal":
        free = normal * free[:, :1]
    if kind == "duplicated":
        normal[:], arm[:], friction[:], gap[:] = normal[:1], arm[:1], friction[0], 0.0
    frames = np.asarray(jax.vmap(contact_frame)(jnp.asarray(normal)))
    mass, step = rng.uniform(0.012, 1.0), rng.uniform(2e-3, 1e-2)
    lever = np.concatenate([np.block([[_lever(r), np.eye(3)]]) for r in arm])
    coupling = step**2 * (lever / np.repeat([4e-4 * mass, mass], 3)) @ lever.T
    for i in range(0 if singular else slots):
        jacobian = 0.06 * rng.normal(size=(3, 4))
        if kind == "planar":
            jacobian[1], jacobian[:, 3] = 0.0, [0.0, 0.02, 0.0]
        block = slice(3 * i, 3 * i + 3)
        coupling[block, block] += (jacobian * rng.uniform(0.1, 2.0, 4)) @ jacobian.T
    live = slots if live is None else live
    active = rng.permutation(np.arange(slots) < live)
    return ContactProblem(coupling, free.reshape(-1), gap, frames, friction, active)


def _lever(r):
    """Velocity of a point from the angular velocity: -[r]."""
    return -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
