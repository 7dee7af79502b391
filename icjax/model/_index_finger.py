"""The shipped model: wrist and index finger, scaled by hand length."""

import dataclasses

import numpy as np

from icjax.model._load import load_model
from icjax.model._model import Model

LENGTH_RATIOS = {"hand": 0.463, "proximal": 0.245, "middle": 0.143, "distal": 0.097}
"""Segment lengths of the index ray over hand length: Buchholz, Armstrong and Goldstein 1992."""

EXPLORING_COMPLIANCE = {"wrist": 0.3488, "MP": 0.9882, "PIP": 0.6715, "DIP": 2.0052}
"""rad/Nm, surface exploration: Kry and Pai 2006, Table 1."""

REFERENCE_HAND_LENGTH = 0.19
REFERENCE_MASSES = {"forearm": 1.2, "hand": 0.45, "proximal": 0.020, "middle": 0.011, "distal": 0.006}
"""kg at the reference hand length, typical of an adult; they scale with the cube of the hand length."""

REFERENCE_RADII = {"forearm": 0.040, "hand": 0.030, "proximal": 0.009, "middle": 0.008, "distal": 0.007}
"""m, of the cylinders that the segments' inertias are taken from; hand and forearm far from the finger."""

FOREARM_LENGTH = 0.25
DAMPING_TIME = 0.04
"""s; joint damping is this over the compliance."""


def index_finger(hand_length: float = 0.19, root: str = "free") -> Model:
    """Forearm, hand and index finger moving in one plane: joints wrist, MP, PIP, DIP.

    At zero angles the finger lies straight along +x from the wrist, which is the origin of forearm and hand; hinge
    axes are +y of the parent, so that flexion is positive and lowers the tip. Segments have the lengths of
    Buchholz 1992 times `hand_length` and the inertia of uniform cylinders; sites FA1-3, HA1-4, PP1-3, MP1-3, DP1-3
    lie above the bones where markers are glued, at fixed distances from the joints; the pad "fingertip" is a sphere
    of radius 7.5 mm and compliance 1/750 m/N, 3 mm short of the end of the distal segment. Joint compliances are
    those of surface exploration in Table 1 of Kry and Pai 2006.

    **Arguments**: `hand_length` m, wrist crease to tip of the middle finger; `root` "free" (the forearm floats on
    a free joint named "root", taken as driven: compliance 0) or "fixed" (the forearm stands in the world).

    **Errors**: `ValueError` for a length outside 0.1 to 0.3 m or an unknown root.
    """
    if not 0.1 <= hand_length <= 0.3:
        raise ValueError(f"hand_length is {hand_length} m; it must lie between 0.1 and 0.3 m")
    if root not in ("free", "fixed"):
        raise ValueError(f"root is {root!r}; it must be 'free' or 'fixed'")
    model = load_model(_mjcf(hand_length, root))
    driven = np.zeros(6 if root == "free" else 0)
    compliance = np.concatenate([driven, list(EXPLORING_COMPLIANCE.values())])
    return dataclasses.replace(model, compliance=compliance)


def _mjcf(hand_length: float, root: str) -> str:
    hand, proximal, middle, distal = (ratio * hand_length for ratio in LENGTH_RATIOS.values())
    lengths = {"forearm": FOREARM_LENGTH, "hand": hand, "proximal": proximal, "middle": middle, "distal": distal}
    scale = (hand_length / REFERENCE_HAND_LENGTH) ** 3
    body = {name: _inertial(name, length, scale) for name, length in lengths.items()}
    knuckles = (hand - 0.02, 0.03, 0.019), (hand - 0.012, -0.008, 0.018)
    return f"""
<mujoco model="index_finger">
  <compiler angle="radian"/>
  <worldbody>
    <body name="forearm">
      {'<freejoint name="root"/>' if root == "free" else ""}
      {body["forearm"]}
      {_sites("FA", (-0.16, -0.02, 0.035), (-0.1, 0.025, 0.038), (-0.05, -0.01, 0.036))}
      <body name="hand">
        {_hinge("wrist", -1.2, 1.2)}
        {body["hand"]}
        {_sites("HA", (0.025, -0.012, 0.018), (0.03, 0.035, 0.02), *knuckles)}
        <body name="proximal" pos="{hand} 0 0">
          {_hinge("MP", -0.6, 1.6)}
          {body["proximal"]}
          {_sites("PP", (0.01, -0.005, 0.015), (proximal / 2, 0.008, 0.019), (proximal - 0.01, -0.004, 0.014))}
          <body name="middle" pos="{proximal} 0 0">
            {_hinge("PIP", -0.1, 1.9)}
            {body["middle"]}
            {_sites("MP", (0.005, 0.005, 0.0135), (middle / 2, -0.007, 0.018), (middle - 0.005, 0.005, 0.0125))}
            <body name="distal" pos="{middle} 0 0">
              {_hinge("DIP", -0.3, 1.4)}
              {body["distal"]}
              {_sites("DP", (0.003, -0.005, 0.012), (distal / 2, 0.006, 0.0165), (distal - 0.004, -0.003, 0.0105))}
              <geom name="fingertip" class="pad" type="sphere" pos="{distal - 0.003} 0 -0.001" size="0.0075"/>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <default>
    <default class="pad"><geom mass="0" user="{1 / 750}"/></default>
  </default>
</mujoco>"""


def _hinge(name: str, lower: float, upper: float) -> str:
    stiffness = 1.0 / EXPLORING_COMPLIANCE[name]
    return (
        f'<joint name="{name}" axis="0 1 0" range="{lower} {upper}" stiffness="{stiffness}" '
        f'damping="{DAMPING_TIME * stiffness}"/>'
    )


def _inertial(name: str, length: float, scale: float) -> str:
    """Uniform cylinder along x; the forearm reaches back from the wrist, the others forward from their joint."""
    mass, radius = scale * REFERENCE_MASSES[name], REFERENCE_RADII[name] * scale ** (1 / 3)
    across, along = mass * (3 * radius**2 + length**2) / 12, mass * radius**2 / 2
    centre = -length / 2 if name == "forearm" else length / 2
    return f'<inertial pos="{centre} 0 0" mass="{mass}" diaginertia="{along} {across} {across}"/>'


def _sites(prefix: str, *positions: tuple[float, float, float]) -> str:
    return "".join(
        f'<site name="{prefix}{number}" pos="{x} {y} {z}"/>' for number, (x, y, z) in enumerate(positions, start=1)
    )
