"""Scene files: what is read, and one clear line for what cannot be."""

import json

import numpy as np
import pytest

from icjax.files import FileError
from icjax.geometry import Ellipsoid, Plane
from icjax.synthesis import Scene, Surface, read_scene

GOOD = """
name = "bumpy"
step = 0.001
facets = 6
friction = 0.9
[[surface]]
name = "plate"
shape = "plane"
point = [0, 0, 0.5]
normal = [0, 0, 2]
[[surface]]
name = "bump"
shape = "ellipsoid"
centre = [0.1, 0.2, 0.3]
radii = [0.012, 0.035, 0.003]
rotation = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
friction = 0.4
"""


def test_read(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(GOOD)
    scene = read_scene(path)
    plate, bump = scene.surfaces
    assert (scene.name, scene.step, scene.facets) == ("bumpy", 0.001, 6)
    assert isinstance(plate.shape, Plane)
    assert isinstance(bump.shape, Ellipsoid)
    assert (float(plate.friction), float(bump.friction)) == (0.9, 0.4)
    np.testing.assert_array_equal(bump.shape.radii, [0.012, 0.035, 0.003])
    described = json.loads(scene.describe())
    assert described["surfaces"][0] == {
        "name": "plate", "friction": 0.9, "shape": "plane", "point": [0.0, 0.0, 0.5], "normal": [0.0, 0.0, 1.0]
    }  # fmt: skip
    assert described["surfaces"][1]["rotation"] == [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


BAD = {
    "toml": ("name =", "name", "is not valid TOML"),
    "top key": ('name = "bumpy"', "nmae = 1", "unknown key 'nmae'; did you mean 'name'"),
    "surface key": ("normal = [0, 0, 2]", "normal = [0, 0, 2]\nradius = 1", "1 'plate': has the unknown key 'radius'"),
    "shape": ('"ellipsoid"', '"cube"', "2 'bump': key 'shape' must be one of 'plane', 'ellipsoid', not 'cube'"),
    "missing": ("centre = [0.1, 0.2, 0.3]", "", "2 'bump': needs the key 'centre'"),
    "size": ("[0.1, 0.2, 0.3]", "[0.1, 0.2]", "2 'bump': key 'centre' must be three numbers"),
    "text": ("[0.1, 0.2, 0.3]", '"here"', "2 'bump': key 'centre' must be three numbers"),
    "radii": ("0.003]", "0.0]", "2 'bump': key 'radii' must be more than 0 m"),
    "normal": ("[0, 0, 2]", "[0, 0, 0]", "1 'plate': key 'normal' must not be zero"),
    "rotation": ("[0, 0, 1]]", "[0, 0, -1]]", "2 'bump': key 'rotation' must be three rows of a rotation matrix"),
    "friction": ("friction = 0.4", "friction = -0.4", "2 'bump': key 'friction' must be a number of at least 0"),
    "no friction": ("friction = 0.9", "", "1 'plate': needs the key 'friction'"),
    "name": ('name = "plate"', 'name = "bump"', "2: the name 'bump' is taken"),
    "facets": ("facets = 6", "facets = 1", "key 'facets' must be a whole number of at least 2"),
    "step": ("step = 0.001", "step = 0", "key 'step' must be a number above 0"),
    "infinite": ("step = 0.001", "step = inf", "key 'step' must be a number"),
}


@pytest.mark.parametrize(("old", "new", "message"), BAD.values(), ids=BAD.keys())
def test_bad_files_are_named_in_one_line(tmp_path, old, new, message):
    assert GOOD.count(old) >= 1
    path = tmp_path / "scene.toml"
    path.write_text(GOOD.replace(old, new, 1))
    with pytest.raises(FileError, match=message) as caught:
        read_scene(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_no_file_and_no_surface(tmp_path):
    with pytest.raises(FileError, match="does not exist"):
        read_scene(tmp_path / "none.toml")
    path = tmp_path / "empty.toml"
    path.write_text('name = "empty"\n')
    with pytest.raises(FileError, match=r"needs at least one \[\[surface\]\]"):
        read_scene(path)


def test_scenes_made_in_python_are_checked():
    plate = Surface("plate", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), 0.5)
    with pytest.raises(ValueError, match="surfaces is empty"):
        Scene("none", ())
    with pytest.raises(ValueError, match="one name twice"):
        Scene("twice", (plate, plate))
    with pytest.raises(ValueError, match="facets must be at least 2"):
        Scene("facets", (plate,), 1)
    with pytest.raises(ValueError, match="step must be a positive time"):
        Scene("step", (plate,), 4, 0.0)
