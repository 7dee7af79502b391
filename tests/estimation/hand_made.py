"""Recordings whose answer is known: a planar chain of hinges, loaded so that Eq. 1 holds exactly."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model, neutral, point_jacobian, site_positions, world_jacobian
from icjax.recording import ContactEvents, Recording, SensorChannels, Session

LENGTHS = (0.05, 0.03, 0.02)
COMPLIANCE = (0.99, 0.67, 2.0)


def chain(lengths=LENGTHS, compliance=COMPLIANCE, kind="hinge", branches=1) -> Model:
    """Links along +x, hinges about +y, a pad and a site at the tip; `branches` such fingers on one base."""
    count = len(lengths)
    bodies, parents, positions = ["world"], [-1], [np.zeros(3)]
    joints, joint_bodies, sites = [], [], []
    for branch in range(branches):
        suffix = "" if branches == 1 else f"_{branch}"
        for link in range(count):
            parents.append(len(bodies) - 1 if link else 0)
            positions.append(np.array([lengths[link - 1] if link else 0.0, 0.1 * branch * (link == 0), 0.0]))
            joint_bodies.append(len(bodies))
            bodies.append(f"link{link}{suffix}")
            joints.append(f"joint{link}{suffix}")
        sites.append(len(bodies) - 1)
    total = len(joints)
    coordinates = total * (4 if kind == "ball" else 1)
    dofs = total * (3 if kind == "ball" else 1)
    zero = np.tile([1.0, 0.0, 0.0, 0.0], total) if kind == "ball" else np.zeros(coordinates)
    tip = np.tile([lengths[-1], 0.0, 0.0], (branches, 1))
    return Model(
        name="chain",
        body_names=tuple(bodies),
        body_parents=tuple(parents),
        joint_names=tuple(joints),
        joint_types=(kind,) * total,
        joint_bodies=tuple(joint_bodies),
        site_names=tuple(f"tip{branch}" for branch in range(branches)),
        site_bodies=tuple(sites),
        pad_names=tuple(f"pad{branch}" for branch in range(branches)),
        pad_bodies=tuple(sites),
        body_position=np.asarray(positions),
        body_rotation=np.tile(np.eye(3), (len(bodies), 1, 1)),
        body_mass=np.full(len(bodies), 0.01),
        body_com=np.zeros((len(bodies), 3)),
        body_inertia=np.tile(1e-6 * np.eye(3), (len(bodies), 1, 1)),
        joint_position=np.zeros((total, 3)),
        joint_axis=np.tile([0.0, 1.0, 0.0], (total, 1)),
        zero=zero,
        rest=zero,
        lower=np.full(coordinates, -np.inf),
        upper=np.full(coordinates, np.inf),
        compliance=np.resize(np.repeat(compliance, dofs // total), dofs),
        damping=np.zeros(dofs),
        armature=np.zeros(dofs),
        site_position=tip,
        pad_centre=tip,
        pad_radius=np.full(branches, 0.008),
        pad_compliance=np.full(branches, 1 / 750),
        gravity=np.array([0.0, 0.0, -9.81]),
    )


def recording(
    model,
    time,
    q,
    force,
    point,
    *,
    moment=None,
    touching=None,
    events=((), (), ()),
    bodies=None,
    name="trial00",
    role="trial",
    catch_of=None,
    valid=None,
    q_sd=0.0,
    offset_sd=0.0,
) -> Recording:
    """A recording with forces `[time, contact, 3]`; events as (onsets, releases, contacts)."""
    frames, contacts = force.shape[:2]
    touching = np.linalg.norm(force, axis=2) > 0 if touching is None else touching
    onset, release, contact = events
    return Recording(
        name=name,
        role=role,
        catch_of=catch_of,
        model=model,
        time=time,
        q=q,
        q_covariance=np.tile(q_sd**2 * np.eye(model.nv), (frames, 1, 1)),
        q_offset_sd=np.full(model.nv, offset_sd),
        valid=np.ones(frames, bool) if valid is None else valid,
        contact_names=tuple(f"plate{i}" for i in range(contacts)),
        contact_bodies=model.pad_names[:contacts] if bodies is None else bodies,
        contact_force=force,
        contact_point=point,
        contact_moment=np.zeros_like(force) if moment is None else moment,
        touching=touching,
        events=ContactEvents(
            onset=np.asarray(onset, float), release=np.asarray(release, float), contact=np.asarray(contact, np.int32)
        ),
        marker_names=(),
        markers=np.zeros((frames, 0, 3)),
        marker_residual=np.zeros((frames, 0)),
        channels=SensorChannels(sensor_names=(), time=np.zeros(0), wrench=np.zeros((0, 0, 6))),
        friction=None,
        provenance="",
    )


def ramps(time, onsets, releases, rates):
    """Torque `[time, joint]` that rises from zero at each onset at `rates` (Nm/s) and is back at its release."""
    tau = np.zeros((len(time), len(rates)))
    for onset, release in zip(onsets, releases, strict=True):
        s = time - onset
        top = 0.75 * (release - onset)
        shape = np.where(s < top, s, top * (release - time) / (release - onset - top))
        tau += np.where((s > 0) & (time < release), shape, 0.0)[:, None] * np.asarray(rates)
    return tau


@eqx.filter_jit
def _wrenches(model, q, tau):
    def frame(q, tau):
        tip = site_positions(model, q)[0]
        body = model.site_bodies[0]
        rows = jnp.concatenate([point_jacobian(model, q, body, tip)[::2], world_jacobian(model, q)[1:2]])
        x, z, m = jnp.linalg.solve(rows.T, tau)
        return tip, jnp.stack([x, 0.0, z]), jnp.stack([0.0, m, 0.0])

    return jax.vmap(frame)(q, tau)


def wrench_for(model, q, tau):
    """Point, force at the tip and free moment about y that give these torques on a planar chain of three hinges."""
    return tuple(np.asarray(value)[:, None, :] for value in _wrenches(model, q, tau))


def pressing(
    model=None,
    *,
    onsets=(0.4, 1.0),
    releases=(0.65, 1.3),
    rates=(0.3, 0.2, 0.06),
    compliance=COMPLIANCE,
    later=None,
    start=(0.3, 0.5, 0.4),
    speed=(0.4, -0.2, 0.3),
    bend=(0.0, 0.0, 0.0),
    rate=500.0,
    angle_noise=0.0,
    torque_noise=0.0,
    seed=0,
    **other,
):
    """A chain that moves at constant speed (plus `bend` times s^2 / 2 from t = 0) and meets linear springs.

    Returns the recording, its reference angles and its torques. By construction theta = theta_r + C tau, with
    the compliance `later` from the second onset on.
    """
    model = chain() if model is None else model
    time = np.arange(801) / rate
    tau = ramps(time, onsets, releases, rates)
    reference = np.asarray(start) + time[:, None] * np.asarray(speed) + 0.5 * time[:, None] ** 2 * np.asarray(bend)
    law = np.tile(np.asarray(compliance), (len(time), 1))
    if later is not None:
        law[time >= onsets[1]] = later
    q = reference + tau * law
    random = np.random.default_rng(seed)
    touching = np.any(tau != 0, axis=1)
    loaded = tau + torque_noise * random.standard_normal(tau.shape) * touching[:, None]
    point, force, moment = wrench_for(model, q, loaded)
    point = np.where(touching[:, None, None], point, np.nan)
    measured = q + angle_noise * random.standard_normal(q.shape)
    made = recording(
        model,
        time,
        measured,
        force,
        point,
        moment=moment,
        touching=touching[:, None],
        events=(onsets, releases, [0] * len(onsets)),
        **other,
    )
    return made, reference, tau


def session(*recordings) -> Session:
    return Session(name="hand made", subject="nobody", recordings=tuple(recordings))


def home(model):
    return np.asarray(neutral(model))
