"""The simulated hand: wrist, thumb and four fingers with springs, dampers, mass and soft fingertips."""

import dataclasses
import math

import numpy as np

FINGERS = ("thumb", "index", "middle", "ring", "little")

SEGMENTS = {"thumb": ("metacarpal", "proximal", "distal")} | dict.fromkeys(
    FINGERS[1:], ("proximal", "middle", "distal")
)
"""Bodies of a finger from its base on, named `<finger>_<segment>`."""

FINGER_JOINTS = {"thumb": ("cmc", "cmc_abd", "mp", "ip")} | dict.fromkeys(FINGERS[1:], ("mcp", "abd", "pip", "dip"))
"""Hinges of a finger, named `<finger>_<joint>`: flexion (axis +y of the segment before it) and, second, abduction (+z).

Flexion positive closes the finger; the palm's side of every segment is -z.
"""

HAND_JOINTS = ("wrist", *(f"{finger}_{joint}" for finger in FINGERS for joint in FINGER_JOINTS[finger]))

RATIOS = {
    "thumb": (0.251, 0.196, 0.158),
    "index": (0.245, 0.143, 0.097),
    "middle": (0.266, 0.170, 0.108),
    "ring": (0.244, 0.165, 0.107),
    "little": (0.204, 0.117, 0.093),
}
"""Lengths of the segments over hand length (Buchholz et al. 1992)."""

BASES = {
    "thumb": (0.118, 0.105, -0.090),
    "index": (0.463, 0.125, -0.005),
    "middle": (0.446, 0.032, 0.010),
    "ring": (0.421, -0.060, -0.015),
    "little": (0.400, -0.140, -0.050),
}
"""First joint of every finger in the frame of the hand, over hand length; wrist at the origin, thumb at +y."""

THUMB_DIRECTION = (0.55, -0.18, -0.80)
"""Of the straight thumb in the frame of the hand: down and forward, before the palm."""

WRIST_FLEXION = math.radians(35.0)
"""Throughout a grasp, rad."""

POSTURE = {"thumb": (0.0, 0.0, 28.0, 24.0)} | dict.fromkeys(FINGERS[1:], (14.0, 0.0, 44.0, 26.0))
"""Comfortable posture of a finger about an object, degrees."""

HINGE_LIMITS = {"thumb": ((-60, 60), (-45, 45), (-20, 75), (-20, 90))} | dict.fromkeys(
    FINGERS[1:], ((-30, 90), (-25, 25), (-5, 110), (-15, 85))
)
"""Range of every joint of a finger, degrees."""

HAND_COMPLIANCE = (
    0.14,
    *(0.26, 0.32, 0.36, 0.54),
    *(0.42, 0.46, 0.52, 0.72),
    *(0.42, 0.46, 0.52, 0.72),
    *(0.50, 0.54, 0.60, 0.84),
    *(0.60, 0.66, 0.74, 1.00),
)
"""Of `HAND_JOINTS`, rad/Nm."""

PAD_MASS = 0.001
"""kg; the mass of skin and pulp that moves with the surface of a fingertip."""


@dataclasses.dataclass(frozen=True)
class Hand:
    """What makes one simulated hand differ from another.

    Joint i has stiffness 1/compliance[i] and damping damping_time/compliance[i]. A fingertip is a sphere on springs
    of `pad_stiffness` N/m in every direction; its patch of contact resists twisting by up to `twist` (m) times the
    normal force.
    """

    hand_length: float = 0.190
    compliance: tuple[float, ...] = HAND_COMPLIANCE
    damping_time: float = 0.018
    pad_stiffness: float = 900.0
    twist: float = 0.002

    def __post_init__(self):
        if not (0.165 <= self.hand_length <= 0.23):
            raise ValueError(f"hand_length must be between 0.165 and 0.23 m, got {self.hand_length}")
        if len(self.compliance) != len(HAND_JOINTS):
            raise ValueError(f"compliance needs one value for each of {len(HAND_JOINTS)} joints, got {self.compliance}")
        for joint, value in zip(HAND_JOINTS, self.compliance, strict=True):
            if not (math.isfinite(value) and 0.01 <= value <= 10.0):
                raise ValueError(f"compliance of {joint} must be between 0.01 and 10 rad/Nm, got {value}")
        if not (0.005 <= self.damping_time <= 0.2):
            raise ValueError(f"damping_time must be in [0.005, 0.2] s, got {self.damping_time}")
        if not (100.0 <= self.pad_stiffness <= 3000.0):
            raise ValueError(f"pad_stiffness must be between 100 and 3000 N/m, got {self.pad_stiffness}")
        if not (0.0 <= self.twist <= 0.01):
            raise ValueError(f"twist must be between 0 and 0.01 m, got {self.twist}")

    @property
    def damping(self) -> np.ndarray:
        """Nm s/rad a joint."""
        return self.damping_time / np.asarray(self.compliance)

    def lengths(self, finger: str) -> np.ndarray:
        """Of the three segments of a finger, m."""
        return self.hand_length * np.asarray(RATIOS[finger])

    def base(self, finger: str) -> tuple[np.ndarray, np.ndarray]:
        """Position (m) and rotation of the first joint's frame in the frame of the hand."""
        rotation = np.eye(3)
        if finger == "thumb":
            along = np.asarray(THUMB_DIRECTION) / np.linalg.norm(THUMB_DIRECTION)
            across = np.array([0.0, -1.0, 0.0])
            across = across - along * (across @ along)
            across = across / np.linalg.norm(across)
            rotation = np.column_stack([along, across, np.cross(along, across)])
        return self.hand_length * np.asarray(BASES[finger]), rotation

    def pad(self, finger: str) -> tuple[np.ndarray, float]:
        """Centre of the fingertip sphere in the frame of the distal segment, and its radius, m."""
        return np.array([self.lengths(finger)[2] - 0.0045, 0.0, -0.0015]), 0.0090 if finger == "thumb" else 0.0078

    def markers(self) -> dict[str, tuple[str, np.ndarray]]:
        """Nominal marker positions, three a segment: label -> (body, position in the frame of the body, m)."""
        size = self.hand_length
        table = {
            "forearm": [(-0.175, -0.018, 0.034), (-0.110, 0.026, 0.036), (-0.055, -0.012, 0.035)],
            "hand": [(0.13 * size, -0.10 * size, 0.020), (0.18 * size, 0.11 * size, 0.022), (0.37 * size, 0.0, 0.021)],
        }
        for finger in FINGERS:
            for segment, length in zip(SEGMENTS[finger], self.lengths(finger), strict=True):
                far = 0.85 if segment != "distal" else 0.80
                table[f"{finger}_{segment}"] = [
                    (0.18 * length, -0.006, 0.0115),
                    (0.50 * length, 0.007, 0.0150),
                    (far * length, -0.003, 0.0110),
                ]
        return {
            f"{body}{number}": (body, np.asarray(position))
            for body, positions in table.items()
            for number, position in enumerate(positions, start=1)
        }
