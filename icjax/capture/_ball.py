"""A ball that measures the pressure on its surface: which fingertip presses where, how hard (section 8.2)."""

import dataclasses
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from icjax.capture._filters import HIGHEST_CUTOFF, lowpass
from icjax.capture._plate_motion import bridged
from icjax.capture._registration import rigid_registration, rigid_registrations
from icjax.capture._source_file import cell_map, windows
from icjax.capture._spec import CellSpec
from icjax.files import FileError, MotionFile, Table, read_toml


@dataclasses.dataclass(frozen=True)
class BallSpec:
    """A pressure sensitive ball in its own frame, the origin in its middle.

    - `radius` m. `cells`: on its surface; `scale` turns what a channel holds into N (an area in m2 for Pa).
    - `markers`: name and place (m). `tare`: intervals (s) in which no fingertip touches it.
    - `mass` kg, None where it is not stated.
    """

    path: Path
    radius: float
    cells: tuple[CellSpec, ...]
    markers: tuple[tuple[str, tuple[float, float, float]], ...]
    tare: tuple[tuple[float, float], ...]
    mass: float | None = None

    @property
    def directions(self) -> Float[np.ndarray, "cell 3"]:
        """Of the cells from the middle."""
        places = np.array([cell.position for cell in self.cells], dtype=float)
        return places / np.linalg.norm(places, axis=1, keepdims=True)


class BallContacts(NamedTuple):
    """What presses on a ball, in the ball's frame; zero and NaN where a finger does not touch.

    - `pressed` [S, finger] N: sum over the cells. `force` [S, finger, 3] N: on the finger, along the normal.
    - `point` [S, finger, 3] m: centre of pressure, on the surface. `normal` [S, finger, 3]: outward there.
    - `elsewhere` [S] N: sum over loaded cells that no fingertip is near.
    """

    pressed: Float[np.ndarray, "sample finger"]
    force: Float[np.ndarray, "sample finger 3"]
    point: Float[np.ndarray, "sample finger 3"]
    normal: Float[np.ndarray, "sample finger 3"]
    elsewhere: Float[np.ndarray, " sample"]

    @property
    def touching(self) -> Bool[np.ndarray, "sample finger"]:
        """Where a finger touches."""
        return np.isfinite(self.point[:, :, 0])


def read_ball(path: str | os.PathLike) -> BallSpec:
    """Read what a pressure sensitive ball is: `radius`, `cells` (a map as for pressure arrays), [markers], `tare`, and
    `mass` if it is known.

    **Errors**: `FileError` naming the file and the key: a missing or unknown key, fewer than three markers, a cell off
    the surface.
    """
    path = Path(path)
    top = Table(path, "", read_toml(path))
    radius = top.number("radius", above=0.0)
    cells = cell_map(path.parent / top.text("cells"))
    table = top.table("markers")
    markers = tuple((name, table.vector(name)) for name in table.content)
    if len(markers) < 3:
        raise table.error(f"names {len(markers)} markers; the pose of a ball needs three")
    table.close()
    tare = top.take("tare", windows, "an interval [from, to] in s, or a list of them")
    mass = top.number("mass", None, above=0.0)
    top.close()
    for cell in cells:
        assert cell.position is not None  # a map of cells has positions
        away = float(np.linalg.norm(cell.position))
        if abs(away - radius) > 0.1 * radius:
            raise FileError(
                path, f"cell '{cell.channel}' is {away:.4g} m from the middle; the radius is {radius:.4g} m"
            )
    return BallSpec(path, radius, cells, markers, tare, mass)


