"""Subject and plate as one MuJoCo model."""

import math

import numpy as np

from icjax.laboratory._mujoco import MjModel, mujoco
from icjax.laboratory._subject import JOINTS, POSTURE, Subject
from icjax.laboratory._surface import PLATE_MARKERS, SENSOR_DEPTH, SENSOR_ROTATION, Surface

TIMESTEP = 0.00025
"""Step of the simulation, s."""

DRIVEN = ("forearm_x", "forearm_z", "forearm_pitch", *JOINTS)
"""Coordinates that the subject commands, in this order; the plate follows passively."""

BASE_STIFFNESS = (20000.0, 20000.0, 400.0)
"""Of the forearm on its rest: N/m, N/m, Nm/rad."""

BASE_DAMPING = (220.0, 220.0, 3.0)

PLATE_MASS = 0.050
MOUNT_MASS = 0.250
MOUNT_FREQUENCY = 350.0
MOUNT_DAMPING_RATIO = 0.03


def forearm_origin(subject: Subject) -> np.ndarray:
    """World position of the wrist at which the resting fingertip just touches z = 0 at x = 0, m."""
    x, z = subject.pad_position(np.asarray(POSTURE))
    return np.array([-x, 0.0, subject.pad_radius - z])


def build(subject: Subject, surface: Surface, markers: dict[str, tuple[str, np.ndarray]]) -> MjModel:
    """The MuJoCo model; `markers` are sites on the bodies of the subject, the plate's own are added."""
    return mujoco.MjModel.from_xml_string(xml(subject, surface, markers))


def xml(subject: Subject, surface: Surface, markers: dict[str, tuple[str, np.ndarray]]) -> str:
    """MJCF text of the subject over the plate."""
    sites: dict[str, str] = {}
    for label, (body, position) in markers.items():
        sites[body] = sites.get(body, "") + f'<site name="{label}" pos="{row(position)}"/>'
    plate_sites = "".join(f'<site name="{label}" pos="{row(position)}"/>' for label, position in PLATE_MARKERS.items())
    hand, proximal, middle, distal = subject.lengths
    scale = subject.hand_length / 0.19
    stiffness = 1.0 / np.asarray(subject.compliance)
    spring = [
        f'axis="0 1 0" stiffness="{k:.17g}" damping="{b:.17g}"' for k, b in zip(stiffness, subject.damping, strict=True)
    ]
    mount = (2.0 * math.pi * MOUNT_FREQUENCY) ** 2 * (PLATE_MASS + MOUNT_MASS)
    mount_damping = 2.0 * MOUNT_DAMPING_RATIO * math.sqrt(mount * (PLATE_MASS + MOUNT_MASS))
    sag = 9.81 * (PLATE_MASS + MOUNT_MASS) / mount
    return f"""
<mujoco model="virtual capture studio">
  <compiler angle="radian" inertiafromgeom="auto"/>
  <option timestep="{TIMESTEP}" integrator="implicitfast" gravity="0 0 -9.81"/>
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
        <site name="sensor" pos="0 0 {-SENSOR_DEPTH}" quat="{row(quaternion(SENSOR_ROTATION))}"/>
        {plate_sites}
      </body>
    </body>
    <body name="forearm" pos="{row(forearm_origin(subject))}">
      <joint name="forearm_x" type="slide" axis="1 0 0" stiffness="{BASE_STIFFNESS[0]}" damping="{BASE_DAMPING[0]}"/>
      <joint name="forearm_z" type="slide" axis="0 0 1" stiffness="{BASE_STIFFNESS[1]}" damping="{BASE_DAMPING[1]}"/>
      <joint name="forearm_pitch" type="hinge" axis="0 1 0" pos="-0.2 0 0"
             stiffness="{BASE_STIFFNESS[2]}" damping="{BASE_DAMPING[2]}"/>
      <geom type="capsule" fromto="-0.22 0 0 -0.03 0 0" size="0.03" mass="1.2"/>
      {sites.get("forearm", "")}
      <body name="hand">
        <joint name="wrist" {spring[0]}/>
        <geom type="box" size="{hand * 0.55:.6g} {0.04 * scale:.6g} {0.0125 * scale:.6g}"
              pos="{hand * 0.68:.6g} 0.012 0" mass="{0.36 * scale**3:.6g}"/>
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
              <site name="pad" pos="{row(subject.pad_offset)}"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor>
    <force name="force" site="sensor"/>
    <torque name="torque" site="sensor"/>
  </sensor>
</mujoco>
"""


def row(values) -> str:
    """Numbers of an MJCF attribute, exactly."""
    return " ".join(f"{float(value):.17g}" for value in values)


def quaternion(rotation: np.ndarray) -> np.ndarray:
    """Of a rotation matrix, w first."""
    result = np.zeros(4)
    mujoco.mju_mat2Quat(result, rotation.reshape(-1).astype(float))
    return result
