"""Scene files: what is read, and one clear line for what cannot be."""

import json

import jax
import numpy as np
import pytest
import trimesh

from icjax.files import FileError
from icjax.geometry import Box, Capsule, Cylinder, Ellipsoid, Placed, Plane, Prism, Sphere, Union, wedge
from icjax.model import load_model
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, read_scene, slot_names

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
    "shape": (
        '"ellipsoid"',
        '"cube"',
        "2 'bump': key 'shape' must be one of 'plane', 'box', .*'heightfield', not 'cube'",
    ),
    "missing": ("centre = [0.1, 0.2, 0.3]", "", "2 'bump': needs the key 'centre'"),
    "size": ("[0.1, 0.2, 0.3]", "[0.1, 0.2]", "2 'bump': key 'centre' must be three numbers"),
    "text": ("[0.1, 0.2, 0.3]", '"here"', "2 'bump': key 'centre' must be three numbers"),
    "radii": ("0.003]", "0.0]", "2 'bump': key 'radii' must be more than 0 m"),
    "normal": ("[0, 0, 2]", "[0, 0, 0]", "1 'plate': key 'normal' must not be zero"),
    "rotation": ("[0, 0, 1]]", "[0, 0, -1]]", "2 'bump': key 'rotation' must be three rows of a rotation matrix"),
    "friction": ("friction = 0.4", "friction = -0.4", "2 'bump': key 'friction' must be a number of at least 0"),
    "no friction": ("friction = 0.9", "", "1 'plate': needs the key 'friction'"),
    "name": ('name = "plate"', 'name = "bump"', "2 .bump.: the name 'bump' is taken"),
    "facets": ("facets = 6", "facets = 1", "key 'facets' must be a whole number of at least 2"),
    "step": ("step = 0.001", "step = 0", "key 'step' must be a number above 0"),
    "surface rotation twice": (
        "rotation = [[0",
        "quaternion = [1, 0, 0, 0]\nrotation = [[0",
        "2 'bump': has both 'rotation' and 'quaternion'",
    ),
    "centre twice": ("centre =", "position = [0, 0, 0]\ncentre =", "2 'bump': has the unknown key 'centre'"),
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
    with pytest.raises(FileError, match=r"needs at least one \[\[surface\]\] or \[\[object\]\] table"):
        read_scene(path)


QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""A quarter of a turn about z, the quaternion (cos 45, 0, 0, sin 45) degrees."""

SHAPES = {
    "box": ("half_sizes = [0.01, 0.02, 0.03]", Box(np.array([0.01, 0.02, 0.03]))),
    "sphere": ("radius = 0.02", Sphere(0.02)),
    "capsule": ("radius = 0.02\nhalf_length = 0.03", Capsule(0.02, 0.03)),
    "cylinder": ("radius = 0.02\nhalf_length = 0.03", Cylinder(0.02, 0.03)),
    "ellipsoid": ("radii = [0.01, 0.02, 0.03]", Ellipsoid(np.zeros(3), np.eye(3), np.array([0.01, 0.02, 0.03]))),
    "wedge": (
        "width = 0.03\nheight = 0.04\ndepth = 0.02\ntilt_degrees = 15", wedge(0.03, 0.04, 0.02, np.radians(15.0))
    ),
    "prism": (
        "outline = [[0, 0], [0.03, 0], [0, 0.02]]\nhalf_length = 0.01",
        Prism(np.array([[0.0, 0.0], [0.03, 0.0], [0.0, 0.02]]), 0.01),
    ),
}  # fmt: skip


def test_a_union_is_read_part_by_part(tmp_path):
    path = tmp_path / "bulb.toml"
    text = """
