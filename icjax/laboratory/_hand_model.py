"""The hand, the table and an object as one MuJoCo model, and the hand alone as its experimenter would describe it."""

import numpy as np

from icjax.laboratory._apparatus import quaternion, row
from icjax.laboratory._free_object import TABLE_FRICTION, FreeObject
from icjax.laboratory._hand import FINGER_JOINTS, FINGERS, HAND_JOINTS, PAD_MASS, SEGMENTS, WRIST_FLEXION, Hand
from icjax.laboratory._instruments import Markers
from icjax.laboratory._mujoco import MjModel, mujoco
from icjax.laboratory._stand import Stand

FOREARM = ("forearm_x", "forearm_y", "forearm_z")

HAND_DRIVEN = (*FOREARM, *HAND_JOINTS)
"""Coordinates that the subject commands, in this order; fingertips and object follow passively."""

ARM_STIFFNESS = 20000.0
ARM_DAMPING = 250.0
"""Of the forearm on its path, N/m and Ns/m."""

GRIP_HEIGHT = 0.030
"""Of the middle of the fingertips above the table, m."""

PAD_DAMPING = 1.0
"""Ns/m: half of the critical damping of a fingertip of 1 g on 900 N/m."""

RIGID = 'solref="0.002 1" solimp="0.99 0.998 0.0001"'
"""Contact that gives way by less than a hundredth of what the pad does."""

RADIUS = {"metacarpal": 0.0105, "proximal": 0.0092, "middle": 0.0080, "distal": 0.0070}
"""Of the segments, m, at a hand length of 0.19 m."""


def wrist_origin(hand: Hand) -> np.ndarray:
    """World position of the wrist before the lift, m: the hand's comfortable grip lies over the world's origin."""
    return np.array([-0.37 * hand.hand_length, 0.0, GRIP_HEIGHT + 0.58 * hand.hand_length])


def build_hand(
    hand: Hand, thing: FreeObject | None, markers: Markers, timestep: float, stand: Stand | None = None
) -> MjModel:
    """The MuJoCo model; `markers` are sites on the bodies of the hand and on "object"."""
    return mujoco.MjModel.from_xml_string(hand_xml(hand, thing, markers, timestep, stand))


def hand_xml(
    hand: Hand, thing: FreeObject | None, markers: Markers, timestep: float, stand: Stand | None = None
) -> str:
    """MJCF of the dynamic hand over a table, with an object, on the table or a stand, or without one."""
    friction = f"{TABLE_FRICTION} 0.005 0.0001"
    return f"""
<mujoco model="virtual capture studio: hand">
  <compiler angle="radian"/>
  <option timestep="{timestep!r}" integrator="implicitfast" gravity="0 0 -9.81" cone="elliptic" impratio="50"
          iterations="60" tolerance="1e-11"/>
  <default><geom contype="0" conaffinity="0" density="1100"/></default>
  {_mesh(thing)}
  <worldbody>
    <geom name="table" type="plane" size="1 1 0.1" contype="2" conaffinity="2" friction="{friction}" priority="2"
          {RIGID}/>{_stand(stand)}
{_arm(hand, markers, dynamic=True)}
    {_thing(thing, markers, stand)}
  </worldbody>
  {_sensors(thing)}
</mujoco>
"""


def described_xml(hand: Hand, name: str) -> str:
    """MJCF of the kinematic hand with its nominal markers and contact pads, as a session hands it to the capture."""
    return (
        "<!-- The simulated hand as its experimenter would describe it: lengths, joint axes, nominal markers and\n"
        "     contact pads. Nothing here was measured on a person. -->\n"
        f'<mujoco model="{name}">\n  <compiler angle="radian"/>\n'
        '  <default><default class="pad"><geom mass="0"/></default></default>\n'
        f"  <worldbody>\n{_arm(hand, hand.markers(), dynamic=False)}\n  </worldbody>\n</mujoco>\n"
    )


