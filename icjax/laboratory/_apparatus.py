"""Subject and plate as one MuJoCo model."""

import math

import mujoco
import numpy as np

from icjax.laboratory._subject import JOINTS, POSTURE, Subject
from icjax.laboratory._surface import PLATE_MARKERS, SENSOR_DEPTH, SENSOR_ROTATION, Surface

TIMESTEP = 0.00025
"""Step of the simulation, s."""

DRIVEN = ("forearm_x", "forearm_z", "forearm_pitch", *JOINTS)
"""Coordinates that the subject commands, in this order; the pad and the plate follow passively."""

BASE_STIFFNESS = (20000.0, 20000.0, 400.0)
"""Of the forearm on its rest: N/m, N/m, Nm/rad."""

BASE_DAMPING = (220.0, 220.0, 3.0)

PLATE_MASS = 0.050
MOUNT_MASS = 0.250
MOUNT_FREQUENCY = 350.0
MOUNT_DAMPING_RATIO = 0.03
PAD_MASS = 0.0005
PAD_DAMPING = 1.0
CONTACT_TIME = 0.001
IMPEDANCE = 0.99
SLIP_RATE = 100.0
"""1/s, the rate at which friction is asked to stop slip. MuJoCo's convex contact lifts a sliding body by about
mu SLIP_RATE slip_speed CONTACT_TIME^2: a large value makes the fingertip hop, a small one makes it creep while it
sticks (prevented by a large impratio: 0.06 mm/s at 2 N)."""


def forearm_origin(subject: Subject) -> np.ndarray:
    """World position of the wrist at which the resting fingertip just touches z = 0 at x = 0, m."""
    x, z = subject.pad_position(np.asarray(POSTURE))
    return np.array([-x, 0.0, subject.pad_radius - z])


def build(subject: Subject, surface: Surface, markers: dict[str, tuple[str, np.ndarray]]) -> mujoco.MjModel:
    """The MuJoCo model; `markers` are sites on the bodies of the subject, the plate's own are added."""
    return mujoco.MjModel.from_xml_string(xml(subject, surface, markers))


def contact_stiffness() -> float:
    """Static stiffness of MuJoCo's soft contact between pad and plate, N/m.

    A constraint at rest obeys R f = k r with k = 1 / (d t)^2 and R = (1 - d) / d * A, where A is the inverse
    mass of the pad (the plate and the mount are hundreds of times heavier; MuJoCo documentation, "Solver
    parameters").
    """
    regularisation = (1.0 - IMPEDANCE) / IMPEDANCE / PAD_MASS
    return 1.0 / (IMPEDANCE * CONTACT_TIME) ** 2 / regularisation


