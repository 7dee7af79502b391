"""The layer table of the design, enforced on the imports as written."""

import ast
from pathlib import Path

import pytest

LAYERS = [
    {"compiling", "typing", "results", "running"},
    {"spatial", "lcp", "inference"},
    {"geometry", "files"},
    {"model"},
    {"contact", "recording", "interaction", "rollout"},
    {"capture", "estimation", "synthesis", "laboratory"},
    {"grasp"},
    {"fit"},
    {"sweep", "view"},
    {"report", "export"},
    {"cli"},
    {"__main__"},
]
ROW = {room: row for row, rooms in enumerate(LAYERS) for room in rooms}
PACKAGE = Path(__file__).resolve().parents[1] / "icjax"
FILES = sorted(path for path in PACKAGE.rglob("*.py") if path != PACKAGE / "__init__.py")


def room_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_rooms(path: Path) -> set[str]:
    rooms = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = (node.module or "").split(".")
            if module == ["icjax"]:
                rooms |= {alias.name for alias in node.names if not alias.name.startswith("__")}
            elif module[0] == "icjax":
                rooms.add(module[1])
        elif isinstance(node, ast.Import):
            for alias in node.names:
                parts = alias.name.split(".")
                if parts[0] == "icjax" and len(parts) > 1:
                    rooms.add(parts[1])
    return rooms


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down_only(path):
    room = room_of(path)
    assert room in ROW, f"{room} has no place in the layer table"
    for other in imported_rooms(path) - {room}:
        assert ROW[other] < ROW[room], f"{path}: {room} (row {ROW[room]}) imports {other} (row {ROW[other]})"


def test_the_laboratory_shares_only_files():
    """The virtual laboratory must be independent of what it judges."""
    for path in (PACKAGE / "laboratory").glob("*.py"):
        assert imported_rooms(path) <= {"laboratory", "files", "typing"}, path


def test_private_modules_stay_private():
    """A package is used through its `__init__`, which re-exports names."""
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("icjax."):
                parts = node.module.split(".")
                private = [part for part in parts[2:] if part.startswith("_")]
                assert not private or parts[1] == room_of(path), f"{path} imports {node.module}"