friction = 0.5
[[object]]
name = "bulb"
shape = "union"
mass = 0.03
position = [0.4, 0.5, 0.6]
[[object.part]]
shape = "sphere"
radius = 0.03
position = [0, 0, 0]
[[object.part]]
shape = "cylinder"
radius = 0.013
half_length = 0.01
position = [0, 0, -0.04]
"""
    path.write_text(text)
    scene = read_scene(path)
    none = np.zeros(3)
    parts = [(Sphere(0.03), none), (Cylinder(0.013, 0.01), np.array([0.0, 0.0, -0.04]))]
    same(scene.objects[0].shape, Union([Placed(part, Pose(np.eye(3), place)) for part, place in parts]))
    described = json.loads(scene.describe())["objects"][0]
    assert (described["shape"], [part["shape"] for part in described["parts"]]) == ("union", ["sphere", "cylinder"])
    path.write_text(text.replace("half_length = 0.01", "half_length = 0.01\nheight = 1"))
    with pytest.raises(FileError, match=r"\[\[part\]\] 2: has the unknown key 'height'"):
        read_scene(path)
    path.write_text(text[: text.index("[[object.part]]")])
    with pytest.raises(FileError, match=r"needs at least one \[\[part\]\]"):
        read_scene(path)
    with pytest.raises(ValueError, match="radius must be positive"):
        Surface("bulb", Union([Sphere(0.1), Sphere(0.0)]), 0.5)


def same(shape, expected):
    assert jax.tree.structure(shape) == jax.tree.structure(expected)
    for found, number in zip(jax.tree.leaves(shape), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(found, number, rtol=0, atol=1e-15)


@pytest.mark.parametrize("kind", SHAPES)
def test_every_shape_is_a_surface_and_an_object(tmp_path, kind):
    """Placed alike by a matrix and by a quaternion of four decimals, which is brought to unit length."""
    sizes, shape = SHAPES[kind]
    path = tmp_path / "shapes.toml"
    path.write_text(f"""
