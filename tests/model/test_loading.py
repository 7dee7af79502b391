"""Reading MJCF and URDF: what is kept, what is refused, and how it is said."""

import numpy as np
import pytest

from icjax.files import FileError
from icjax.model import forward_kinematics, index_finger, load_model, neutral

URDF = """<robot name="arm">
  <link name="base"><inertial><mass value="2"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="upper"><inertial><origin xyz="0 0 0.1"/><mass value="1.5"/>
    <inertia ixx="0.1" iyy="0.2" izz="0.15" ixy="0.01" ixz="0" iyz="0"/></inertial></link>
  <link name="tip"/>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 1" rpy="0 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="2" effort="1" velocity="1"/><dynamics damping="0.1"/></joint>
  <joint name="glue" type="fixed"><parent link="upper"/><child link="tip"/><origin xyz="0 0 0.2"/></joint>
</robot>"""

MJCF = """<mujoco model="m"><compiler angle="degree"/>
  <default><default class="pad"><geom user="0.002"/></default></default>
  <worldbody><body name="a" pos="1 2 3"><freejoint name="root"/>
    <geom size="0.1" mass="2" pos="0 0 0.1"/><site name="s" pos="0 0 1"/>
    <body name="b"><joint name="h" range="-90 45" stiffness="4" springref="10" ref="5" armature="0.3" damping="0.7"/>
      <joint name="d" type="slide" axis="1 0 0"/>
      <geom class="pad" name="tip" size="0.01" pos="0 0 0.5" mass="0.1"/><geom name="pad2" size="0.02"/>
    </body></body></worldbody></mujoco>"""


def test_mjcf_fields_in_si_units():
    model = load_model(MJCF, pads={"second": "pad2"})
    assert (model.name, model.body_names, model.joint_names) == ("m", ("world", "a", "b"), ("root", "h", "d"))
    assert model.joint_types == ("free", "hinge", "slide")
    assert model.dof_names[-3:] == ("root_z", "h", "d")
    np.testing.assert_allclose(model.lower[-2:], [-np.pi / 2, -np.inf])
    np.testing.assert_allclose(model.upper[-2:], [np.pi / 4, np.inf])
    np.testing.assert_allclose(model.compliance, [np.inf] * 6 + [0.25, np.inf])
    np.testing.assert_allclose(model.rest[-2], np.deg2rad(10))
    np.testing.assert_allclose(model.zero, [1, 2, 3, 1, 0, 0, 0, np.deg2rad(5), 0])
    assert model.armature[-2] == 0.3
    assert model.damping[-2] == 0.7
    np.testing.assert_allclose(model.body_com[1], [0, 0, 0.1])
    np.testing.assert_allclose(model.body_inertia[1], 2 * 0.4 * 0.01 * np.eye(3))  # solid sphere: 2/5 m r^2
    assert model.pad_names == ("tip", "second")
    np.testing.assert_allclose(model.pad_compliance, [0.002, 1 / 750])
    np.testing.assert_allclose(model.pad_radius, [0.01, 0.02])
    np.testing.assert_array_equal(model.gravity, [0, 0, -9.81])
    np.testing.assert_array_equal(forward_kinematics(model, neutral(model)).position[1], [1, 2, 3])


@pytest.mark.parametrize("as_file", [False, True])
def test_urdf_keeps_fixed_links_limits_and_inertia(tmp_path, as_file):
    source = URDF
    if as_file:
        source = tmp_path / "arm.urdf"
        source.write_text(URDF)
    model = load_model(source)
    assert model.body_names == ("world", "base", "upper", "tip")
    assert model.joint_names == ("elbow",)
    np.testing.assert_allclose([model.lower[0], model.upper[0]], [-1, 2])
    np.testing.assert_allclose(model.body_inertia[2], [[0.1, 0.01, 0], [0.01, 0.2, 0], [0, 0, 0.15]], atol=1e-15)
    np.testing.assert_allclose(forward_kinematics(model, np.asarray([np.pi / 2])).position[3], [0.2, 0, 1], atol=1e-15)
    floating = load_model(source, free_root=True)
    assert floating.joint_types == ("free", "hinge")


def test_index_finger_has_the_geometry_of_the_simulated_sessions(shared_data):
    """Against the nominal model that the independent simulation hands to its estimators."""
    import json

    theirs = json.loads((shared_data / "virtual_sessions" / "explore" / "hand_model.json").read_text())
    model = index_finger(theirs["hand_length"], "fixed")
    offsets = [segment["offset"] for segment in theirs["segments"]]
    np.testing.assert_allclose(model.body_position[2:], offsets, atol=1e-15)
    for prefix in ("FA", "HA", "PP", "MP", "DP"):
        for number, position in enumerate(theirs["markers"][prefix], start=1):
            np.testing.assert_allclose(model.site_position[model.site(f"{prefix}{number}")], position, atol=1e-15)
    np.testing.assert_allclose(model.pad_centre[0], theirs["pad"]["centre"], atol=1e-15)
    assert model.pad_radius[0] == theirs["pad"]["radius"]


def test_flexion_is_positive_and_lowers_the_tip():
    model = index_finger(root="fixed")
    for joint in range(4):
        q = np.zeros(4)
        q[joint] = 0.3
        tip = forward_kinematics(model, q)[model.body("distal")].apply(np.asarray([0.02, 0.0, 0.0]))
        assert tip[2] < -1e-3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<mujoco", "is not XML"),
        ("<html/>", "neither MJCF"),
        ("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "no model that MuJoCo accepts"),
        ('<mujoco><include file="nowhere.xml"/></mujoco>', "nowhere.xml"),
        (MJCF.replace("</mujoco>", '<equality><weld body1="a"/></equality></mujoco>'), "1 equality constraints"),
        (
            MJCF.replace('name="tip"', 'name="tip" type="box"').replace('"0.01"', '"1 1 1"'),
            "'tip' is neither a sphere nor a capsule",
        ),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "model.xml"
    path.write_text(text)
    with pytest.raises(FileError, match="model.xml: ") as caught:
        load_model(path)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_files_and_geoms_are_named(tmp_path):
    with pytest.raises(FileError, match="absent.xml: does not exist"):
        load_model(tmp_path / "absent.xml")
    with pytest.raises(FileError, match="no geom 'thumb' for pad 'p'"):
        load_model(MJCF, pads={"p": "thumb"})


def test_stripping_lists_what_it_dropped():
    text = MJCF.replace("</mujoco>", '<equality><weld body1="a"/></equality></mujoco>')
    with pytest.warns(UserWarning, match="dropped 1 entries of <equality>"):
        assert load_model(text, strip=True).nv == 8


@pytest.mark.parametrize(("length", "root"), [(1.9, "free"), (0.19, "loose")])
def test_index_finger_refuses_nonsense(length, root):
    with pytest.raises(ValueError, match=str(length) if root == "free" else root):
        index_finger(length, root)
