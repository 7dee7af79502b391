"""What a probe would do: force of a compliant finger that moves against a rigid plane, and errors of its angles."""

from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import root_scalar

from icjax.capture import lowpass
from icjax.estimation import torque_derivatives
from icjax.fit._probe import PAD_STIFFNESS, Instruments, Probe
from icjax.model import Model, frames, jacobian_at, site_positions
from icjax.typing import Float, Real

LONGEST_STEP = 0.25e-3
"""s, of the simulated contact; the distal segment on its pad swings at about 500 rad/s."""


class Touch(NamedTuple):
    """Where a probe touches: `body`, the `jacobian` [3, dof] of the point there, `stiffness` N/m of the pad.

    `by_unit` [3, dof, offset]: derivative of the torque of a unit force along each world axis by offsets of all
    coordinates, then by the place of the force.
    """

    body: int
    jacobian: Float[np.ndarray, "3 dof"]
    stiffness: float
    by_unit: Float[np.ndarray, "3 dof offset"]


def touch_of(model: Model, dofs: tuple[int, ...], probe: Probe) -> Touch:
    """Jacobian and pad of a probe; a pad touches with its surface, a capsule with that about its middle."""
    q, columns, normal = np.asarray(probe.q), list(dofs), np.asarray(probe.normal)
    stiffness = PAD_STIFFNESS
    if probe.contact in model.pad_names:
        pad = model.pad(probe.contact)
        body, place, radius = model.pad_bodies[pad], model.pad_centre[pad], float(np.asarray(model.pad_radius)[pad])
        compliance = float(np.asarray(model.pad_compliance)[pad])
        stiffness = 1.0 / compliance if compliance > 0 else PAD_STIFFNESS
    else:
        body, place, radius = model.body(probe.contact), np.asarray(probe.point), 0.0
    J, by_unit = _touch(model, body, jnp.asarray(q), jnp.asarray(place), jnp.asarray(radius * normal))
    return Touch(body, np.asarray(J)[:, columns], probe.pad_stiffness or stiffness, np.asarray(by_unit)[:, columns, :])


@eqx.filter_jit
def _touch(model, body, q, place, back):
    state = frames(model, q)
    point = state.bodies(model, np.array([body]))[0].apply(place) - back
    nothing, on = jnp.zeros((1, 3)), jnp.ones(1, bool)

    def by(force):
        D, _, P = torque_derivatives(model, (body,), q, force[None], point[None], nothing, on)
        return jnp.concatenate([D, P.reshape(P.shape[0], -1)], axis=1)

    return jacobian_at(model, state, body, point), jax.vmap(by)(jnp.eye(3))


def intended(probe: Probe, time: Float[np.ndarray, " time"]) -> tuple[np.ndarray, np.ndarray]:
    """How far below the surface the intended movement is at times after it passed it (m), and how fast it goes (m/s).

    Constant speed, or least jerk from `hover` above the surface to `depth` below it: 10 u^3 - 15 u^4 + 6 u^5 of the way
    at the fraction u of the time (Flash and Hogan 1985).
    """
    if not np.isfinite(probe.depth):
        return probe.speed * time, np.full_like(time, probe.speed)
    way = probe.hover + probe.depth
    at = root_scalar(lambda u: u**3 * (10 - 15 * u + 6 * u**2) - probe.hover / way, bracket=(0.0, 1.0)).root
    long = 30 * at**2 * (1 - at) ** 2 * way / probe.speed
    u = np.clip(at + time / long, 0.0, 1.0)
    return way * u**3 * (10 - 15 * u + 6 * u**2) - probe.hover, way * 30 * u**2 * (1 - u) ** 2 / long


def movement(probe: Probe, touch: Touch, compliance: np.ndarray) -> Float[np.ndarray, " dof"]:
    """Joint velocities of the intended movement while it goes by 1 m/s against the normal: the least of those that move
    the point so, in the sense of sum v_i^2 / C_i, as soft joints move most."""
    J = touch.jacobian
    loaded = compliance[:, None] * J.T
    return loaded @ np.linalg.pinv(J @ loaded, rcond=1e-9) @ (_slide(probe) / probe.speed - np.asarray(probe.normal))


def _slide(probe: Probe) -> np.ndarray:
    normal, slide = np.asarray(probe.normal), np.asarray(probe.slide)
    return slide - normal * (normal @ slide)


