"""Record a ball that measures pressure while a hand lifts and rolls it, or turns it by gaiting."""

import csv
import dataclasses
import os
from pathlib import Path

import numpy as np

from icjax.files import write_c3d
from icjax.laboratory._gait import Gait, gait_command
from icjax.laboratory._grasp import simulate_grasp
from icjax.laboratory._grasp_session import check_timestep, session_head, write_hand
from icjax.laboratory._hand import Hand
from icjax.laboratory._hand_model import described_xml
from icjax.laboratory._instruments import Markers, Noise, cameras, place, restless_hand
from icjax.laboratory._lift import Lift, lift_command
from icjax.laboratory._movement import RATE
from icjax.laboratory._pressure_ball import PressureBall, measured, pressure_map
from icjax.laboratory._record import Paths
from icjax.laboratory._stand import Stand

BALL_LIFT = Lift(grip=0.032, open=0.056, height=0.020, roll=0.010, settle=0.3, rise=0.4, hold=1.6)
"""A low lift, then the ball is rolled between thumb and fingers, there and back."""


def ball_session(
    folder: str | os.PathLike,
    *,
    seed: int,
    ball: PressureBall | None = None,
    hand: Hand | None = None,
    lift: Lift | Gait = BALL_LIFT,
    noise: Noise | None = None,
    timestep: float = 0.00025,
) -> Paths:
    """Let a simulated hand lift and roll, or turn by gaiting, a ball that measures the pressure on its surface.

    Nothing is worn on the fingertips. Writes `ball.c3d` (markers of hand and ball), `ball_pressure.csv` (time and the
    pressure of every cell, Pa, at the ball's own rate, on the markers' clock), `ball.toml` with `cells.csv` (what the
    ball is, for `icjax.capture.read_ball`), `session.toml`, `hand.xml` and `truth/`. The same seed gives the same data.

    **Arguments**

    - `seed`: of everything random.
    - `ball`: its size and its cells. `hand`: the subject.
    - `lift`: the movement, a lift from the table or a `Gait`, for which the ball lies in a `Stand`.
    - `noise`: of cameras and subject. `timestep`: of the simulation, s.

    **Returns** the paths written. **Errors**: as for `grasp_session`.

    **Source**: Kry and Pai 2006, section 8.2.
    """
    if not (0 <= seed < 2**63):
        raise ValueError(f"seed must be between 0 and {2**63 - 1}, got {seed}")
    check_timestep(timestep)
    ball, hand, noise = ball or PressureBall(), hand or Hand(), noise or Noise()
    if ball.diameter >= lift.open:
        raise ValueError(f"ball: diameter {ball.diameter} m; the hand opens to {lift.open} m (open of lift)")
    turned = isinstance(lift, Gait)
    planned, stand = (gait_command(hand, lift), Stand()) if turned else (lift_command(hand, lift), None)
    placed = place(hand.markers() | ball.markers(turned), noise, np.random.default_rng([seed, 0]))
    gain = 1.0 + ball.gain * np.random.default_rng([seed, 1]).standard_normal(ball.cells)
    generator = np.random.default_rng([seed, 2])
    thing = ball.thing("ball")
    motion = simulate_grasp(hand, thing, restless_hand(planned, noise, generator), placed, timestep, stand)
    time, pressure = pressure_map(ball, hand, motion.truth)

    folder = Path(folder)
    trial = write_c3d(
        folder / "ball.c3d",
        marker_names=list(motion.marker_names),
        markers=cameras(motion.marker_names, motion.markers, noise, generator),
        marker_rate=RATE,
    )
    channels = [f"P{number:04d}" for number in range(1, ball.cells + 1)]
    values = measured(ball, pressure, gain, generator)
    with (folder / "ball_pressure.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", *channels])
        writer.writerows(
            [f"{now:.6f}", *(f"{value:.6g}" for value in row)] for now, row in zip(time, values, strict=True)
        )
    _write_ball(folder, ball, channels, ball.markers(turned))
    truth = [motion.truth.save(folder / "truth" / "ball.npz")]
    extra = {"ball": dataclasses.asdict(ball), "cell_gain": gain.tolist()}
    truth.append(write_hand(folder / "truth", seed, hand, [thing], lift, timestep, placed, extra))
    (folder / "hand.xml").write_text(described_xml(hand, folder.name or "laboratory"))
    session = folder / "session.toml"
    lines = [*session_head(folder.name, hand, noise), "", "[[trial]]", 'name = "ball"', 'file = "ball.c3d"']
    session.write_text("\n".join([*lines, f"friction = {ball.friction!r}"]) + "\n")
    return Paths(session=session, trials=(trial,), catches=(), truth=tuple(truth))


def _write_ball(folder: Path, ball: PressureBall, channels: list[str], markers: Markers) -> None:
    """The ball as its maker would describe it: cells and nominal markers in its own frame, middle at the origin."""
    with (folder / "cells.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["channel", "x", "y", "z", "nx", "ny", "nz", "area"])
        for channel, direction in zip(channels, ball.directions, strict=True):
            numbers = [*(0.5 * ball.diameter * direction), *direction, ball.area]
            writer.writerow([channel, *(f"{value:.9g}" for value in numbers)])
    lines = ["# Simulated by icjax.laboratory.", f"radius = {0.5 * ball.diameter!r}", 'cells = "cells.csv"']
    lines += [f"mass = {ball.mass!r}", "tare = [0.0, 0.2]", "", "[markers]"]
    for label, (_, position) in markers.items():
        lines.append(f"{label} = [{', '.join(f'{value:.9g}' for value in position)}]")
    (folder / "ball.toml").write_text("\n".join(lines) + "\n")