def xml(subject: Subject, surface: Surface, markers: dict[str, tuple[str, np.ndarray]]) -> str:
    """MJCF text of the subject over the plate."""
    sites: dict[str, str] = {}
    for label, (body, position) in markers.items():
        sites[body] = sites.get(body, "") + f'<site name="{label}" pos="{_row(position)}"/>'
    plate_sites = "".join(f'<site name="{label}" pos="{_row(position)}"/>' for label, position in PLATE_MARKERS.items())
    hand, proximal, middle, distal = subject.lengths
    scale = subject.hand_length / 0.19
    stiffness = 1.0 / np.asarray(subject.compliance)
    spring = [
        f'axis="0 1 0" stiffness="{k:.17g}" damping="{b:.17g}"' for k, b in zip(stiffness, subject.damping, strict=True)
    ]
    pad_spring = 1.0 / (1.0 / subject.pad_stiffness - 1.0 / contact_stiffness())
    mount = (2.0 * math.pi * MOUNT_FREQUENCY) ** 2 * (PLATE_MASS + MOUNT_MASS)
    mount_damping = 2.0 * MOUNT_DAMPING_RATIO * math.sqrt(mount * (PLATE_MASS + MOUNT_MASS))
    sag = 9.81 * (PLATE_MASS + MOUNT_MASS) / mount
    bump_geom, bump_pair = "", ""
    if surface.bump is not None:
        centre = np.asarray(surface.bump.centre) - np.array([0.0, 0.0, surface.height])
        bump_geom = f'<geom name="bump" type="ellipsoid" size="{_row(surface.bump.radii)}" pos="{_row(centre)}"/>'
        bump_pair = _pair("bump", surface.friction)
    return f"""
<mujoco model="virtual capture studio">
  <compiler angle="radian" inertiafromgeom="auto"/>
  <option timestep="{TIMESTEP}" integrator="implicitfast" cone="elliptic" impratio="2000" solver="Newton"
          iterations="60" tolerance="1e-12" ccd_tolerance="1e-9" gravity="0 0 -9.81"/>
  <default><geom contype="0" conaffinity="0" density="1100"/></default>
  <worldbody>
    <body name="mount" pos="0 0 {surface.top:.17g}">
      <inertial pos="0 0 -0.05" mass="{MOUNT_MASS}" diaginertia="0.001 0.001 0.001"/>
      <joint name="mount_x" type="slide" axis="1 0 0" stiffness="{mount:.17g}" damping="{mount_damping:.17g}"/>
      <joint name="mount_y" type="slide" axis="0 1 0" stiffness="{mount:.17g}" damping="{mount_damping:.17g}"/>
      <joint name="mount_z" type="slide" axis="0 0 1" stiffness="{mount:.17g}" damping="{mount_damping:.17g}"
             springref="{sag:.17g}"/>
      <body name="plate">
        <geom name="plate" type="box" size="0.3 0.1 0.004" pos="0 0 -0.004" mass="{PLATE_MASS}"/>
        {bump_geom.replace("/>", ' mass="0"/>')}
        <site name="sensor" pos="0 0 {-SENSOR_DEPTH}" quat="{_row(_quaternion(SENSOR_ROTATION))}"/>
        {plate_sites}
      </body>
    </body>
    <body name="forearm" pos="{_row(forearm_origin(subject))}">
      <joint name="forearm_x" type="slide" axis="1 0 0" stiffness="{BASE_STIFFNESS[0]}" damping="{BASE_DAMPING[0]}"/>
      <joint name="forearm_z" type="slide" axis="0 0 1" stiffness="{BASE_STIFFNESS[1]}" damping="{BASE_DAMPING[1]}"/>
      <joint name="forearm_pitch" type="hinge" axis="0 1 0" pos="-0.2 0 0"
             stiffness="{BASE_STIFFNESS[2]}" damping="{BASE_DAMPING[2]}"/>
      <geom type="capsule" fromto="-0.22 0 0 -0.03 0 0" size="0.03" mass="1.2"/>
      {sites.get("forearm", "")}
      <body name="hand">
        <joint name="wrist" {spring[0]}/>
        <geom type="box" size="{hand * 0.55:.6g} {0.04 * scale:.6g} {0.0125 * scale:.6g}" pos="{hand * 0.68:.6g} 0.012 0"
              mass="{0.36 * scale**3:.6g}"/>
        {sites.get("hand", "")}
        <body name="proximal" pos="{hand:.17g} 0 0">
          <joint name="MP" {spring[1]}/>
          <geom type="capsule" fromto="0.004 0 0 {proximal - 0.004:.6g} 0 0" size="{0.0098 * scale:.6g}"/>
          {sites.get("proximal", "")}
          <body name="middle" pos="{proximal:.17g} 0 0">
            <joint name="PIP" {spring[2]}/>
            <geom type="capsule" fromto="0.003 0 0 {middle - 0.003:.6g} 0 0" size="{0.0082 * scale:.6g}"/>
            {sites.get("middle", "")}
            <body name="distal" pos="{middle:.17g} 0 0">
              <joint name="DIP" {spring[3]}/>
              <geom type="capsule" fromto="0.002 0 0 {distal - 0.004:.6g} 0 0" size="{0.007 * scale:.6g}"/>
              {sites.get("distal", "")}
              <body name="pad" pos="{_row(subject.pad_offset)}" gravcomp="1">
                <inertial pos="0 0 0" mass="{PAD_MASS}" diaginertia="1e-8 1e-8 1e-8"/>
                <joint name="pad_x" type="slide" axis="1 0 0" stiffness="{pad_spring:.17g}" damping="{PAD_DAMPING}"/>
                <joint name="pad_z" type="slide" axis="0 0 1" stiffness="{pad_spring:.17g}" damping="{PAD_DAMPING}"/>
                <geom name="pad" type="sphere" size="{subject.pad_radius}" mass="0"/>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <contact>{_pair("plate", surface.friction)}{bump_pair}</contact>
  <sensor>
    <force name="force" site="sensor"/>
    <torque name="torque" site="sensor"/>
    <contact name="contact" body1="plate" body2="pad" num="1" reduce="netforce" data="force pos"/>
  </sensor>
</mujoco>
"""


def _pair(geom: str, friction: float) -> str:
    impedance = f"{IMPEDANCE} {IMPEDANCE} 0.001"
    return (
        f'<pair geom1="{geom}" geom2="pad" condim="3" friction="{max(friction, 1e-5)} {max(friction, 1e-5)} 0 0 0" '
        f'solref="{CONTACT_TIME} 1" solreffriction="-1 -{SLIP_RATE}" solimp="{impedance}"/>'
    )


def _row(values) -> str:
    return " ".join(f"{float(value):.17g}" for value in values)


def _quaternion(rotation: np.ndarray) -> np.ndarray:
    result = np.zeros(4)
    mujoco.mju_mat2Quat(result, rotation.reshape(-1).astype(float))
    return result
