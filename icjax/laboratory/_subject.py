"""The simulated subject: a wrist and an index finger with springs, dampers, mass and a soft fingertip."""

import dataclasses
import math

import numpy as np

JOINTS = ("wrist", "MP", "PIP", "DIP")
"""Hinges from proximal to distal; axis +y of the parent, flexion positive lowers the fingertip."""

LENGTH_RATIOS = (0.463, 0.245, 0.143, 0.097)
"""Length of hand (wrist to MP), proximal, middle and distal phalanx over hand length (Buchholz et al. 1992)."""

POSTURE = tuple(math.radians(angle) for angle in (3.0, 18.0, 27.0, 20.0))
"""Comfortable posture with the fingertip just over the plate, rad."""

LIMITS = tuple((math.radians(low), math.radians(high)) for low, high in ((-70, 80), (-30, 90), (-5, 110), (-20, 90)))
"""Range of each joint, rad."""


@dataclasses.dataclass(frozen=True)
class Subject:
    """What makes one simulated person differ from another.

    Joint i has stiffness 1/compliance[i] and damping damping_time/compliance[i]. The fingertip is a sphere held
    to the bone by springs that, with the contact in series, give `pad_stiffness`.
    """

    hand_length: float = 0.190
    compliance: tuple[float, float, float, float] = (0.25, 0.70, 0.45, 1.10)
    damping_time: float = 0.018
    pad_stiffness: float = 750.0

    def __post_init__(self):
        if not (0.10 <= self.hand_length <= 0.30):
            raise ValueError(f"hand_length must be between 0.10 and 0.30 m, got {self.hand_length}")
        if len(self.compliance) != 4:
            raise ValueError(f"compliance needs one value a joint {JOINTS}, got {self.compliance}")
        for joint, value in zip(JOINTS, self.compliance, strict=True):
            if not (math.isfinite(value) and 0.01 <= value <= 100.0):
                raise ValueError(f"compliance of {joint} must be between 0.01 and 100 rad/Nm, got {value}")
        if not (0.0 < self.damping_time <= 0.2):
            raise ValueError(f"damping_time must be in (0, 0.2] s, got {self.damping_time}")
        if not (100.0 <= self.pad_stiffness <= 5000.0):
            raise ValueError(f"pad_stiffness must be between 100 and 5000 N/m, got {self.pad_stiffness}")

    @property
    def lengths(self) -> np.ndarray:
        """Hand, proximal, middle and distal segment, m."""
        return self.hand_length * np.asarray(LENGTH_RATIOS)

    @property
    def damping(self) -> np.ndarray:
        """Nm s/rad a joint."""
        return self.damping_time / np.asarray(self.compliance)

    @property
    def pad_radius(self) -> float:
        """Radius of the fingertip sphere, m."""
        return 0.0075

    @property
    def pad_offset(self) -> np.ndarray:
        """Centre of the fingertip sphere in the distal frame, m."""
        return np.array([self.lengths[3] - 0.003, 0.0, -0.001])

    def pad_position(self, theta: np.ndarray) -> np.ndarray:
        """Pad centre (x, z) in the forearm frame for angles `theta` (..., 4); the forearm frame is at the wrist."""
        pitch = np.cumsum(theta, axis=-1)
        cos, sin = np.cos(pitch), np.sin(pitch)
        along = np.concatenate([self.lengths[:3], self.pad_offset[:1]])
        across = self.pad_offset[2]
        x = cos @ along + sin[..., 3] * across
        z = -(sin @ along) + cos[..., 3] * across
        return np.stack([x, z], axis=-1)

    def pad_jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Derivative of the pad centre (x, z) by the four angles: a rotation about +y turns x into -z."""
        points = self.joint_positions(theta)
        arm = self.pad_position(theta)[None, :] - points
        return np.stack([arm[:, 1], -arm[:, 0]])

    def joint_positions(self, theta: np.ndarray) -> np.ndarray:
        """Positions (x, z) of the four joints in the forearm frame, shape (4, 2)."""
        pitch = np.cumsum(theta)[:3]
        steps = self.lengths[:3, None] * np.stack([np.cos(pitch), -np.sin(pitch)], axis=1)
        return np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])

    def contact_jacobian(self, theta: np.ndarray) -> np.ndarray:
        """Jacobian (x, z) of the lowest point of the fingertip, moving with the bone: J^T f is the joint torque."""
        jacobian = self.pad_jacobian(theta)
        return jacobian - np.array([[self.pad_radius], [0.0]])

    def endpoint_compliance(self, theta: np.ndarray) -> np.ndarray:
        """Static compliance (x, z; m/N) that a push on the fingertip's underside meets: J C J^T + C_pad."""
        jacobian = self.contact_jacobian(theta)
        return (jacobian * np.asarray(self.compliance)) @ jacobian.T + np.eye(2) / self.pad_stiffness

    def markers(self) -> dict[str, tuple[str, np.ndarray]]:
        """Nominal marker positions: label -> (body, position in the frame of the body, m)."""
        hand, proximal, middle, distal = self.lengths
        pad = self.pad_offset[0]
        table = {
            "forearm": ("FA", [(-0.16, -0.02, 0.035), (-0.10, 0.025, 0.038), (-0.05, -0.01, 0.036)]),
            "hand": (
                "HA",
                [
                    (0.025, -0.012, 0.018),
                    (0.030, 0.035, 0.020),
                    (hand - 0.020, 0.030, 0.019),
                    (hand - 0.012, -0.008, 0.018),
                ],
            ),
            "proximal": (
                "PP",
                [(0.010, -0.005, 0.015), (proximal / 2, 0.008, 0.019), (proximal - 0.010, -0.004, 0.014)],
            ),
            "middle": (
                "MP",
                [(0.005, 0.005, 0.0135), (middle / 2, -0.007, 0.018), (middle - 0.005, 0.005, 0.0125)],
            ),
            "distal": (
                "DP",
                [(0.003, -0.005, 0.012), (distal / 2, 0.006, 0.0165), (pad - 0.001, -0.003, 0.0105)],
            ),
        }
        return {
            f"{prefix}{number}": (body, np.asarray(position))
            for body, (prefix, positions) in table.items()
            for number, position in enumerate(positions, start=1)
        }
