"""Random contact problems: what solvers are tested and measured on."""

import jax
import numpy as np

from icjax.contact._frame import contact_frame
from icjax.contact._problem import ContactProblem

FAMILIES = (
    "random",
    "planar",
    "normal",
    "face",
    "duplicated",
    "pairs",
    "penetrating",
    "touching",
    "frictionless",
)
"""What `random_grasp` makes. All but `face`, `duplicated` and `pairs` have a positive definite W; every one is solvable
(documentation, "The contact problem")."""


def random_grasp(seed: int, contacts: int, family: str = "random", active: int | None = None) -> ContactProblem:
    """A rigid object of 12 g to 1 kg held by fingers of compliance 0.1 to 2 rad/Nm, in a step of 2 to 10 ms.

    Gaps are positive, zero or negative (penetration), friction 0 to 1.2, some of it zero. The families:

    - `random`; `penetrating`, `touching`, `frictionless`: all gaps negative, all zero, no friction.
    - `planar`: no motion or normal out of a plane, so that tangential forces lie along a facet.
    - `normal`: no tangential motion, so that no contact has a preferred tangent.
    - `face`: parallel normals; `duplicated`: one contact many times; `pairs`: contacts on two opposite faces of a
      moving object. In these the fingers are rigid and gaps zero, so that W has the rank of the object's motion.

    **Arguments**: `seed` of NumPy's generator; `contacts` N, slots; `family` of `FAMILIES`; `active` slots, the others
    are masked, default all.

    **Errors**: `ValueError` for an unknown family.
    """
    if family not in FAMILIES:
        raise ValueError(f"family must be one of {', '.join(FAMILIES)}; got {family!r}")
    rng = np.random.default_rng([seed, FAMILIES.index(family)])
    singular = family in ("face", "duplicated", "pairs")
    normal = rng.normal(size=(contacts, 3))
    arm = 0.03 * rng.normal(size=(contacts, 3))
    free = 1e-3 * rng.normal(size=(contacts, 3))
    friction = rng.choice([0.0, 0.3, 0.8, 1.2], size=contacts)
    gap = rng.choice([0.0, 0.0, 1.0, -1.0], size=contacts) * rng.uniform(0, 1e-3, contacts)
    if family == "planar":
        normal[:, 1], arm[:, 1], free[:, 1] = 0.0, 0.0, 0.0
    if family == "face":
        normal[:], gap[:], free[:, 2] = [0.0, 0.0, 1.0], 0.0, -np.abs(free[:, 2])
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    if family == "normal":
        free = normal * free[:, :1]
    if family == "duplicated":
        normal[:], arm[:], friction[:], gap[:] = normal[:1], arm[:1], friction[0], 0.0
    if family == "pairs":
        side = np.where(np.arange(contacts) % 2, 1.0, -1.0)
        normal[:], gap[:] = side[:, None] * np.array([0.0, 0.0, 1.0])[None], 0.0
        arm[:, 2] = -0.02 * side
        free = 1e-3 * rng.normal(size=3)[None] + np.cross(0.03 * rng.normal(size=3)[None], arm)
    if family == "penetrating":
        gap = -rng.uniform(1e-5, 1e-3, contacts)
    if family == "touching":
        gap[:] = 0.0
    if family == "frictionless":
        friction[:] = 0.0
    frames = np.asarray(_frames(normal))
    mass, step = rng.uniform(0.012, 1.0), rng.uniform(2e-3, 1e-2)
    lever = np.concatenate([np.block([[_lever(r), np.eye(3)]]) for r in arm])
    coupling = step**2 * (lever / np.repeat([4e-4 * mass, mass], 3)) @ lever.T
    for i in range(0 if singular else contacts):
        jacobian = 0.06 * rng.normal(size=(3, 4))
        if family == "planar":
            jacobian[1], jacobian[:, 3] = 0.0, [0.0, 0.02, 0.0]
        block = slice(3 * i, 3 * i + 3)
        coupling[block, block] += (jacobian * rng.uniform(0.1, 2.0, 4)) @ jacobian.T
    live = rng.permutation(np.arange(contacts) < (contacts if active is None else active))
    return ContactProblem(coupling, free.reshape(-1), gap, frames, friction, live)


_frames = jax.jit(jax.vmap(contact_frame))


def _lever(r: np.ndarray) -> np.ndarray:
    """Velocity of a point from the angular velocity: -[r]."""
    return -np.array([[0, -r[2], r[1]], [r[2], 0, -r[0]], [-r[1], r[0], 0]])