def _arm(hand: Hand, markers: Markers, *, dynamic: bool) -> str:
    stiffness = dict(zip(HAND_JOINTS, 1.0 / np.asarray(hand.compliance), strict=True))
    damping = dict(zip(HAND_JOINTS, hand.damping, strict=True))
    sites: dict[str, str] = {}
    for label, (body, position) in markers.items():
        sites[body] = sites.get(body, "") + f'\n      <site name="{label}" pos="{row(position)}"/>'
    size, scale = hand.hand_length, hand.hand_length / 0.19

    def hinge(name: str, axis: str) -> str:
        spring = f' stiffness="{stiffness[name]:.17g}" damping="{damping[name]:.17g}"' if dynamic else ""
        return f'<joint name="{name}" type="hinge" axis="{axis}"{spring}/>'

    spring = f' stiffness="{ARM_STIFFNESS}" damping="{ARM_DAMPING}"' if dynamic else ""
    slides = "".join(
        f'\n      <joint name="{name}" type="slide" axis="{axis}"{spring}/>'
        for name, axis in zip(FOREARM, ("1 0 0", "0 1 0", "0 0 1"), strict=True)
    )
    lines = [
        f'    <body name="forearm" pos="{row(wrist_origin(hand))}">{slides}',
        f'      <geom type="capsule" fromto="-0.23 0 0 -0.03 0 0" size="0.03" mass="1.2"/>{sites.get("forearm", "")}',
        '      <body name="hand">',
        f"      {hinge('wrist', '0 1 0')}",
        f'      <geom type="box" size="{0.22 * size:.6g} {0.20 * size:.6g} {0.07 * size:.6g}" '
        f'pos="{0.24 * size:.6g} 0 0" mass="{0.35 * scale**3:.6g}"/>{sites.get("hand", "")}',
    ]
    for finger in FINGERS:
        position, rotation = hand.base(finger)
        place = f'pos="{row(position)}" quat="{row(quaternion(rotation))}"'
        first, abduction, *others = FINGER_JOINTS[finger]
        hinges = [hinge(f"{finger}_{first}", "0 1 0") + hinge(f"{finger}_{abduction}", "0 0 1")]
        hinges += [hinge(f"{finger}_{joint}", "0 1 0") for joint in others]
        for segment, length, joints in zip(SEGMENTS[finger], hand.lengths(finger), hinges, strict=True):
            radius, body = RADIUS[segment] * scale, f"{finger}_{segment}"
            lines.append(f'      <body name="{body}" {place}>{joints}')
            lines.append(
                f'      <geom type="capsule" fromto="{0.4 * radius:.6g} 0 0 {length - 0.4 * radius:.6g} 0 0" '
                f'size="{radius:.6g}" density="1100"/>{sites.get(body, "")}'
            )
            place = f'pos="{row((length, 0.0, 0.0))}"'
        lines += [_pad(hand, finger, dynamic), "      </body></body></body>"]
    return "\n".join([*lines, "    </body></body>"])


def _pad(hand: Hand, finger: str, dynamic: bool) -> str:
    centre, radius = hand.pad(finger)
    if not dynamic:
        return f'      <geom name="{finger}" class="pad" type="sphere" pos="{row(centre)}" size="{radius!r}"/>'
    slides = "".join(
        f'<joint name="{finger}_pad_{name}" type="slide" axis="{axis}" stiffness="{hand.pad_stiffness}" '
        f'damping="{PAD_DAMPING}"/>'
        for name, axis in zip("xyz", ("1 0 0", "0 1 0", "0 0 1"), strict=True)
    )
    return (
        f'      <site name="{finger}_tip" pos="{row(centre)}"/>\n'
        f'      <body name="{finger}_pad" pos="{row(centre)}">{slides}\n'
        f'        <inertial pos="0 0 0" mass="{PAD_MASS}" diaginertia="3e-8 3e-8 3e-8"/>\n'
        f'        <geom name="{finger}_pad" type="sphere" size="{radius!r}" contype="1" conaffinity="0" '
        f'condim="{4 if hand.twist else 3}" friction="0 {hand.twist!r} 0" {RIGID}/></body>'
    )


def _mesh(thing: FreeObject | None) -> str:
    if thing is None or thing.shape != "wedge":
        return ""
    return f'<asset><mesh name="object" vertex="{row(thing.vertices().reshape(-1))}"/></asset>'


def _stand(stand: Stand | None) -> str:
    if stand is None:
        return ""
    friction = f"{TABLE_FRICTION} 0 0"
    return "".join(
        f'\n    <geom type="sphere" size="{stand.bead!r}" pos="{row(place)}" contype="2" conaffinity="2" '
        f'friction="{friction}" priority="2" {RIGID}/>'
        for place in stand.places
    )


def _thing(thing: FreeObject | None, markers: Markers, stand: Stand | None) -> str:
    if thing is None:
        return ""
    middle = 0.5 * thing.height if stand is None else stand.height_of(0.5 * thing.height)
    on_it = ((label, place) for label, (body, place) in markers.items() if body == "object")
    sites = "".join(f'<site name="{label}" pos="{row(place)}"/>' for label, place in on_it)
    shape = {
        "box": lambda: f'type="box" size="{row(0.5 * np.asarray(thing.size))}"',
        "sphere": lambda: f'type="sphere" size="{row([0.5 * thing.size[0]])}"',
        "cylinder": lambda: f'type="cylinder" size="{row(0.5 * np.asarray(thing.size))}"',
        "wedge": lambda: 'type="mesh" mesh="object"',
    }[thing.shape]()
    return (
        f'<body name="object" pos="0 0 {middle!r}"><joint name="object" type="free"/>'
        f'<geom name="object" {shape} mass="{thing.mass!r}" contype="2" conaffinity="3" condim="3" '
        f'friction="{thing.friction!r} 0 0" {RIGID}/>{sites}</body>'
    )


def _sensors(thing: FreeObject | None) -> str:
    """Total contact force on every fingertip (N, world axes) and the place it acts at (m)."""
    if thing is None:
        return ""
    contacts = "".join(
        f'<contact name="{finger}" geom1="object" geom2="{finger}_pad" num="1" reduce="netforce" data="force pos"/>'
        for finger in FINGERS
    )
    pads = "".join(f'<framepos name="{finger}_at" objtype="body" objname="{finger}_pad"/>' for finger in FINGERS)
    return f"<sensor>{contacts}{pads}</sensor>"


def start_posture(model: MjModel) -> np.ndarray:
    """Coordinates with the wrist flexed and everything else at rest."""
    q = np.array(model.qpos0)
    q[model.joint("wrist").qposadr[0]] = WRIST_FLEXION
    return q
