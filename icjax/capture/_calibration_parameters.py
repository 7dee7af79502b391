"""What a calibration changes in a model: sizes of segments, axes of hinges, places of markers."""

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from icjax.model import Model
from icjax.spatial import rotation_exp
from icjax.typing import Float, Real


@dataclasses.dataclass(frozen=True)
class CalibrationOptions:
    """What to estimate, and how far from the model it may be before any recording is seen.

    - `trials`: names of the trials whose frames are used.
    - `size`: relative standard deviation of the size of the whole body, common to all segments; None keeps it.
    - `lengths`: relative standard deviation of a single segment about that size; None keeps proportions.
    - `axes`: rad, standard deviation of the tilt of a hinge's axis about either direction across it; None keeps axes.
    - `placement`: whether the places of markers are estimated, with the session's placement_sd.
    - `frames`: number of frames used, spread over the postures of the trials.
    """

    trials: tuple[str, ...]
    size: float | None = None
    lengths: float | None = 0.05
    axes: float | None = 0.05
    placement: bool = True
    frames: int = 300


class Parameters(NamedTuple):
    """The list of parameters z, each counted from the model's own value in units of its prior standard deviation.

    - `names`, `units`, `prior_sd` [parameter].
    - `log_scale` [body, parameter]: logarithm of the scale of each body's segment per unit of z.
    - `tilt` [joint, 3, parameter]: rotation vector (rad, body axes) that tilts each joint's axis.
    - `shift` [site, 3, parameter]: m, of the used sites, in body axes.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    prior_sd: np.ndarray
    log_scale: np.ndarray
    tilt: np.ndarray
    shift: np.ndarray


def segments(model: Model) -> np.ndarray:
    """For every body the first body of the rigid segment that it belongs to: bodies without joints are fixed."""
    moves = set(model.joint_bodies)
    first = np.arange(len(model.body_names))
    for body, parent in enumerate(model.body_parents):
        if body > 0 and body not in moves and parent > 0:
            first[body] = first[parent]
    return first


def calibration_parameters(
    model: Model, sites: tuple[int, ...], placement_sd: float, options: CalibrationOptions
) -> Parameters:
    """The parameters that the options ask for and that can move a used site.

    **Arguments**: `sites` that carry markers; `placement_sd` m, per axis.
    """
    first = segments(model)
    carries = _carries(model, sites)
    entries: list[tuple[str, str, float]] = []
    scale: list[np.ndarray] = []
    tilt: list[np.ndarray] = []
    shift: list[np.ndarray] = []
    zeros = np.zeros(len(first)), np.zeros((len(model.joint_names), 3)), np.zeros((len(sites), 3))

    def add(name: str, unit: str, sd: float, *, bodies=None, joint=None, site=None) -> None:
        s, t, p = (item.copy() for item in zeros)
        if bodies is not None:
            s[bodies] = sd
        if joint is not None:
            t[joint[0]] = sd * joint[1]
        if site is not None:
            p[site[0], site[1]] = sd
        entries.append((name, unit, sd))
        scale.append(s)
        tilt.append(t)
        shift.append(p)

    if options.size is not None:
        add("size", "1", options.size, bodies=np.arange(1, len(first)))
    if options.lengths is not None:
        for segment in np.unique(first[1:]):
            if carries[segment]:
                name = f"length {model.body_names[segment]}"
                add(name, "1", options.lengths, bodies=np.flatnonzero(first == segment))
    if options.axes is not None:
        for joint, kind in enumerate(model.joint_types):
            if kind == "hinge" and carries[model.joint_bodies[joint]]:
                for number, across in enumerate(_across(np.asarray(model.joint_axis)[joint]), start=1):
                    add(f"axis {model.joint_names[joint]} {number}", "rad", options.axes, joint=(joint, across))
    if options.placement:
        for index, site in enumerate(sites):
            for axis in range(3):
                add(f"place {model.site_names[site]} {'xyz'[axis]}", "m", placement_sd, site=(index, axis))
    count = len(entries)
    return Parameters(
        names=tuple(name for name, _, _ in entries),
        units=tuple(unit for _, unit, _ in entries),
        prior_sd=np.array([sd for _, _, sd in entries]),
        log_scale=np.array(scale).reshape(count, *zeros[0].shape).T,
        tilt=np.moveaxis(np.array(tilt).reshape(count, *zeros[1].shape), 0, -1),
        shift=np.moveaxis(np.array(shift).reshape(count, *zeros[2].shape), 0, -1),
    )


def changed_model(model: Model, sites: tuple[int, ...], parameters: Parameters, z: Float[Real, " parameter"]) -> Model:
    """The model with the parameters z. Differentiable in z.

    A segment is scaled with everything on it: origins of the bodies that hang on it, anchors, sites, pads, centres
    of mass; its mass by s^3 and its inertia by s^5. The radius of a pad stays. A scale is exp(z sd). Then used
    sites are shifted, and hinge axes turned by their tilt.
    """
    s = jnp.exp(jnp.asarray(parameters.log_scale) @ z)
    parent = np.maximum(np.asarray(model.body_parents), 0)
    site_bodies, pad_bodies = np.asarray(model.site_bodies, int), np.asarray(model.pad_bodies, int)
    first = segments(model)
    scaling = np.where(parent > 0, parent, 0)  # a body's origin belongs to the segment of its parent
    origin = jnp.where(scaling[:, None] > 0, s[first[scaling]][:, None], 1.0)
    places = s[site_bodies][:, None] * jnp.asarray(model.site_position)
    places = places.at[np.asarray(sites)].add(jnp.asarray(parameters.shift) @ z)
    turns = jax.vmap(rotation_exp)(jnp.asarray(parameters.tilt) @ z)
    return dataclasses.replace(
        model,
        body_position=origin * jnp.asarray(model.body_position),
        body_mass=s**3 * jnp.asarray(model.body_mass),
        body_com=s[:, None] * jnp.asarray(model.body_com),
        body_inertia=s[:, None, None] ** 5 * jnp.asarray(model.body_inertia),
        joint_position=s[np.asarray(model.joint_bodies, int)][:, None] * jnp.asarray(model.joint_position),
        joint_axis=jnp.einsum("jab,jb->ja", turns, jnp.asarray(model.joint_axis)),
        site_position=places,
        pad_centre=s[pad_bodies][:, None] * jnp.asarray(model.pad_centre),
        pad_axis=None if model.pad_axis is None else s[pad_bodies][:, None] * jnp.asarray(model.pad_axis),
    )


def _carries(model: Model, sites: tuple[int, ...]) -> np.ndarray:
    """Which bodies carry a used site themselves or through the bodies that hang on them."""
    carries = np.zeros(len(model.body_names), bool)
    carries[np.asarray(model.site_bodies, int)[list(sites)]] = True
    for body in range(len(carries) - 1, 0, -1):
        carries[model.body_parents[body]] |= carries[body]
    return carries


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors across an axis and each other."""
    away = np.eye(3)[np.argmin(np.abs(axis))]
    one = np.cross(axis, away)
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)
