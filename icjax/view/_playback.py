"""Where in time a player is."""

import numpy as np


class Playback:
    """A moment that moves through the times of a record while it plays, and begins again at the end.

    **Fields**: `at` s; `playing`; `speed` in times real time.
    """

    def __init__(self, time: np.ndarray, playing: bool = True, speed: float = 1.0):
        self.time, self.playing, self.speed = np.asarray(time, float), playing, speed
        self.at = float(self.time[0])

    def advance(self, seconds: float) -> bool:
        """Let time pass. **Returns**: whether the moment has moved."""
        start, length = float(self.time[0]), float(self.time[-1] - self.time[0])
        if not self.playing or length <= 0:
            return False
        self.at = start + (self.at - start + self.speed * seconds) % length
        return True

    def go_to(self, moment: float) -> None:
        """Jump, within the record."""
        self.at = float(np.clip(moment, self.time[0], self.time[-1]))

    def replace(self, time: np.ndarray) -> None:
        """Play other times, from the same moment on where they have it."""
        self.time = np.asarray(time, float)
        self.go_to(self.at)

    @property
    def row(self) -> int:
        """The frame nearest to the moment."""
        after = int(np.clip(np.searchsorted(self.time, self.at), 1, max(len(self.time) - 1, 1)))
        if len(self.time) == 1:
            return 0
        return after - int(self.at - self.time[after - 1] <= self.time[after] - self.at)
