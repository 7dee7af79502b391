"""Small good files of every format that icjax reads, and seeded ways to damage them."""

import random
import re
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

FORMATS = ("c3d", "trc", "mot", "tsv", "bvh", "csv", "session", "scene")

NASTY_TEXT = ("nan", "NaN", "inf", "-1", "0", "-0", "1e400", "1e308", "1e-320", "999999999", "1000000000000000000000")
NASTY_TEXT += (
    "",
    "x",
    "[",
    "]",
    '"',
    "true",
    "{}",
    "[1, 2]",
    "\ufeff",
    "\u0661",
    "\x85",
    "1_0",
    "0x10",
    "é",
    "A" * 300,
)
NASTY_WORDS = [struct.pack("<H", item) for item in (0, 1, 2, 255, 256, 0x7FFF, 0x8000, 0xFFFF)]
NASTY_WORDS += [struct.pack("<f", item) for item in (0.0, -1.0, 1e9, 1e38, -1e-38, float("nan"), float("inf"))]

BVH = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Leg
  {
    OFFSET 0 -5 1
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 -40 0
    }
  }
}
MOTION
Frames: 3
Frame Time: 0.008
100 90 0 10 20 30 1 2 3
101 91 1 11 21 31 2 3 4
102 92 2 12 22 32 3 4 5
"""

CSV = "time,A_x,A_y,A_z,B_x,B_y,B_z,Fz\n" + "".join(f"{i / 100},1,2,{i},4,5,6,{i}.5\n" for i in range(8))

SCENE = """name = "bump"
step = 0.002
facets = 4
friction = 0.9
gravity = [0, 0, -9.81]
contacts = 6
limits = 2
[[surface]]
name = "plate"
shape = "plane"
point = [0.0, 0.0, 0.0]
normal = [0.0, 0.0, 1.0]
[[surface]]
name = "bump"
shape = "ellipsoid"
centre = [0.0, 0.0, 0.0]
radii = [0.012, 0.035, 0.003]
rotation = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
friction = 0.5
[[surface]]
shape = "wedge"
width = 0.03
height = 0.04
depth = 0.02
tilt_degrees = 5
position = [0.1, 0, 0.02]
quaternion = [0.7071, 0.7071, 0, 0]
[[surface]]
shape = "capsule"
radius = 0.01
half_length = 0.03
position = [0.2, 0, 0]
[[object]]
name = "box"
shape = "box"
half_sizes = [0.01, 0.02, 0.03]
mass = 0.1
com = [0, 0, -0.01]
inertia = [[3e-5, 0, 0], [0, 3e-5, 0], [0, 0, 1e-5]]
position = [0, 0.1, 0.03]
velocity = [0.1, 0, 0]
angular_velocity = [0, 0, 1]
[[object]]
name = "die"
shape = "prism"
outline = [[0, 0], [0.01, 0], [0, 0.01]]
half_length = 0.01
density = 1000
position = [0, 0.2, 0.03]
[[object]]
shape = "cylinder"
radius = 0.01
half_length = 0.02
mass = 0.1
friction = 0.4
position = [0, 0.3, 0.02]
[[object]]
shape = "sphere"
radius = 0.01
mass = 0.1
position = [0, 0.4, 0.01]
[[pair]]
names = ["box", "plate"]
friction = 0.2
"""

SESSION = """name = "small"
subject = "nobody"
folder = "."
[model]
builtin = "index_finger"
hand_length = 0.19
root = "free"
placement_sd = 0.001
[markers]
FA1 = "FA1"
HA1 = "HA1"
[filter]
markers = 20.0
[contact]
onset = 0.05
release = 0.03
[columns]
time = "t"
[[source]]
name = "plate"
kind = "six_axis"
channels = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]
position = [0, 0, -0.026]
rotation = [[0, 1, 0], [1, 0, 0], [0, 0, -1]]
sign = "on_environment"
surface = { point = [0, 0, 0], normal = [0, 0, 1] }
tare = [0.0, 0.2]
[[trial]]
name = "one"
file = "one.c3d"
touches = { plate = "fingertip" }
friction = 0.9
[[trial]]
name = "again"
file = "one.c3d"
role = "catch"
catch_of = "one"
"""


def seed_files(kind: str, folder: Path, shared: Path | None) -> list[bytes]:
    """Good files of one format: made here with icjax's writers, and cut from other people's where `shared` is given."""
    from icjax.files import write_sto, write_trc

    rng = np.random.default_rng(0)
    time = np.arange(9) / 100.0
    if kind == "c3d":
        vicon = [] if shared is None else [(shared / "btk_pig" / "PiG_Calibration-FlatFoot-One.c3d").read_bytes()]
        return [_c3d(folder / "seed.c3d").read_bytes(), *vicon]
    if kind == "trc":
        markers = rng.normal(size=(9, 3, 3))
        markers[2:4, 1] = np.nan
        made = write_trc(folder / "seed.trc", marker_names=("A", "B", "C"), markers=markers, time=time, rate=100.0)
        return [made.read_bytes(), *_cut(shared, "opensim_core_gait/walk3d/markers_walk.trc", 10, (r"\b238\b", "4"))]
    if kind == "mot":
        names = ("f_vx", "f_vy", "f_px", "f_torque_x")
        made = write_sto(folder / "seed.mot", time=time, names=names, values=rng.normal(size=(9, 4)))
        return [
            made.read_bytes(),
            *_cut(shared, "opensim_core_gait/walk3d/grf_walk.mot", 15, (r"nRows=\d+", "nRows=8")),
        ]
    if kind == "tsv":
        head = "NO_OF_FRAMES\t9\nNO_OF_CAMERAS\t7\nNO_OF_MARKERS\t2\nFREQUENCY\t100\nDATA_INCLUDED\t3D\n"
        head += "TIME_STAMP\t2021-08-26, 15:19:24.317\t1483034.6\nEVENT\tgo\t2\t0.01\nMARKER_NAMES\tA\tB\n"
        head += "Frame\tTime\tA X\tA Y\tA Z\tB X\tB Y\tB Z\n"
        rows = "".join(f"{i + 1}\t{i / 100}\t1\t2\t{i}\t\t\t\n" for i in range(9))
        name = "hand_mocap_dfki/recording_first40s.tsv"
        return [(head + rows).encode(), *_cut(shared, name, 20, (r"FRAMES\t4000", "FRAMES\t8"))]
    return [{"bvh": BVH, "csv": CSV, "session": SESSION, "scene": SCENE}[kind].encode()]


def _c3d(path: Path) -> Path:
    from icjax.files import ForcePlate, MotionEvent, write_c3d

    rng = np.random.default_rng(0)
    markers = rng.normal(size=(6, 3, 3))
    markers[2:4, 1] = np.nan
    corners = np.array([[0.5, 0.4, 0.0], [0.0, 0.4, 0.0], [0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    down = np.array([0.0, 0.0, -0.04])
    return write_c3d(
        path,
        marker_names=("A", "B", "C"),
        markers=markers,
        marker_rate=100.0,
        analog_names=tuple(f"ch{index}" for index in range(13)),
        analog_units=("N", "N", "N", "Nmm", "Nmm", "Nmm") * 2 + ("V",),
        analog=rng.normal(size=(12, 13)),
        analog_rate=200.0,
        plates=(
            ForcePlate(2, corners, down, tuple(range(6))),
            ForcePlate(4, corners + 1.0, down, tuple(range(6, 12)), np.eye(6)),
        ),
        events=(MotionEvent("Foot Strike", "Left", 0.02), MotionEvent("Foot Off", "Right", 0.05)),
        first_frame=3,
    )


def _cut(shared: Path | None, name: str, lines: int, change: tuple[str, str]) -> list[bytes]:
    """First lines of somebody's text file, with the number of frames that its header states set to what is left."""
    if shared is None:
        return []
    with open(shared / name, newline="") as file:
        text = "".join(line for line, _ in zip(file, range(lines), strict=False))
    return [re.sub(*change, text).encode()]