def ball_contacts(
    ball: BallSpec,
    values: Float[np.ndarray, "sample cell"],
    pads: Float[np.ndarray, "sample finger 3"],
    radii: Float[np.ndarray, " finger"],
    threshold: Float[np.ndarray, " cell"],
    reach: float = 0.006,
) -> BallContacts:
    """Force, centre of pressure and normal of every fingertip from a map of pressure.

    A cell belongs to the nearest fingertip, if it is no further from its centre than its radius and `reach`. A finger
    touches where one of its cells is above its threshold; its force is the sum of its cells, those below included (they
    lie about zero, so what noise hides at the rim of a patch is not lost), its normal the mean direction of its cells
    above the threshold, weighted by their force:

        f = sum_i v_i,   n = m / norm(m),   m = sum_i v_i d_i,   r = R n.

    Only the normal force is measured. Cells as large as a patch make r uncertain by about a quarter of their pitch.

    **Arguments**

    - `values` N: of every cell, tared. `threshold` N: of every cell.
    - `pads` m: centres of the fingertips in the ball's frame; `radii` m.

    **Errors**: `ValueError` where the shapes do not fit the ball, or `reach` is not finite or negative.

    **Source**: Kry and Pai 2006, section 8.2; the assignment is ours.
    """
    samples, cells = values.shape
    if cells != len(ball.cells):
        raise ValueError(f"values has {cells} cells; {ball.path.name} names {len(ball.cells)}")
    if not (np.isfinite(reach) and reach >= 0.0):
        raise ValueError(f"reach must be finite and not negative, got {reach}")
    directions, fingers = ball.directions, pads.shape[1]
    distance = np.linalg.norm(pads[:, :, None, :] - ball.radius * directions, axis=3)
    near = distance <= (radii + reach)[None, :, None]
    owner = np.where(near.any(axis=1), np.argmin(np.where(near, distance, np.inf), axis=1), -1)
    loaded = values > threshold
    pressed, normal = np.zeros((samples, fingers)), np.full((samples, fingers, 3), np.nan)
    for finger in range(fingers):
        own = owner == finger
        sure = np.where(own & loaded, values, 0.0)
        touching = (own & loaded).any(axis=1)
        pressed[:, finger] = np.where(touching, np.sum(np.where(own, values, 0.0), axis=1), 0.0)
        mean = sure[touching] @ directions
        normal[touching, finger] = mean / np.linalg.norm(mean, axis=1, keepdims=True)
    return BallContacts(
        pressed=pressed,
        force=np.where(np.isfinite(normal), pressed[:, :, None] * np.nan_to_num(normal), 0.0),
        point=ball.radius * normal,
        normal=normal,
        elsewhere=np.sum(np.where(loaded & (owner < 0), values, 0.0), axis=1),
    )


def ball_pose(
    ball: BallSpec, motion: MotionFile, cutoff: float
) -> tuple[Float[np.ndarray, "frame 3 3"], Float[np.ndarray, "frame 3"]]:
    """Rotation and position (m) of a ball in every frame from its markers.

    In a frame with three or more visible markers the others are put where those say; then the markers are low-pass
    filtered (`cutoff`, Hz) and laid onto the ball. Where fewer are visible, straight lines bridge the gap.

    **Errors**: `FileError` for a marker that the file lacks, or where three are never visible at once.
    """
    names = [name for name, _ in ball.markers]
    for name in names:
        if name not in motion.marker_names:
            raise FileError(motion.path, f"has no marker '{name}', which {ball.path.name} [markers] names")
    local = np.array([place for _, place in ball.markers])
    places = np.stack([motion.marker(name) for name in names], axis=1)
    seen = np.asarray(np.isfinite(places).all(axis=2))
    if not (seen.sum(axis=1) >= 3).any():
        raise FileError(motion.path, f"shows three markers of the ball ({', '.join(names)}) in no frame at once")
    for frame in np.flatnonzero((seen.sum(axis=1) >= 3) & ~seen.all(axis=1)):
        R, p = rigid_registration(local[seen[frame]], places[frame, seen[frame]])
        places[frame, ~seen[frame]] = local[~seen[frame]] @ R.T + p
    smooth = lowpass(
        bridged(places, motion.marker_time), motion.marker_rate, min(cutoff, HIGHEST_CUTOFF * motion.marker_rate)
    )
    return rigid_registrations(local, smooth)
