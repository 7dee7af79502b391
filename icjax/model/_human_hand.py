"""The shipped hand: wrist, five fingers and an opposable thumb, scaled by hand length and breadth."""

import dataclasses
import math

import numpy as np

from icjax.model._edit import mirrored, with_pads
from icjax.model._hand_dimensions import (
    BREADTH_RATIO,
    DENSITY,
    FINGER,
    FINGER_ROLL,
    FINGERS,
    FOREARM,
    KNUCKLE_ACROSS,
    KNUCKLE_ARCH,
    KNUCKLE_RATIOS,
    PAD_RADII,
    PALM,
    RADII,
    ROOT_COMPLIANCE,
    SEGMENT_RATIOS,
    THICKNESS,
    THUMB,
    THUMB_BASE,
    THUMB_PRONATION,
    THUMB_TURN,
    WRIST,
    Hinge,
)
from icjax.model._index_finger import DAMPING_TIME
from icjax.model._load import PAD_COMPLIANCE, load_model
from icjax.model._model import Model

Y, Z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def human_hand(
    length: float = 0.19,
    breadth: float | None = None,
    side: str = "right",
    root: str = "compliant",
    pads: str = "fingertips",
) -> Model:
    """Forearm, hand and five fingers: 22 hinges on a root of six degrees of freedom.

    The wrist is the origin of forearm and hand; +x goes along the third metacarpal, +z out of the back of the hand,
    +y (right hand) to the thumb. At zero angles the fingers lie straight along +x and the thumb in line with the
    trapezium, 48 deg out of the palm's plane, its nail to the side. Flexion is positive and brings the tip toward
    the palm, the thumb's across it; abduction is positive away from the middle finger, for the thumb out of the
    palm's plane, for middle finger and wrist toward the thumb. A left hand is the mirror image of the right one in
    the x-z plane: equal angles bring mirrored postures (see `mirrored`).

    =====================  ============  ==============  =========
    joint                  limits, deg   rad/Nm          rest, deg
    =====================  ============  ==============  =========
    wrist_flexion          -70 to 80     0.3488          -15
    wrist_deviation        -30 to 20     0.1744          0
    thumb_CM_flexion       -28 to 25     0.3488          0
    thumb_CM_abduction     -45 to 25     0.3488          -10
    thumb_MP               -10 to 60     0.4941          10
    thumb_IP               -20 to 80     1.0026          15
    index_MP, ...          -45 to 90     0.9882          35
    index_abduction, ...   -20 to 20     0.4941          0
    index_PIP, ...         -10 to 100    0.6715          40
    index_DIP, ...         -10 to 90     2.0052          20
    =====================  ============  ==============  =========

    - **Lengths** are ratios of hand length (Buchholz, Armstrong and Goldstein 1992, those of `index_finger`); the
      metacarpal's is taken as the distance from wrist to knuckle. Breadths, thicknesses and pads follow `breadth`.
    - **Thumb**: base and axes of the carpometacarpal joint from MyoHand and Cooney et al. 1981. The two axes meet in
      a point and abduction turns the thumb inward by 0.4 of its angle; the MP joint has no abduction.
    - **Limits** are those of the American Academy of Orthopaedic Surgeons as textbooks of goniometry print them,
      except: PIP and DIP extend 10 deg beyond straight, so that a straight finger is not at its limit, and thumb MP
      10 deg; thumb MP bends to 60 deg (Barakat, Field and Taylor 2013) and its CM flexion spans the 53 deg of Cooney.
      Its CM abduction counts from the trapezium: 3 to 73 deg out of the palm's plane.
    - **Compliances** of wrist flexion and of the fingers' flexion are those of surface exploration in Table 1 of Kry
      and Pai 2006, the index finger's for all four. The paper has no others; ours are typical: half the flexion's
      for wrist deviation (which is stiffer: Formica et al. 2012) and for finger abduction, whose range is a third; the
      wrist's for both axes of the thumb's base, and half a finger's for its MP and IP, as it holds against several.
    - **Root**: the arm's compliance is 1/400 m/N and 0.05 rad/Nm in all directions, so that the compliance at a
      contact has full rank (section 6.2); an order of magnitude, the paper gives no number.
    - **Damping** is 0.04 s over the compliance. Inertias are those of cylinders of 1100 kg/m3 and of a box for the
      palm: 0.42 kg from the wrist on at 0.19 m.
    - **Rest**, where springs are slack and where a posture prior without angles pulls to, is a relaxed hand: wrist a
      little extended (Lee and Jung 2014), fingers curled. Nothing else uses it; the reference trajectory does not.
    - **Sites** three a segment over the back of the bones, four on the hand: "forearm1", "hand1", "index_proximal1" ...
    - **Pads** "thumb", "index", "middle", "ring", "little": spheres of 1/750 m/N on the palmar side of the last
      segments; the middle finger's ends at `length` from the wrist. With `pads="fingers"` also capsules about the
      other two segments of each digit, named as their bodies ("index_proximal", ...), and "palm" along the knuckles.

    **Arguments**: `length` m, wrist crease to tip of the middle finger; `breadth` m, across the knuckles (default
    0.45 of the length); `side` "right" or "left"; `root` "compliant" (the forearm floats on a free joint named
    "root" with the arm's compliance), "free" (the same joint driven: compliance 0) or "fixed" (it stands in the
    world); `pads` "fingertips" or "fingers".

    **Errors**: `ValueError` for a length outside 0.1 to 0.3 m, a breadth outside 0.3 to 0.6 of it, an unknown side,
    root or kind of pads.

    **Source**: Kry and Pai 2006, section 6.2 and Table 1; further sources beside the numbers in the module
    `icjax.model._hand_dimensions`.
    """
    if not 0.1 <= length <= 0.3:
        raise ValueError(f"length is {length} m; it must lie between 0.1 and 0.3 m")
    breadth = BREADTH_RATIO * length if breadth is None else breadth
    if not 0.3 <= breadth / length <= 0.6:
        raise ValueError(f"breadth is {breadth} m; it must lie between 0.3 and 0.6 of the length, {length} m")
    if side not in ("right", "left"):
        raise ValueError(f"side is {side!r}; it must be 'right' or 'left'")
    if root not in ("compliant", "free", "fixed"):
        raise ValueError(f"root is {root!r}; it must be 'compliant', 'free' or 'fixed'")
    if pads not in ("fingertips", "fingers"):
        raise ValueError(f"pads is {pads!r}; it must be 'fingertips' or 'fingers'")
    model = load_model(_mjcf(length, breadth, root != "fixed"))
    if pads == "fingers":
        model = with_pads(model, _surfaces(length, breadth))
    if root != "fixed":
        model = _with_root_compliance(model, root == "compliant")
    return model if side == "right" else mirrored(model)


