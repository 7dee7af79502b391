"""Contacts of an index finger that are worth comparing where nobody has said which."""

import numpy as np

from icjax.fit._probe import Numbers, Probe
from icjax.model import Model, neutral

SHAPES = {"straight": (3, 18, 10, 7), "exploring": (3, 18, 27, 20), "bent": (3, 18, 50, 33), "hooked": (3, 18, 70, 46)}
"""Degrees of wrist, MP, PIP and DIP."""

ANGLES = {"flat pad": 0, "oblique": 45, "on the tip": 85}
"""Degrees between the surface and the distal segment. A plate that goes on behind the pad is met steeply; what lies
flat on a bent finger's pad is an edge or a bar, or other joints would touch it first."""


def finger_posture(model: Model, degrees: Numbers) -> tuple[float, ...]:
    """Coordinates of the index finger with given flexions of wrist, MP, PIP and DIP, all else neutral."""
    q = np.array(neutral(model), float)
    for joint, angle in zip(("wrist", "MP", "PIP", "DIP"), np.asarray(degrees, float), strict=True):
        q[model.coordinate_slices[model.joint(joint)]] = np.radians(angle)
    return tuple(q.tolist())


def finger_normal(degrees: Numbers, angle: float | int) -> tuple[float, float, float]:
    """Normal, world axes, of a surface that meets the index finger's distal segment at an angle (degrees): at 0 the pad
    lies flat on it, at 90 the fingertip stands on it. The forearm is level; flexions add up to the segment's pitch."""
    lean = np.radians(np.sum(np.asarray(degrees, float)) - angle)
    return float(np.sin(lean)), 0.0, float(np.cos(lean))


def finger_candidates(model: Model, contacts: int = 12) -> tuple[Probe, ...]:
    """Every one of `SHAPES` against a surface at every one of `ANGLES`, and the exploring finger on a level plate.

    **Errors**: `ValueError` for a model without the joints of `index_finger`.
    """
    level = Probe(
        finger_posture(model, SHAPES["exploring"]), "fingertip", contacts=contacts, name="exploring, level plate"
    )
    rest = [
        Probe(
            finger_posture(model, degrees),
            "fingertip",
            finger_normal(degrees, angle),
            contacts=contacts,
            name=f"{shape}, {how}",
        )
        for shape, degrees in SHAPES.items()
        for how, angle in ANGLES.items()
    ]
    return (level, *rest)
