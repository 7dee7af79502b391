"""BVH files (Biovision): a skeleton and its joint angles."""

import os
from pathlib import Path

import numpy as np

from icjax.files._errors import FileError
from icjax.files._motion import MotionFile, no_markers, unique_labels
from icjax.files._table import number_rows, read_lines
from icjax.files._units import length_factor

CHANNELS = tuple(axis + kind for kind in ("position", "rotation") for axis in "XYZ")


def read_bvh(path: str | os.PathLike, length_unit: str = "cm") -> MotionFile:
    """Read a BVH file: every channel is an analog channel "Joint.Xrotation" (rad) or "Joint.Xposition" (m).

    A rotation channel turns about its axis of the joint's frame after the earlier ones in the file's order
    (intrinsic): channels Z, X, Y mean R = R_z R_x R_y from joint to parent. The skeleton is in `metadata`:
    "joints" (names, parents first), "parents" (index, -1 for a root), "offsets" (m, in the parent's frame),
    "channels" (names in the file's order) and "end_sites" (joint, offset in m). Frame i has the time i x Frame Time.

    **Arguments**: `length_unit` of offsets and positions, which the format does not state (a note says so).

    **Errors**: `FileError` naming the file and line when it is missing, truncated or no BVH, the hierarchy is
    malformed, or a frame has the wrong number of values or holds no finite number; `ValueError` for an unknown unit.
    """
    factor = length_factor(length_unit)
    if factor is None:
        raise ValueError(f"length_unit must be a unit of length, not '{length_unit}'")
    path = Path(path)
    reader = _Hierarchy(path, read_lines(path))
    reader.read()
    frames, step, body = reader.motion()
    columns = [(joint, channel) for joint, names in enumerate(reader.channels) for channel in names]
    rows = list(enumerate(reader.lines[body:], body + 1))
    table = number_rows(path, rows, None, len(columns))
    if len(table) < frames:
        raise FileError(path, f"holds {len(table)} of {frames} frames: truncated")
    if not len(table):
        raise FileError(path, "holds no frames")
    bad = ~np.isfinite(table)
    if bad.any():
        row, column = (int(item) for item in np.argwhere(bad)[0])
        raise FileError(path, f"frame {row + 1}, value {column + 1} is not a finite number")
    joints, notes = unique_labels(reader.joints, "joint")
    notes += (f"BVH states no unit of length; {length_unit} was assumed",)
    if len(table) > frames:
        notes += (f"the header states {frames} frames, the file holds {len(table)}",)
    rotation = np.array([channel.endswith("rotation") for _, channel in columns], dtype=bool)
    marker_names, marker_rate, marker_time, markers, marker_unit = no_markers()
    return MotionFile(
        path=os.fspath(path),
        marker_names=marker_names,
        marker_rate=marker_rate,
        marker_time=marker_time,
        markers=markers,
        marker_unit=marker_unit,
        analog_names=tuple(f"{joints[joint]}.{channel}" for joint, channel in columns),
        analog_units=tuple("deg" if turns else length_unit for turns in rotation),
        analog_rate=1.0 / step,
        analog_time=np.arange(len(table)) * step,
        analog=table * np.where(rotation, np.pi / 180.0, factor)[None, :],
        metadata={
            "joints": joints,
            "parents": tuple(reader.parents),
            "offsets": tuple(tuple(factor * value for value in offset) for offset in reader.offsets),
            "channels": tuple(reader.channels),
            "end_sites": tuple((joint, tuple(factor * value for value in offset)) for joint, offset in reader.ends),
        },
        notes=notes,
    )


class _Hierarchy:
    """Reads the part before the frames line by line; `place` is the next line."""

    def __init__(self, path: Path, lines: list[str]):
        self.path, self.lines, self.place = path, lines, 0
        self.joints: list[str] = []
        self.parents: list[int] = []
        self.offsets: list[tuple[float, ...]] = []
        self.channels: list[tuple[str, ...]] = []
        self.ends: list[tuple[int, tuple[float, ...]]] = []

    def words(self, expected: str) -> list[str]:
        """Words of the next line that is not blank."""
        while self.place < len(self.lines):
            self.place += 1
            words = self.lines[self.place - 1].split()
            if words:
                return words
        raise FileError(self.path, f"ends where {expected} should follow: truncated")

    def wrong(self, expected: str) -> FileError:
        found = self.lines[self.place - 1].strip()
        return FileError(self.path, f"line {self.place}: '{found[:40]}' where {expected} should be")

    def exactly(self, word: str) -> None:
        if self.words(f"'{word}'") != [word]:
            raise self.wrong(f"'{word}'")

    def numbers(self, words: list[str], count: int, expected: str) -> tuple[float, ...]:
        try:
            values = tuple(float(word) for word in words)
        except ValueError:
            raise self.wrong(expected) from None
        if len(values) != count or not np.isfinite(values).all():
            raise self.wrong(expected)
        return values

    def read(self) -> None:
        """HIERARCHY up to MOTION, with a stack instead of recursion: any depth is read."""
        if self.words("'HIERARCHY'") != ["HIERARCHY"]:
            raise FileError(self.path, "is not a BVH file (its first line is not 'HIERARCHY')")
        stack: list[int] = []
        while True:
            expected = "'ROOT', 'JOINT', 'End Site', '}' or 'MOTION'"
            words = self.words(expected)
            if words == ["MOTION"] and not stack and self.joints:
                return
            if words[0] == ("JOINT" if stack else "ROOT") and len(words) > 1:
                self._joint(" ".join(words[1:]), stack)
            elif words[:2] == ["End", "Site"] and stack:
                self.exactly("{")
                self.ends.append((stack[-1], self._offset()))
                self.exactly("}")
            elif words == ["}"] and stack:
                stack.pop()
            else:
                raise self.wrong(expected)

    def _joint(self, name: str, stack: list[int]) -> None:
        self.exactly("{")
        self.joints.append(name)
        self.parents.append(stack[-1] if stack else -1)
        self.offsets.append(self._offset())
        expected = "'CHANNELS', their number and their names"
        words = self.words(expected)
        names = tuple(words[2:])
        known = len(set(names)) == len(names) and set(names) <= set(CHANNELS)
        if words[:2] != ["CHANNELS", str(len(names))] or not known:
            raise self.wrong(expected)
        self.channels.append(names)
        stack.append(len(self.joints) - 1)

    def _offset(self) -> tuple[float, ...]:
        expected = "'OFFSET' and three numbers"
        words = self.words(expected)
        if words[0] != "OFFSET":
            raise self.wrong(expected)
        return self.numbers(words[1:], 3, expected)

    def motion(self) -> tuple[int, float, int]:
        """Number of frames, seconds a frame, and the index of the first line of values."""
        expected = "'Frames:' and their number"
        words = self.words(expected)
        if words[0] != "Frames:" or len(words) != 2 or not (words[1].isascii() and words[1].isdigit()):
            raise self.wrong(expected)
        if len(words[1]) > 9:
            raise self.wrong("a number of frames below 1000000000")
        frames = int(words[1])
        expected = "'Frame Time:' and a positive number of seconds"
        words = self.words(expected)
        if words[:2] != ["Frame", "Time:"]:
            raise self.wrong(expected)
        (step,) = self.numbers(words[2:], 1, expected)
        if not (step > 0 and np.isfinite(1.0 / step)):
            raise self.wrong(expected)
        return frames, step, self.place