friction = 0.5
[[surface]]
shape = "{kind}"
{sizes}
position = [0.1, 0.2, 0.3]
quaternion = [0.7071, 0, 0, 0.7071]
[[object]]
name = "thing"
shape = "{kind}"
{sizes}
density = 800
position = [0.4, 0.5, 0.6]
rotation = {QUARTER.tolist()}
""")
    scene = read_scene(path)
    (surface,), (thing,) = scene.surfaces, scene.objects
    place = np.array([0.1, 0.2, 0.3])
    expected = Ellipsoid(place, QUARTER, shape.radii) if kind == "ellipsoid" else Placed(shape, Pose(QUARTER, place))
    assert (scene.name, surface.name, thing.name) == ("shapes", kind, "thing")
    same(surface.shape, expected)
    same(thing.shape, shape)
    made = Object("thing", shape, 0.5, density=800.0)
    np.testing.assert_allclose(thing.mass, made.mass, rtol=1e-15)
    np.testing.assert_allclose(thing.inertia, made.inertia, rtol=1e-15)
    np.testing.assert_array_equal(thing.pose.position, [0.4, 0.5, 0.6])
    np.testing.assert_array_equal(thing.pose.rotation, QUARTER)
    described = json.loads(scene.describe())["surfaces"][0]
    place = described["centre" if kind == "ellipsoid" else "position"]
    np.testing.assert_allclose(place, [0.1, 0.2, 0.3], atol=1e-15)
    np.testing.assert_allclose(described["rotation"], QUARTER, atol=1e-15)


def test_a_placed_ellipsoid_is_described_where_it_is():
    ellipsoid = Ellipsoid(np.array([0.1, 0.0, 0.0]), QUARTER, np.array([0.01, 0.02, 0.03]))
    pose = Pose(QUARTER, np.array([0.0, 0.0, 0.5]))
    plane = Plane(np.array([0.1, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    surfaces = (
        Surface("once", Placed(ellipsoid, pose), 0.5),
        Surface("twice", Placed(Placed(Box(np.full(3, 0.1)), pose), pose), 0.5),
        Surface("plane", Placed(plane, pose), 0.5),
    )
    once, twice, level = json.loads(Scene("placed", surfaces).describe())["surfaces"]
    np.testing.assert_allclose(once["centre"], [0.0, 0.1, 0.5], atol=1e-15)
    np.testing.assert_allclose(once["rotation"], QUARTER @ QUARTER, atol=1e-15)
    assert set(once) == {"name", "friction", "shape", "centre", "rotation", "radii"}
    np.testing.assert_allclose(twice["position"], [0.0, 0.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(twice["rotation"], QUARTER @ QUARTER, atol=1e-15)
    np.testing.assert_allclose(level["point"], [0.0, 0.1, 0.5], atol=1e-15)
    np.testing.assert_allclose(level["normal"], [0.0, 1.0, 0.0], atol=1e-15)


OBJECTS = """
friction = 0.9
gravity = [0, -9.81, 0]
contacts = 12
limits = 0
[[surface]]
name = "table"
shape = "wedge"
width = 0.3
height = 0.4
depth = 0.2
tilt_degrees = 5
position = [0, 0, 0]
[[object]]
name = "cup"
shape = "cylinder"
radius = 0.03
half_length = 0.05
friction = 0.4
mass = 0.2
com = [0, 0, -0.01]
inertia = [[3e-4, 0, 0], [0, 3e-4, 0], [0, 0, 1e-4]]
position = [0, 0.3, 0]
quaternion = [1, 0, 0, 0]
velocity = [0.1, 0, 0]
angular_velocity = [0, 0, 2]
[[object]]
name = "die"
shape = "prism"
outline = [[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]]
half_length = 0.01
density = 1000
position = [0, 0.5, 0]
[[pair]]
names = ["thumb", "cup"]
friction = 1.1
[[pair]]
names = ["die", "table"]
friction = 0.2
"""


SOLID = """
friction = 0.5
[[surface]]
shape = "heightfield"
name = "rows"
heights = [[0, 1, 2], [0, 1, 3]]
scale = 0.001
spacing = [0.01, 0.02]
position = [0.1, 0, 0]
[[surface]]
shape = "heightfield"
name = "table"
file = "ground.csv"
spacing = 0.01
reach = 0.02
position = [0, 0, 0]
[[object]]
shape = "mesh"
file = "ball.stl"
scale = 0.001
spacing = 0.006
repair = true
density = 1000
position = [0, 0, 0.1]
"""


@pytest.fixture(scope="module")
def uneven(tmp_path_factory):
    """A folder with a ball in mm, one triangle of which is missing, and heights."""
    folder = tmp_path_factory.mktemp("uneven")
    ball = trimesh.creation.icosphere(2, 30.0)
    trimesh.Trimesh(ball.vertices, ball.faces[1:]).export(folder / "ball.stl")
    np.savetxt(folder / "ground.csv", np.array([[0.0, 0.001], [0.002, 0.003], [0.0, 0.001]]), delimiter=",")
    np.save(folder / "cube.npy", np.zeros((2, 2, 2)))
    return folder


def test_meshes_and_heightfields(uneven, monkeypatch):
    monkeypatch.setenv("ICJAX_CACHE", str(uneven / "cache"))
    path = uneven / "scene.toml"
    path.write_text(SOLID)
    scene = read_scene(path)
    (rows, table), (ball,) = scene.surfaces, scene.objects
    np.testing.assert_allclose(rows.shape.shape.heights, [[0, 0.001, 0.002], [0, 0.001, 0.003]])
    np.testing.assert_array_equal(rows.shape.shape.spacing, [0.01, 0.02])
    assert (table.shape.shape.heights.shape, table.shape.shape.cells) == ((3, 2), 2)
    np.testing.assert_allclose(ball.mass, 1000 * trimesh.creation.icosphere(2, 0.03).volume, rtol=1e-2)
    told = json.loads(scene.describe())
    assert told["surfaces"][0]["heights"] == [[0, 0.001, 0.002], [0, 0.001, 0.003]]
    assert told["surfaces"][0]["position"] == [0.1, 0, 0]
    drawn = told["objects"][0]
    assert (drawn["shape"], drawn["spacing"]) == ("mesh", 0.006)
    solid = trimesh.Trimesh(drawn["vertices"], drawn["faces"], process=False)
    np.testing.assert_allclose(solid.volume, drawn["volume"], rtol=1e-3)
    assert slot_names(load_model('<mujoco model="nobody"/>'), scene) == tuple(
        f"mesh.{number}/{name}" for name in ("rows", "table") for number in range(1, 8)
    )


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ball.stl", "bowl.stl", "1: key 'file': .*bowl.stl does not exist"),
        ("repair = true", "", "ball.stl is open: 3 edges .*repair = true"),
        ("scale = 0.001\nspacing = 0.006", "", "ball.stl is 60 m long; .* scale=0.001"),
        ("spacing = 0.006", "spacing = 1", "spacing must be positive and at most a quarter of 0.06 m"),
        ("ground.csv", "nothing.csv", "2 'table': key 'file': .*nothing.csv does not exist"),
        ("ground.csv", "ball.stl", "2 'table': key 'file': .*ball.stl holds no table of numbers"),
        ("ground.csv", "cube.npy", "2 'table': key 'file': .*cube.npy holds an array of 3 dimensions"),
        ("[0, 1, 3]", "[0, 1]", "1 'rows': key 'heights' must be rows of as many numbers each"),
        ("[0, 1, 3]]", '[0, 1, 3]]\nfile = "ground.csv"', "1 'rows': needs the key 'heights' .* one of them"),
        ("reach = 0.02", "reach = 0.2", "2 'table': reach 0.2 m of a heightfield is more than 8"),
        ("spacing = 0.01\n", "spacing = 0\n", "2 'table': key 'spacing' must be a number above 0"),
        ('[[object]]\nshape = "mesh"', '[[object]]\nshape = "heightfield"', "key 'shape' must be one of 'box'"),
    ],
)
def test_bad_meshes_and_heightfields_are_named_in_one_line(uneven, monkeypatch, old, new, message):
    monkeypatch.setenv("ICJAX_CACHE", str(uneven / "cache"))
    assert SOLID.count(old) == 1
    path = uneven / "bad.toml"
    path.write_text(SOLID.replace(old, new))
    with pytest.raises(FileError, match=message) as caught:
        read_scene(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_objects_gravity_and_pairs(tmp_path):
    path = tmp_path / "objects.toml"
    path.write_text(OBJECTS)
    scene = read_scene(path)
    cup, die = scene.objects
    np.testing.assert_array_equal(scene.gravity, [0.0, -9.81, 0.0])
    assert (scene.contacts, scene.limits) == (12, 0)
    assert (float(cup.friction), float(die.friction), float(cup.mass)) == (0.4, 0.9, 0.2)
    np.testing.assert_array_equal(cup.com, [0.0, 0.0, -0.01])
    np.testing.assert_array_equal(cup.inertia, np.diag([3e-4, 3e-4, 1e-4]))
    np.testing.assert_array_equal(cup.velocity, [0.1, 0.0, 0.0])
    np.testing.assert_array_equal(cup.angular_velocity, [0.0, 0.0, 2.0])
    np.testing.assert_array_equal(cup.pose.rotation, np.eye(3))
    assert float(die.mass) == pytest.approx(8e-3, rel=1e-14)
    assert [(pair.names, float(pair.friction)) for pair in scene.frictions] == [
        (("thumb", "cup"), 1.1), (("die", "table"), 0.2)
    ]  # fmt: skip


OUTLINE = "outline = [[-0.01, -0.01], [0.01, -0.01], [0.01, 0.01], [-0.01, 0.01]]"

BAD_OBJECTS = {
    "both": ("mass = 0.2", "mass = 0.2\ndensity = 900", r"1 'cup': has both 'mass' and 'density'"),
    "neither": ("mass = 0.2", "", r"1 'cup': needs the key 'mass' \(kg\) or 'density' \(kg/m3\)"),
    "mass": ("mass = 0.2", "mass = 0", r"1 'cup': key 'mass' must be a number above 0"),
    "nan": ("mass = 0.2", "mass = nan", r"1 'cup': key 'mass' must be a number above 0, not nan"),
    "plane": ('"cylinder"', '"plane"', r"\[\[object\]\] 1 'cup': key 'shape' must be one of 'box'"),
    "shape size": ("radius = 0.03", "", r"1 'cup': needs the key 'radius'"),
    "zero size": ("half_length = 0.05", "half_length = 0", r"1 'cup': key 'half_length' must be a number above 0"),
    "tiny size": ("half_length = 0.05", "half_length = 1e-9", r"object 'cup': half_length must be pos"),
    "other size": ("radius = 0.03", "radius = 0.03\nradii = [1, 1, 1]", r"1 'cup': has the unknown key 'radii'"),
    "no place": ("position = [0, 0.3, 0]", "", r"1 'cup': needs the key 'position'"),
    "far": ("[0, 0.3, 0]", "[0, 3e5, 0]", r"object 'cup': its position must be within 1000 m"),
    "quaternion": ("[1, 0, 0, 0]", "[1, 0, 0, 1]", r"1 'cup': key 'quaternion' must be four numbers w, x, y, z of len"),
    "com": ("[0, 0, -0.01]", "[0, 0]", r"1 'cup': key 'com' must be three numbers"),
    "inertia rows": ("[0, 3e-4, 0], ", "", r"1 'cup': key 'inertia' must be three rows of three numbers"),
    "inertia": ("1e-4]]", "9e-4]]", r"object 'cup': no body has the principal moments"),
    "velocity": ("[0.1, 0, 0]", "0.1", r"1 'cup': key 'velocity' must be three numbers"),
    "friction": ("friction = 0.4", "friction = 40", r"object 'cup': friction must be 0 to 20"),
    "name": ('name = "die"', 'name = "table"', r"2 'table': the name 'table' is taken"),
    "outline": (OUTLINE, "outline = [[0, 0], [0, 1], [1, 0]]", r"2 'die': key 'outline' is none of a prism: .*counter"),
    "two corners": (OUTLINE, "outline = [[0, 0], [0, 1]]", r"2 'die': key 'outline' is none of a prism: .*at least t"),
    "points": (OUTLINE, "outline = [1, 2, 3]", r"2 'die': key 'outline' must be a list of points \[x, y\]"),
    "wedge": ("tilt_degrees = 5", "tilt_degrees = 45", r"1 'table': key 'tilt_degrees' is 45: the sides would meet"),
    "room": ("contacts = 12", "contacts = 0", r"key 'contacts' must be a whole number of at least 1"),
    "gravity": ("[0, -9.81, 0]", "-9.81", r"key 'gravity' must be three numbers"),
    "pair of one": ('"thumb", "cup"', '"cup"', r"\[\[pair\]\] 1: key 'names' must be two names"),
    "pair with itself": ('"thumb", "cup"', '"cup", "cup"', r"1: friction is that of two different things"),
    "pair twice": ('"thumb", "cup"', '"table", "die"', r"\[\[pair\]\] 2: .* is stated by an earlier pair"),
    "pair friction": ("friction = 1.1", "", r"\[\[pair\]\] 1: needs the key 'friction'"),
    "pair key": ("friction = 1.1", "friction = 1.1\nmu = 2", r"1: has the unknown key 'mu'"),
}


@pytest.mark.parametrize(("old", "new", "message"), BAD_OBJECTS.values(), ids=BAD_OBJECTS.keys())
def test_bad_objects_are_named_in_one_line(tmp_path, old, new, message):
    assert OBJECTS.count(old) == 1
    path = tmp_path / "scene.toml"
    path.write_text(OBJECTS.replace(old, new))
    with pytest.raises(FileError, match=message) as caught:
        read_scene(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


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