def contact_force(
    probe: Probe,
    touch: Touch,
    inertia: tuple[np.ndarray, np.ndarray, np.ndarray],
    compliance: Float[np.ndarray, " dof"],
    damping_time: float,
    frames: int,
    step: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Force on the finger [frame, 3] (N) from the first touch on, and the deviation [frame, dof] (rad) that it causes.

        M e'' + (N + B) e' + (G + K) e = J^T f,   f_n = k max(0, d(t) - n . J e),   f_t = -k s,  norm(f_t) <= mu f_n

    with d the depth of the intended movement and s how far the skin is stretched since it last stuck. J and the inertia
    are those at the first touch. Implicit midpoint rule, the force at the explicit midpoint.

    **Arguments**: `inertia` G, N and M (armature included) [dof, dof]; `frames` of `step` s.

    **Errors**: `ValueError` for a pad on which the tip would swing faster than the steps can follow.

    Source of the law of friction: Cundall and Strack 1979.
    """
    J, normal = touch.jacobian, np.asarray(probe.normal)
    G, N, M = inertia
    parts = int(np.ceil(step / LONGEST_STEP))
    h = step / parts
    stiffest = 1.0 / (LONGEST_STEP**2 * np.linalg.norm(J @ np.linalg.solve(M, J.T), 2))
    if touch.stiffness > stiffest:
        raise ValueError(
            f"probe {probe.name!r}: pad_stiffness = {touch.stiffness:.3g} N/m: its contact can be simulated up to "
            f"{stiffest:.2g}, which is rigid as far as joints can tell"
        )
    depth, speed = intended(probe, (np.arange(parts * frames) + 0.5) * h)
    K = np.diag(1.0 / compliance)
    S, D = G + K, N + damping_time * K
    inverse = np.linalg.inv(M + 0.5 * h * D + 0.25 * h**2 * S)
    slide = speed[:, None] / probe.speed * _slide(probe)
    e, v, stretch, last = np.zeros(len(K)), np.zeros(len(K)), np.zeros(3), np.zeros(3)
    force, deviation = np.zeros((frames, 3)), np.zeros((frames, len(K)))
    for count in range(parts * frames):
        if count % parts == 0:
            deviation[count // parts], force[count // parts] = e, last
        moved, rate = J @ (e + 0.5 * h * v), J @ v
        pressed = touch.stiffness * max(0.0, float(depth[count] - normal @ moved))
        stretch = stretch + h * (slide[count] + rate - normal * (normal @ rate))
        pulled = touch.stiffness * np.linalg.norm(stretch)
        if pulled > probe.friction * pressed:
            stretch = stretch * (probe.friction * pressed / pulled)
        last = pressed * normal - touch.stiffness * stretch
        a = inverse @ (J.T @ last - D @ v - S @ (e + 0.5 * h * v))
        e, v = e + h * (v + 0.5 * h * a), v + h * a
    return force, deviation


def smooth_force(force: np.ndarray, before: int, after: int, instruments: Instruments) -> tuple[np.ndarray, np.ndarray]:
    """The force [before + after + 1, 3] as it would be filtered with the markers, and its rate, N/s."""
    whole = np.concatenate([np.zeros((before, 3)), force])
    smooth = lowpass(whole, instruments.rate, instruments.cutoff)
    return smooth[: before + after + 1], np.gradient(smooth, 1.0 / instruments.rate, axis=0)[: before + after + 1]


def angle_errors(model: Model, q: Float[Real, " nq"], instruments: Instruments) -> tuple[np.ndarray, np.ndarray]:
    """Covariances [nv, nv] of all coordinates: from frame to frame before the filter, and of what is wrong always.

    **Errors**: `ValueError` where the marker sites do not determine a coordinate and no `angle_sd` is given.
    """
    eye = np.eye(model.nv)
    if instruments.angle_sd is not None and instruments.offset_sd is not None:
        return instruments.angle_sd**2 * eye, instruments.offset_sd**2 * eye
    J = np.asarray(_sites(model, jnp.asarray(q))).reshape(-1, model.nv)
    values, vectors = np.linalg.eigh(J.T @ J)
    if not values[0] > 1e-9 * max(values[-1], 1e-12):
        worst = model.dof_names[int(np.argmax(np.abs(vectors[:, 0])))]
        raise ValueError(f"the marker sites of the model do not determine {worst!r}; state angle_sd and offset_sd")
    inverse = (vectors / values) @ vectors.T
    return instruments.marker_sd**2 * inverse, instruments.placement_sd**2 * inverse


@eqx.filter_jit
def _sites(model, q):
    state, bodies = frames(model, q), np.asarray(model.site_bodies, int)
    return jax.vmap(partial(jacobian_at, model, state))(bodies, site_positions(model, q))


def filter_power(instruments: Instruments, lags: int) -> tuple[float, np.ndarray]:
    """Share of the variance of white noise that passes the filter, and its autocorrelation [lag], lag in frames."""
    count = 8 * max(lags, round(instruments.rate / instruments.cutoff))
    impulse = np.zeros(2 * count)
    impulse[count] = 1.0
    power = np.fft.irfft(np.abs(np.fft.rfft(lowpass(impulse, instruments.rate, instruments.cutoff))) ** 2)
    return float(power[0]), power[:lags] / power[0]
