"""Numbers of the shipped hand: lengths, places, radii, ranges and compliances, with where each comes from.

The ratios named after Buchholz are those of secondary sources, the shipped index finger and the simulated subjects;
the original table was not at hand. "Ours" marks what no table was taken for.
"""

from typing import NamedTuple

from icjax.model._index_finger import EXPLORING_COMPLIANCE
from icjax.model._index_finger import LENGTH_RATIOS as INDEX_RATIOS

FINGERS = ("index", "middle", "ring", "little")

BREADTH_RATIO = 0.45
"""Hand breadth (across the knuckles, without the thumb) over hand length: means of 0.437 (women) to 0.452 (men) in
Ibeachu, Abu and Didia 2011, Asian J. Med. Sci. 3, 146."""

KNUCKLE_RATIOS = {"index": INDEX_RATIOS["hand"], "middle": 0.446, "ring": 0.421, "little": 0.414}
"""Distance of the knuckle from the wrist over hand length: Buchholz, Armstrong and Goldstein 1992."""

SEGMENT_RATIOS = {
    "thumb": (0.251, 0.196, 0.158),
    "index": (INDEX_RATIOS["proximal"], INDEX_RATIOS["middle"], INDEX_RATIOS["distal"]),
    "middle": (0.266, 0.170, 0.108),
    "ring": (0.244, 0.165, 0.107),
    "little": (0.204, 0.117, 0.093),
}
"""Lengths of the thumb's metacarpal and of the phalanges over hand length: Buchholz, Armstrong and Goldstein 1992."""

KNUCKLE_ACROSS = {"index": 0.22, "middle": 0.0, "ring": -0.21, "little": -0.40}
"""Place of the knuckle toward the thumb over hand breadth, from the line of the third metacarpal. Ours, so that
straight fingers lie side by side: 0.62 from first to last; in MyoHand 0.54."""

KNUCKLE_ARCH = {"index": -0.032, "middle": 0.0, "ring": -0.006, "little": -0.032}
"""Height of the knuckle over the third's, over hand length: the transverse arch of MyoHand at its zero."""

FINGER_ROLL = {"index": -8.0, "middle": -3.0, "ring": 3.0, "little": 8.0}
"""deg, turn of a finger about its length, so that bent fingers converge. Half of what MyoHand's axes have, which would
let the fingers of a fist run into each other."""

THUMB_BASE = (0.14, 0.25, -0.117)
"""Carpometacarpal joint of the thumb: distal (of hand length), toward the thumb (of breadth), dorsal (of length), as
measured on MyoHand at its zero."""

THUMB_TURN = (48.0, 38.0, 80.0)
"""deg, flexion, abduction and pronation of the trapezium's axes against the third metacarpal: Cooney, Lucca, Chao and
Linscheid 1981, J. Bone Joint Surg. 63-A, 1371. The order of the turns is our reading: abduction, flexion, pronation,
each about the axes that the one before left. The axes come within 15 to 20 deg of MyoHand's."""

THUMB_PRONATION = 22.0
"""deg, tilt of the thumb's axis of abduction toward its length: abduction pronates by tan(22 deg) = 0.4 of its angle,
as 21 over 51 deg in Goubier et al. 2009, Chir. Main 28, 297."""

RADII = {"metacarpal": 0.19, "proximal": 0.120, "middle": 0.108, "distal": 0.095}
"""Radius of the cylinders that inertias are taken from, over hand breadth. Ours, of an adult."""

THICKNESS = {"thumb": 1.15, "index": 1.0, "middle": 1.0, "ring": 0.95, "little": 0.87}
"""Radius of a digit's phalanges over that in the table of radii. Ours."""

PAD_RADII = {"thumb": 0.100, "index": 0.088, "middle": 0.088, "ring": 0.088, "little": 0.082}
"""Radius of the contact pad over hand breadth: 7.0 to 8.6 mm on a hand of 0.19 m. Ours."""

PALM = (0.42, 0.17)
"""Length and thickness over hand length of the box that the palm's inertia is taken from. Ours."""

FOREARM = (1.3, 0.44)
"""Length over hand length, radius over hand breadth of the forearm. Ours."""

DENSITY = 1100.0
"""kg/m3, of tissue."""

ROOT_COMPLIANCE = {"angular": 0.05, "linear": 1 / 400}
"""rad/Nm and m/N, of the arm that carries the forearm, the same in all directions. Section 6.2 gives no number; these
are of the order of an arm that holds still, some hundred N/m at the hand (Mussa-Ivaldi, Hogan and Bizzi 1985, J.
Neurosci. 5, 2732) and ten or more Nm/rad at shoulder and elbow (Gomi and Osu 1998, J. Neurosci. 18, 8965)."""


class Hinge(NamedTuple):
    """Limits and slack angle of a joint, deg, and its compliance, rad/Nm."""

    lower: float
    upper: float
    rest: float
    compliance: float


WRIST = {
    "flexion": Hinge(-70, 80, -15, EXPLORING_COMPLIANCE["wrist"]),
    "deviation": Hinge(-30, 20, 0, EXPLORING_COMPLIANCE["wrist"] / 2),
}

FINGER = {
    "MP": Hinge(-45, 90, 35, EXPLORING_COMPLIANCE["MP"]),
    "abduction": Hinge(-20, 20, 0, EXPLORING_COMPLIANCE["MP"] / 2),
    "PIP": Hinge(-10, 100, 40, EXPLORING_COMPLIANCE["PIP"]),
    "DIP": Hinge(-10, 90, 20, EXPLORING_COMPLIANCE["DIP"]),
}

THUMB = {
    "CM_flexion": Hinge(-28, 25, 0, EXPLORING_COMPLIANCE["wrist"]),
    "CM_abduction": Hinge(-45, 25, -10, EXPLORING_COMPLIANCE["wrist"]),
    "MP": Hinge(-10, 60, 10, EXPLORING_COMPLIANCE["MP"] / 2),
    "IP": Hinge(-20, 80, 15, EXPLORING_COMPLIANCE["DIP"] / 2),
}
