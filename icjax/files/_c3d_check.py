"""Is this file a whole and consistent C3D? Checked on the bytes before a compiled reader sees them.

A compiled reader may end the process, exhaust the memory or return half a recording when a file is truncated or
damaged. Everything that sizes an allocation or a loop is therefore verified here first: the header, the chain of
parameters, and the data section they describe.
"""

import math
import struct
from pathlib import Path
from typing import NamedTuple

from icjax.files._errors import FileError

BLOCK = 512
KEY = 0x50
BYTE_ORDER = {84: "<", 85: "<", 86: ">"}
"""Processor number of the parameter section (Intel, DEC, MIPS) to the byte order of its integers."""

FRAME_LIMIT = 65535
"""Largest frame number that the header can hold; longer recordings state theirs in TRIAL or POINT:FRAMES."""

NEEDED = (("POINT", "USED"), ("POINT", "SCALE"), ("POINT", "RATE"), ("POINT", "LABELS"))


class Entry(NamedTuple):
    """A parameter as stored: element type (-1 text, 1 byte, 2 integer, 4 float), dimensions, bytes."""

    kind: int
    dimensions: tuple[int, ...]
    data: bytes


def check_c3d(path: Path) -> int:
    """Number of frames of a whole C3D file. **Errors**: `FileError` naming the file and what is wrong with it."""
    if not path.is_file():
        raise FileError(path, "does not exist")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileError(path, f"cannot be read: {error}") from error
    if len(data) < 2 or data[1] != KEY:
        raise FileError(path, "is not a C3D file (its second byte is not 0x50)")
    if len(data) < 2 * BLOCK:
        raise FileError(path, f"is truncated: {len(data)} bytes, fewer than a header and one parameter block")
    section = (data[0] - 1) * BLOCK
    if section < BLOCK or section + 4 > len(data):
        raise FileError(path, f"is damaged: the parameter section should begin at byte {section} of {len(data)}")
    order = BYTE_ORDER.get(data[section + 3])
    if order is None:
        raise FileError(path, f"is damaged: processor number {data[section + 3]} is not 84, 85 or 86")
    points, analog_values, first, last = struct.unpack_from(order + "4H", data, 2)
    start_block, per_frame = struct.unpack_from(order + "2H", data, 16)
    start = (start_block - 1) * BLOCK
    if start <= section or start > len(data):
        raise FileError(path, f"is damaged or truncated: data should begin at byte {start} of {len(data)}")
    entries = _parameters(path, data[:start], section + 4, order)
    for group, name in NEEDED:
        if (group, name) not in entries and not (points == 0 and name == "LABELS"):
            raise FileError(path, f"parameter {group}:{name} is missing")
    _agree(path, entries, points, analog_values, per_frame, order)
    frames = _frames(path, entries, first, last, order)
    width = 4 if struct.unpack(order + "H", entries["POINT", "SCALE"].data[2:4])[0] & 0x8000 else 2
    if order == "<" and data[section + 3] == 85:
        width = 4 if entries["POINT", "SCALE"].data[1] & 0x80 else 2
    needed = frames * (4 * points + analog_values) * width
    if start + needed > len(data):
        whole = (len(data) - start) // max((4 * points + analog_values) * width, 1)
        raise FileError(path, f"is truncated: {whole} of {frames} frames are in the file")
    _rotations(path, entries, frames, start, len(data), order)
    return frames


def _rotations(
    path: Path, entries: dict[tuple[str, str], Entry], frames: int, start: int, size: int, order: str
) -> None:
    """Segment poses (group ROTATION, 17 floats each) must lie in the file where the group says."""
    names = ("USED", "DATA_START", "RATIO")
    used, block, ratio = ((_integers(path, entries, "ROTATION", name, order) or [0])[0] for name in names)
    begin = (block - 1) * BLOCK
    if used and (ratio < 1 or begin < start or begin + frames * ratio * used * 17 * 4 > size):
        raise FileError(path, f"is damaged or truncated: {used} segment poses (group ROTATION) are not in the file")


def _parameters(path: Path, data: bytes, position: int, order: str) -> dict[tuple[str, str], Entry]:
    """Walk the chain of groups and parameters; every offset must lie within the section."""
    groups: dict[int, str] = {}
    found: list[tuple[int, str, Entry]] = []

    def take(count: int) -> bytes:
        nonlocal position
        if count < 0 or position + count > len(data):
            raise FileError(path, f"is damaged: the parameter section ends within an entry (byte {position})")
        position += count
        return data[position - count : position]

    while position + 2 <= len(data):
        length, number = struct.unpack("bb", take(2))
        if length == 0 or number == 0:
            break
        name = take(abs(length)).decode("latin-1").upper()
        anchor = position
        offset = struct.unpack(order + "h", take(2))[0]
        if number < 0:
            groups[-number] = name
        else:
            kind = struct.unpack("b", take(1))[0]
            if kind not in (-1, 1, 2, 4):
                raise FileError(path, f"is damaged: parameter {name!a} has the element type {kind}")
            dimensions = tuple(take(take(1)[0]))
            if kind == -1 and not dimensions:  # legal, but ezc3d crashes on it
                raise FileError(path, f"is damaged: text parameter {name!a} has no dimensions")
            found.append((number, name, Entry(kind, dimensions, take(math.prod(dimensions) * abs(kind)))))
        take(take(1)[0])  # description
        if offset == 0:
            break
        if offset < 2 or anchor + offset > len(data) or anchor + offset < position:
            raise FileError(
                path, f"is damaged: entry {name!a} of the parameter section points to byte {anchor + offset}"
            )
        position = anchor + offset
    for number, name, _ in found:
        if number not in groups:
            raise FileError(path, f"is damaged: parameter {name!a} belongs to no group")
    return {(groups[number], name): entry for number, name, entry in found}