def _with_root_compliance(model: Model, compliant: bool) -> Model:
    """The first six degrees of freedom: driven, or those of the arm."""
    arm = np.repeat(list(ROOT_COMPLIANCE.values()), 3) if compliant else np.zeros(6)
    damping = DAMPING_TIME / arm if compliant else np.zeros(6)
    return dataclasses.replace(
        model,
        compliance=np.concatenate([arm, np.asarray(model.compliance)[6:]]),
        damping=np.concatenate([damping, np.asarray(model.damping)[6:]]),
    )


def _surfaces(length: float, breadth: float) -> dict[str, tuple]:
    """Capsules from joint to joint, and across the palm under the knuckles."""
    found = {}
    for name in ("thumb", *FINGERS):
        segments = ("metacarpal", "proximal") if name == "thumb" else ("proximal", "middle")
        for segment, ratio in zip(segments, SEGMENT_RATIOS[name][:2], strict=True):
            radius = RADII[segment] * breadth * (1.0 if segment == "metacarpal" else THICKNESS[name])
            half = (0.5 * ratio * length, 0.0, 0.0)
            found[f"{name}_{segment}"] = (f"{name}_{segment}", half, radius, half)
    ends = np.array([KNUCKLE_ACROSS["index"], KNUCKLE_ACROSS["little"]]) * breadth
    radius = 0.5 * PALM[1] * length
    middle, half = (PALM[0] * length - radius, ends.mean(), 0.0), (0.0, 0.5 * np.ptp(ends), 0.0)
    return found | {"palm": ("hand", middle, radius, half)}


def _mjcf(length: float, breadth: float, floats: bool) -> str:
    """The right hand."""
    size, radius = FOREARM[0] * length, FOREARM[1] * breadth
    forearm = [(-0.6 * size, -0.5 * radius), (-0.4 * size, 0.6 * radius), (-0.2 * size, -0.3 * radius)]
    hand = [(0.13, -0.10), (0.16, 0.18), (0.36, 0.13), (0.37, -0.24)]
    digits = [_thumb(length, breadth), *(_finger(name, length, breadth) for name in FINGERS)]
    return f"""
<mujoco model="human_hand">
  <compiler angle="degree" eulerseq="zyx"/>
  <worldbody>
    <body name="forearm">
      {'<freejoint name="root"/>' if floats else ""}
      {_cylinder(-size, radius)}
      {_sites("forearm", [(x, y, 1.1 * radius) for x, y in forearm])}
      <body name="hand">
        {_hinge("wrist_flexion", Y, WRIST["flexion"])}
        {_hinge("wrist_deviation", Z, WRIST["deviation"])}
        {_palm(length, breadth)}
        {_sites("hand", [(x * length, y * breadth, 0.105 * length) for x, y in hand])}
        {"".join(digits)}
      </body>
    </body>
  </worldbody>
  <default>
    <default class="pad"><geom mass="0" user="{PAD_COMPLIANCE}"/></default>
  </default>
</mujoco>"""


