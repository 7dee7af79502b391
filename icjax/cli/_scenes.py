"""Scenes of the command line: a plate, flat or with a bump."""

import numpy as np

from icjax.geometry import Ellipsoid, Plane
from icjax.interaction import Interaction
from icjax.synthesis import Scene, Surface

BUMP_HALF_WIDTH = 0.035
"""Of the bump across the direction of the stroke, m."""

LEVEL = 0.005
"""Largest spread in height of contact points that still count as on a level plate, m."""


UPWARD = 0.5
"""Cosine of the steepest angle between the mean contact force and the vertical that friction on a level plate gives."""


def plate_scene(
    name: str,
    *,
    friction: float,
    height: float = 0.0,
    bump_centre: tuple[float, float] | None = None,
    bump_radii: tuple[float, float, float] = (0.012, BUMP_HALF_WIDTH, 0.003),
    step: float = 0.002,
) -> Scene:
    """A level plate at a height (m) with, if a centre (x, y in m) is given, the upper half of an ellipsoid on it."""
    plate = Plane(point=np.array([0.0, 0.0, height]), normal=np.array([0.0, 0.0, 1.0]))
    surfaces = [Surface(name="plate", shape=plate, friction=friction)]
    if bump_centre is not None:
        centre = np.array([*bump_centre, height])
        shape = Ellipsoid(centre=centre, rotation=np.eye(3), radii=np.array(bump_radii))
        surfaces.append(Surface(name="bump", shape=shape, friction=friction))
    return Scene(name=name, surfaces=tuple(surfaces), step=step)


def middle_of_contacts(interaction: Interaction) -> tuple[float, float, float]:
    """The middle of the measured contact points, m, world.

    **Errors**: `ValueError` without contact, or where the points do not lie on one level plane.
    """
    points = np.asarray(interaction.contact_point).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    if not len(points):
        raise ValueError(f"interaction {interaction.name!r} has no contact to put a surface under")
    low, high = np.percentile(points[:, 2], [5, 95])
    if high - low > LEVEL:
        raise ValueError(
            f"interaction {interaction.name!r}: its contact points lie between z = {low:.4f} and {high:.4f} m, not on "
            "a level plate; describe the surface in a scene file (--scene)"
        )
    force = np.nan_to_num(np.asarray(interaction.contact_force)).reshape(-1, 3).sum(axis=0)
    if force[2] < UPWARD * np.linalg.norm(force):
        direction = ", ".join(f"{value:.2f}" for value in force / max(np.linalg.norm(force), 1e-300))
        raise ValueError(
            f"interaction {interaction.name!r}: its contact forces point along ({direction}), not up along z, so they "
            "are not those of a level plate; describe the surface in a scene file (--scene)"
        )
    x, y, z = np.median(points, axis=0)
    return float(x), float(y), float(z)