def _integers(path: Path, entries: dict[tuple[str, str], Entry], group: str, name: str, order: str) -> list[int] | None:
    """Values of an integer parameter, unsigned as the larger recordings need; whole floats are accepted."""
    entry = entries.get((group, name))
    if entry is None:
        return None
    if not entry.data:  # ezc3d reads its first number without looking
        raise FileError(path, f"is damaged: parameter {group}:{name} holds no number")
    if entry.kind == 2:
        return list(struct.unpack(f"{order}{len(entry.data) // 2}H", entry.data))
    if entry.kind == 1:
        return list(entry.data)
    if entry.kind == 4:
        values = struct.unpack(f"{order}{len(entry.data) // 4}f", entry.data)
        if all(math.isfinite(value) and 0 <= value < 2**31 for value in values):
            return [int(value) for value in values]
    raise FileError(path, f"is damaged: parameter {group}:{name} holds no whole number")


def _agree(
    path: Path,
    entries: dict[tuple[str, str], Entry],
    points: int,
    analog_values: int,
    per_frame: int,
    order: str,
) -> None:
    """Header and parameters must tell the same numbers of points and analog channels."""
    used = _integers(path, entries, "POINT", "USED", order)
    if used is None or used[0] != points:
        raise FileError(path, f"is damaged: the header states {points} points, POINT:USED {used and used[0]}")
    channels = (_integers(path, entries, "ANALOG", "USED", order) or [0])[0]
    if channels * per_frame != analog_values and (channels or analog_values):
        raise FileError(
            path,
            f"is damaged: the header states {analog_values} analog values a frame, "
            f"ANALOG:USED {channels} channels of {per_frame} samples",
        )
    for group, name, kind, count in _sizes(points, channels):
        parts = [entries[group, key] for key in (name, f"{name}2", f"{name}3") if (group, key) in entries]
        if not parts:
            raise FileError(path, f"parameter {group}:{name} is missing")
        stored = sum(len(part.data) // abs(kind) for part in parts)
        if any(part.kind != kind for part in parts) or stored < count:
            raise FileError(path, f"is damaged: parameter {group}:{name} does not hold {count} numbers")
    if not any(entries["POINT", "SCALE"].data[:4]):
        raise FileError(path, "is damaged: POINT:SCALE is zero")
    for group, name in (("POINT", "LABELS"), ("ANALOG", "LABELS")):
        entry = entries.get((group, name))
        if entry is not None and entry.data and entry.kind != -1:
            raise FileError(path, f"is damaged: parameter {group}:{name} is not text")


def _sizes(points: int, channels: int) -> list[tuple[str, str, int, int]]:
    """(group, name, element type, least number of elements) of what a reader indexes without looking."""
    needed = [("POINT", "SCALE", 4, 1), ("POINT", "RATE", 4, 1)]
    if channels:
        needed += [("ANALOG", "GEN_SCALE", 4, 1), ("ANALOG", "SCALE", 4, channels), ("ANALOG", "OFFSET", 2, channels)]
    return needed


def _frames(path: Path, entries: dict[tuple[str, str], Entry], first: int, last: int, order: str) -> int:
    """Number of frames on which the header and at least one parameter agree, if any parameter states it."""
    header = last - first + 1
    stated = _integers(path, entries, "POINT", "FRAMES", order)
    begin = _integers(path, entries, "TRIAL", "ACTUAL_START_FIELD", order)
    end = _integers(path, entries, "TRIAL", "ACTUAL_END_FIELD", order)
    others = [] if stated is None else [stated[0]]
    if begin and end:
        others.append(_field(end) - _field(begin) + 1)
    if header in others or not others:
        frames = header
    elif last == FRAME_LIMIT or len(set(others)) == 1 and others[0] >= FRAME_LIMIT:
        frames = max(others)
    else:
        told = " and ".join(str(number) for number in others)
        raise FileError(path, f"is damaged: the header states {header} frames, the parameters {told}")
    if frames <= 0:
        raise FileError(path, "holds no frames")
    return frames


def _field(words: list[int]) -> int:
    """A frame number stored as one number or as low and high 16-bit words."""
    return words[0] + (words[1] << 16 if len(words) > 1 else 0)