def _finger(name: str, length: float, breadth: float) -> str:
    across, arch = KNUCKLE_ACROSS[name] * breadth, KNUCKLE_ARCH[name] * length
    along = math.sqrt((KNUCKLE_RATIOS[name] * length) ** 2 - across**2 - arch**2)
    outward = (0.0, 0.0, 1.0 if across >= 0 else -1.0)
    hinges = [
        _hinge(f"{name}_MP", Y, FINGER["MP"]) + _hinge(f"{name}_abduction", outward, FINGER["abduction"]),
        _hinge(f"{name}_PIP", Y, FINGER["PIP"]),
        _hinge(f"{name}_DIP", Y, FINGER["DIP"]),
    ]
    place = f'pos="{along} {across} {arch}" euler="0 0 {FINGER_ROLL[name]}"'
    return _digit(name, ("proximal", "middle", "distal"), place, hinges, length, breadth)


def _thumb(length: float, breadth: float) -> str:
    flexion, abduction, pronation = THUMB_TURN
    tilt = math.radians(THUMB_PRONATION)
    outward = (-math.sin(tilt), 0.0, math.cos(tilt))
    hinges = [
        _hinge("thumb_CM_flexion", Y, THUMB["CM_flexion"])
        + _hinge("thumb_CM_abduction", outward, THUMB["CM_abduction"]),
        _hinge("thumb_MP", Y, THUMB["MP"]),
        _hinge("thumb_IP", Y, THUMB["IP"]),
    ]
    at = THUMB_BASE[0] * length, THUMB_BASE[1] * breadth, THUMB_BASE[2] * length
    place = f'pos="{_text(at)}" euler="{abduction} {flexion} {-pronation}"'
    return _digit("thumb", ("metacarpal", "proximal", "distal"), place, hinges, length, breadth)


def _digit(name: str, segments: tuple[str, ...], place: str, hinges: list[str], length: float, breadth: float) -> str:
    """Three segments in a row, the first at `place`, each on its hinges; the last ends in a pad."""
    pad = PAD_RADII[name] * breadth
    lengths = [ratio * length for ratio in SEGMENT_RATIOS[name]]
    places = [place, *(f'pos="{before} 0 0"' for before in lengths[:2])]
    tip = f'pos="{lengths[2] - 0.75 * pad} 0 {-0.2 * pad}" size="{pad}"'
    xml = f'<geom name="{name}" class="pad" type="sphere" {tip}/>'
    for segment, where, hinge, size in reversed(list(zip(segments, places, hinges, lengths, strict=True))):
        radius = RADII[segment] * breadth * (1.0 if segment == "metacarpal" else THICKNESS[name])
        over = [(0.15 * size, -0.5 * radius), (0.5 * size, 0.7 * radius), (0.85 * size, -0.4 * radius)]
        body = f"{name}_{segment}"
        xml = (
            f'<body name="{body}" {where}>{hinge}{_cylinder(size, radius)}'
            f"{_sites(body, [(x, y, 1.3 * radius) for x, y in over])}{xml}</body>"
        )
    return xml


def _hinge(name: str, axis: tuple[float, float, float], hinge: Hinge) -> str:
    return (
        f'<joint name="{name}" axis="{_text(axis)}" range="{hinge.lower} {hinge.upper}" springref="{hinge.rest}" '
        f'stiffness="{1 / hinge.compliance}" damping="{DAMPING_TIME / hinge.compliance}"/>'
    )


def _cylinder(length: float, radius: float) -> str:
    """Inertia of a cylinder along x from the joint, backward for a negative length."""
    mass = DENSITY * math.pi * radius**2 * abs(length)
    along, across = mass * radius**2 / 2, mass * (3 * radius**2 + length**2) / 12
    return f'<inertial pos="{length / 2} 0 0" mass="{mass}" diaginertia="{along} {across} {across}"/>'


def _palm(length: float, breadth: float) -> str:
    """Inertia of a box from the wrist to the knuckles."""
    x, y, z = PALM[0] * length, breadth, PALM[1] * length
    mass = DENSITY * x * y * z
    inertia = _text((mass * (y**2 + z**2) / 12, mass * (x**2 + z**2) / 12, mass * (x**2 + y**2) / 12))
    middle = 0.5 * (KNUCKLE_ACROSS["index"] + KNUCKLE_ACROSS["little"]) * breadth
    return f'<inertial pos="{x / 2} {middle} 0" mass="{mass}" diaginertia="{inertia}"/>'


def _sites(body: str, places: list[tuple[float, float, float]]) -> str:
    return "".join(
        f'<site name="{body}{number}" pos="{_text(place)}"/>' for number, place in enumerate(places, start=1)
    )


def _text(numbers: tuple[float, float, float]) -> str:
    return " ".join(str(number) for number in numbers)
