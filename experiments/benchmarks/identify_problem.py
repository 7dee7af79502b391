"""The press as problems of icjax: what its model predicts, and the residuals that are minimised."""

import identify_scene as press
import numpy as np

SETTLING = 3
"""Contact problems until a sample rests."""


def finger():
    """Model without joint limits, scene, nominal stiffnesses, and the MJCF text that MuJoCo reads."""
    import dataclasses

    import jax

    from icjax.geometry import Plane
    from icjax.model import index_finger
    from icjax.model._index_finger import _mjcf
    from icjax.synthesis import Scene, Surface

    jax.config.update("jax_enable_x64", True)
    model = index_finger(root="fixed")
    nominal = 1.0 / np.asarray(model.compliance)
    model = dataclasses.replace(model, lower=np.full(4, -np.inf), upper=np.full(4, np.inf))
    plane = Plane(np.array([0.0, 0.0, press.PLANE]), np.array([0.0, 0.0, 1.0]))
    return model, Scene("press", (Surface("plane", plane, 0.0),), facets=2), nominal, _mjcf(0.19, "fixed")


def predictions(model, scene, repeats: int):
    """Two functions of stiffness, reference `[sample, 4]` and angles to start from: sample by sample, and one press."""
    import jax
    import jax.numpy as jnp

    from icjax.synthesis import Target, init, rollout

    def pressed(stiffness, reference, state=None):
        info = rollout(model, scene, Target(reference, jnp.broadcast_to(1.0 / stiffness, reference.shape)), state)[1]
        return jnp.concatenate([info.q, info.contact_force[:, 0, 2:]], axis=1)

    def static(stiffness, reference, angles):
        def one(reference, angles):
            rows = jnp.broadcast_to(reference, (SETTLING, 4))
            return pressed(stiffness, rows, init(model, scene, angles))[-1]

        return jax.vmap(one)(reference, angles)

    def whole(stiffness, reference, angles):
        return pressed(stiffness, jnp.repeat(reference, repeats, axis=0))[repeats - 1 :: repeats]

    return static, whole


def problem(kind: str):
    """The identification as an `icjax.fit.Problem`, and the nominal stiffnesses; see `identify.py` for the kinds."""
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    from icjax.fit import Parameter, Parameters, Problem
    from icjax.inference import Log

    model, scene, nominal, mjcf = finger()
    parameters = Parameters((Parameter("stiffness", nominal, "Nm/rad", Log()),))
    if kind == "measured":
        return Problem(parameters, (admittance(model, press.measured(mjcf)),)), nominal
    predicted = predictions(model, scene, 2)[("static", "rollout").index(kind)]

    class Press(eqx.Module):
        data: jax.Array
        reference: jax.Array
        name: str = eqx.field(static=True, default="press")
        uses: tuple[str, ...] = eqx.field(static=True, default=("stiffness",))

        def residual(self, values):
            found = predicted(values["stiffness"], self.reference, self.data[:, :4])
            return jnp.ravel((self.data - found) / press.deviations()[None])

    measured = Press(jnp.asarray(press.measured(mjcf)), jnp.asarray(press.reference(press.sample_times())))
    return Problem(parameters, (measured,)), nominal


def admittance(model, data: np.ndarray):
    """theta = theta_r + J^T f / k of every sample, J at its measured angles and f its measured force, upwards.

    A plane without friction pushes a sphere along the line through its centre, so that J is that of the centre.
    """
    import equinox as eqx
    import jax
    import jax.numpy as jnp

    from icjax.fit import StaticEquilibrium
    from icjax.model import pad_positions, point_jacobian

    def torque(q, f):
        J = point_jacobian(model, q, model.pad_bodies[0], pad_positions(model, q)[0])
        return f * J[2]

    angles, times = data[:, :4], press.sample_times()
    torques = np.asarray(jax.vmap(torque)(jnp.asarray(angles), jnp.asarray(data[:, 4])))
    stated = StaticEquilibrium(
        "press", times, angles, torques, press.NOISE_ANGLE, uses=("compliance",), nominal=press.reference(times)
    )

    class Admittance(eqx.Module):
        equilibrium: StaticEquilibrium
        name: str = eqx.field(static=True, default="press")
        uses: tuple[str, ...] = eqx.field(static=True, default=("stiffness",))

        def residual(self, values):
            return self.equilibrium.residual({"compliance": 1.0 / values["stiffness"]})

    return Admittance(stated)
