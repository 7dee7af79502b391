"""Is this file a whole C3D? Checked on the bytes first, because a damaged file can end the process inside a
compiled reader."""

from pathlib import Path

from icjax.files._errors import FileError

BLOCK = 512


def check_c3d(path: Path) -> None:
    """Raise `FileError` unless the header, parameter section and data section lie within the file."""
    if not path.is_file():
        raise FileError(path, "does not exist")
    data = path.read_bytes()
    if len(data) < 2 * BLOCK:
        raise FileError(path, f"is not a C3D file: {len(data)} bytes are fewer than a header and a parameter block")
    if data[1] != 0x50:
        raise FileError(path, "is not a C3D file (second byte is not 0x50)")