def damaged(data: bytes, kind: str, rng: random.Random) -> bytes:
    """The file after one to three mutations."""
    ways = BINARY if kind == "c3d" else TEXT
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(ways)(data, rng)
    return data


def _flip(data: bytes, rng: random.Random) -> bytes:
    changed = bytearray(data)
    for _ in range(rng.choice((1, 2, 8))):
        if changed:
            changed[_place(changed, rng)] = rng.choice((0, 0xFF, rng.randrange(256)))
    return bytes(changed)


def _place(data: bytes | bytearray, rng: random.Random) -> int:
    """A byte, the header and the parameters more often than the data."""
    return rng.randrange(rng.choice((min(512, len(data)), min(4096, len(data)), len(data))))


def _truncate(data: bytes, rng: random.Random) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _block(data: bytes, rng: random.Random) -> bytes:
    """A block deleted, repeated, zeroed or moved."""
    start = rng.randrange(len(data) + 1)
    stop = min(len(data), start + rng.choice((1, 2, 7, 64, 512)))
    block = data[start:stop]
    middle = rng.choice((b"", block * 2, block * 50, bytes(len(block)), block[::-1]))
    return data[:start] + middle + data[stop:]


def _word(data: bytes, rng: random.Random) -> bytes:
    """A 16-bit word or a float set to an extreme value: counts, dimensions, offsets."""
    if not data:
        return data
    changed = bytearray(data)
    word = rng.choice(NASTY_WORDS)
    place = _place(changed, rng)
    changed[place : place + len(word)] = word
    return bytes(changed)


def _lines(data: bytes, rng: random.Random) -> bytes:
    """Lines swapped, repeated or deleted."""
    lines = data.splitlines(keepends=True)
    if len(lines) < 2:
        return data
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    way = rng.randrange(4)
    if way == 0:
        lines[i], lines[j] = lines[j], lines[i]
    elif way == 1:
        del lines[min(i, j) : max(i, j) + 1]
    elif way == 2:
        lines.insert(i, lines[j])
    else:
        lines[i : i + 1] = [lines[i]] * rng.choice((2, 100))
    return b"".join(lines)


def _cell(data: bytes, rng: random.Random) -> bytes:
    """A number, a word or a separator replaced."""
    pattern = rng.choice((rb"[-+\d][\d.]*", rb"[A-Za-z_]+", rb"[\t ,=\"\[\]{}]", rb"\n"))
    found = list(re.finditer(pattern, data))
    if not found:
        return data
    match = rng.choice(found[: rng.choice((10, len(found)))])
    word = rng.choice(NASTY_TEXT).encode()
    return data[: match.start()] + word + data[match.end() :]


BINARY: tuple[Callable[[bytes, random.Random], bytes], ...] = (_flip, _flip, _word, _word, _word, _block, _truncate)
TEXT: tuple[Callable[[bytes, random.Random], bytes], ...] = (_flip, _block, _lines, _cell, _cell, _cell, _truncate)
