"""The one error that bad files raise."""

import os


class FileError(ValueError):
    """A file that cannot be used: names the file and, where known, the channel, marker, row or key.

    `str(error)` is one line for people: ``session.toml: [trial 2] unknown key 'touchs'``.
    """

    def __init__(self, path: str | os.PathLike, message: str):
        self.path = os.fspath(path)
        self.message = message
        super().__init__(f"{self.path}: {message}")

    def __reduce__(self):  # so that it comes back from another process
        return FileError, (self.path, self.message)
