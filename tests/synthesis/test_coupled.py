"""Joint limits, room for contacts, full compliance matrices, driven objects: closed forms."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives
from scipy.spatial.transform import Rotation

from icjax.geometry import Box, Plane, Sphere
from icjax.model import load_model
from icjax.results import RESULTS
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface, Target, rollout
from icjax.synthesis._stepper import STATUSES

UP = np.array([0.0, 0.0, 1.0])
NOBODY = load_model('<mujoco model="nobody"/>')
ARM = load_model("""
    <mujoco model="arm"><compiler angle="radian"/><worldbody>
    <body name="arm"><joint name="lift" type="slide" axis="0 0 1"/>
    <joint name="turn" axis="0 1 0" range="-0.5 0.5"/><geom type="sphere" size="0.02" mass="0.1"/>
    <body name="hand" pos="0.05 0 0"><joint name="bend" axis="0 1 0" range="-1 1"/>
    <geom name="pad" type="sphere" pos="0.05 0 0" size="0.01" mass="0.01"/></body></body>
    </worldbody></mujoco>""")
TIP = load_model("""
    <mujoco model="tip"><worldbody><body name="tip">
    <joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>
    <joint name="z" type="slide" axis="0 0 1"/><geom name="pad" type="sphere" size="0.01" mass="0.01"/></body>
    </worldbody></mujoco>""")
FAR = Surface("far", Plane(np.array([0.0, 0.0, -1.0]), UP), 0.5)


def held(model, scene, reference, compliance, steps=3, **targets):
    """A reference that stays."""
    rows = Target(jnp.tile(jnp.asarray(reference, float), (steps, 1)), jnp.asarray([compliance] * steps), **targets)
    return rollout(model, scene, rows)[1]


@pytest.mark.parametrize(("reference", "limit"), [(0.9, 0.5), (-0.7, -0.5), (0.3, None)])
def test_a_limit_carries_what_the_spring_has_too_much(reference, limit):
    """theta = theta_limit, torque (theta_limit - theta_r) / C (Section 8.3)."""
    info = held(ARM, Scene("limit", (FAR,)), [0.0, reference, 0.2], [0.0, 0.5, 0.5])
    expected = reference if limit is None else limit
    np.testing.assert_allclose(info.q[-1], [0.0, expected, 0.2], rtol=0, atol=1e-12)
    np.testing.assert_allclose(info.limit_torque[-1], [0, (expected - reference) / 0.5, 0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(info.equilibrium_error, 0.0, atol=1e-12)


def test_a_driven_joint_follows_its_reference_beyond_its_limits():
    info = held(ARM, Scene("driven", (FAR,)), [0.0, 0.9, 0.2], [0.0, 0.0, 0.5])
    np.testing.assert_allclose(info.q[-1], [0.0, 0.9, 0.2], rtol=0, atol=1e-12)
    assert np.all(np.asarray(info.status) == 0)


def test_limits_without_room_are_reported():
    bent = [0.0, 0.9, 1.4]
    info = held(ARM, Scene("room", (FAR,), limits=1), bent, [0.0, 0.5, 0.5])
    assert STATUSES[int(info.status[0])] == RESULTS.crowded
    info = held(ARM, Scene("room", (FAR,), limits=2), bent, [0.0, 0.5, 0.5])
    assert np.all(np.asarray(info.status) == 0)
    np.testing.assert_allclose(info.q[-1], [0.0, 0.5, 1.0], atol=1e-12)


SLIDES = load_model(
    '<mujoco model="slides"><worldbody><body name="tip">'
    + "".join(f'<joint name="y{i}" type="slide" axis="0 1 0" range="-0.01 0.01"/>' for i in range(3))
    + '<joint name="z" type="slide" axis="0 0 1" range="-0.02 0.02"/>'
    + '<geom name="pad" type="sphere" size="0.01" mass="0.01"/></body></worldbody></mujoco>'
)


@pytest.mark.parametrize("room", [4, 1])
def test_a_limit_that_a_contact_leads_into_is_met_or_missed_aloud(room):
    """Without the contact the spring would bring the joint back, so the limit is near only where it is now."""
    model = dataclasses.replace(SLIDES, pad_compliance=np.full(1, 1e-3))
    plane = Surface("plane", Plane(np.array([0.0, 0.0, 0.05]), UP), 0.0)
    info = held(model, Scene("up", (plane,), limits=room), np.zeros(4), np.full(4, 0.01), steps=4)
    statuses = [STATUSES[int(status)] for status in np.asarray(info.status)]
    beyond = np.asarray(info.q)[:, 3] > 0.02 + 1e-9
    assert beyond[0] == (statuses[0] == RESULTS.crowded)
    # as soon as it is beyond its limit it is the nearest one
    np.testing.assert_allclose(info.q[-1, 3], 0.02, atol=1e-12)
    assert statuses[-1] == RESULTS.solved
    assert info.limit_torque[-1, 3] < -1.0


@pytest.mark.slow
def test_a_push_that_goes_on_through_a_neighbour_is_no_success():
    """Room for one contact: a pushed ball meets another only because it is pushed."""
    balls = [
        Object(name, Sphere(0.01), 0.0, mass=0.1, pose=Pose(np.eye(3), np.array([x, 0.0, 0.0])))
        for name, x in (("near", 0.02), ("far", 0.04))
    ]
    pusher = Object("pusher", Sphere(0.01), 0.0, driven=True)
    h, steps = 0.002, 20
    path = np.zeros((steps, 1, 7))
    path[:, 0, 0], path[:, 0, 3] = h * np.arange(1, steps + 1), 1.0
    nothing = jnp.zeros((steps, 0))
    for room in (1, 2):
        scene = Scene("row", (), objects=(*balls, pusher), gravity=np.zeros(3), contacts=room)
        _, info = rollout(NOBODY, scene, Target(nothing, nothing, path=path))
        assert bool(info.status[0] == 0) == (room == 2)
        if room == 2:
            assert np.all(np.asarray(info.status) == 0)
            gaps = np.diff(np.asarray(info.object_position)[:, [2, 0, 1], 0], axis=1) - 0.02
            assert np.min(gaps) > -1e-9


@pytest.mark.slow
def test_derivatives_at_a_limit_and_under_load():
    """Of torque and angles with respect to reference, compliance and the limit, with the tip on a plane."""
    plane = Surface("plane", Plane(np.array([0.0, 0.0, -0.07]), UP), 0.5)

    def pressed(x):
        upper = jnp.asarray(ARM.upper).at[1].set(0.5 + x[5])
        model = dataclasses.replace(ARM, upper=upper, pad_compliance=np.full(1, 1e-3))
        info = held(model, Scene("pressed", (plane,)), x[:3] + jnp.array([0.0, 0.8, 0.6]), jnp.stack([0.0, *x[3:5]]))
        return jnp.concatenate([info.q[-1], info.limit_torque[-1], info.contact_force[-1].reshape(-1)])

    x = np.array([0.0, 0.0, 0.0, 0.5, 0.5, 0.0])
    found = np.asarray(pressed(x))
    assert found[4] < -0.01
    assert found[8] > 0.1
    check_derivatives(pressed, x, tolerance=1e-7)


def test_a_full_compliance_matrix_moves_sideways():
    """Without friction the normal force is depth / (C_zz + C_pad), and the tip yields by C_xz, C_yz times it."""
    C = np.array([[0.010, 0.002, 0.004], [0.002, 0.012, -0.003], [0.004, -0.003, 0.008]])
    model = dataclasses.replace(TIP, pad_compliance=np.full(1, 0.001))
    smooth = Surface("plane", Plane(np.zeros(3), UP), 0.0)
    depth = 0.005
    info = held(model, Scene("plane", (smooth,)), [0.0, 0.0, 0.01 - depth], C)
    force = depth / (0.008 + 0.001)
    np.testing.assert_allclose(info.contact_force[-1, 0], [0, 0, force], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(info.q[-1], np.array([0, 0, 0.01 - depth]) + C[:, 2] * force, rtol=0, atol=1e-12)
    np.testing.assert_allclose(info.compliance[-1], np.diag(C))


def tossed(**room):
    box = Object(
        "box",
        Box(np.array([0.015, 0.025, 0.035])),
        0.0,
        mass=0.1,
        pose=Pose(Rotation.from_rotvec([0.4, -0.3, 0.2]).as_matrix(), np.array([0.0, 0.0, 0.05])),
        velocity=[0.2, 0.1, 0.0],
    )
    scene = Scene("toss", (Surface("table", Plane(np.zeros(3), UP), 0.0),), objects=(box,), **room)
    return rollout(NOBODY, scene, Target(jnp.zeros((300, 0)), jnp.zeros((300, 0))))[1]


@pytest.mark.slow
def test_room_for_as_many_contacts_as_touch_is_enough():
    """A box has eight corners and lies on four. Frictionless, where the motion is unique."""
    everything, four, two = tossed(), tossed(contacts=4), tossed(contacts=2)
    assert np.all(np.asarray(four.status) == 0)
    rounding = 1e-9  # of other pivots on a face with four corners
    np.testing.assert_allclose(four.object_position, everything.object_position, rtol=0, atol=rounding)
    np.testing.assert_allclose(four.contact_force.sum(axis=1), everything.contact_force.sum(axis=1), rtol=0, atol=1e-5)
    assert four.contact_force.shape == everything.contact_force.shape
    crowded = [STATUSES[int(status)] == RESULTS.crowded for status in np.asarray(two.status)]
    assert any(crowded)
    assert not crowded[0]


@pytest.mark.parametrize("friction", [0.5, 0.1])
def test_a_driven_plate_carries_a_box_as_far_as_friction_does(friction):
    """The plate accelerates at 2 m/s2 along a tangent: mu g is enough, or the box gains mu g t only."""
    h, steps = 0.002, 100
    box = Object("box", Box(np.full(3, 0.02)), friction, mass=0.3, pose=Pose(np.eye(3), np.array([0.0, 0.0, 0.02])))
    plate = Object("plate", Plane(np.zeros(3), UP), friction, driven=True)
    time = h * np.arange(1, steps + 1)
    path = np.zeros((steps, 1, 7))
    path[:, 0, 0], path[:, 0, 3] = time**2, 1.0
    nothing = jnp.zeros((steps, 0))
    _, info = rollout(NOBODY, Scene("plate", (), objects=(box, plate)), Target(nothing, nothing, path=path))
    np.testing.assert_allclose(info.object_position[:, 1], path[:, 0, :3], rtol=0, atol=1e-12)
    carried = np.asarray(info.object_velocity)[-1, 0]
    expected = 2.0 * time[-1] - h if friction == 0.5 else friction * 9.81 * time[-1]
    np.testing.assert_allclose(carried, [expected, 0.0, 0.0], rtol=0, atol=1e-9)


def test_a_turning_driven_box_pushes_a_finger():
    """Its face comes 1 mm nearer: the tip yields by its share, C / (C + C_pad), without friction."""
    model = dataclasses.replace(TIP, pad_compliance=np.full(1, 0.001))
    turn = Rotation.from_euler("z", 90, degrees=True)
    quarter = turn.as_quat(scalar_first=True)
    start = Pose(turn.as_matrix(), np.array([-0.01, 0.0, 0.0]))
    box = Object("pusher", Box(np.array([0.02, 0.03, 0.04])), 0.0, driven=True, pose=start)
    path = np.tile(np.concatenate([[0.001 - 0.01, 0.0, 0.0], quarter]), (3, 1, 1))
    info = held(model, Scene("push", (), objects=(box,)), [0.03 - 0.01 + 0.01, 0.0, 0.0], np.full(3, 0.01), path=path)
    # turned, the half size along x is 0.03, and its face lies at 0.03 - 0.009 = 0.021
    press = 0.021 - (0.03 - 0.01)
    np.testing.assert_allclose(info.contact_force[-1, 0], [press / 0.011, 0, 0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(info.object_quaternion[-1, 0], quarter, atol=1e-12)


def test_bad_targets_and_scenes_are_named():
    scene = Scene("plane", (FAR,))
    with pytest.raises(ValueError, match="reference is not finite, first in row 1"):
        rollout(TIP, scene, Target(np.array([[0.0, 0, 0], [np.nan, 0, 0]]), np.full((2, 3), 0.01)))
    with pytest.raises(ValueError, match="contacts must be a number of at least 1"):
        Scene("plane", (FAR,), contacts=0)
    with pytest.raises(ValueError, match="limits must be a number of at least 0"):
        Scene("plane", (FAR,), limits=-1)
    with pytest.raises(ValueError, match="a driven object has no mass"):
        Object("plate", Plane(np.zeros(3), UP), 0.5, mass=1.0, driven=True)
    ball = Object("ball", Sphere(0.02), 0.5, driven=True)
    with pytest.raises(ValueError, match=r"path must be \[time, 1, 7\], a row a driven object"):
        held(TIP, Scene("ball", (FAR,), objects=(ball,)), np.zeros(3), np.full(3, 0.01), path=jnp.zeros((3, 2, 7)))
    scene = Scene("ball", (FAR,), objects=(ball,))
    for place, words in (
        ([0, 0, 0, 0, 0, 0, 0], "path of 'ball': no unit quaternion .* in row 0"),
        ([0.3, 0, 0, 1, 0, 0, 0], "path of 'ball' begins 300 mm and 0 rad from where it stands"),
    ):
        with pytest.raises(ValueError, match=words):
            held(TIP, scene, np.zeros(3), np.full(3, 0.01), path=np.tile(np.array(place, float), (3, 1, 1)))
    for compliance, words in (
        (np.array([0.01, -0.01, 0.01]), "compliance of y must not be negative; got -0.01 in row 0"),
        (np.array([[0.01, 0.002, 0], [0, 0.01, 0], [0, 0, 0.01]]), "compliance is not symmetric, first in row 0"),
        (np.array([[0.01, 0, 0.02], [0, 0.01, 0], [0.02, 0, 0.01]]), "negative eigenvalue -0.01 in row 0"),
    ):
        with pytest.raises(ValueError, match=words):
            held(TIP, Scene("plane", (FAR,)), np.zeros(3), compliance)
    crossed = dataclasses.replace(ARM, lower=np.array([-np.inf, 0.5, -1]), upper=np.array([np.inf, -0.5, 1]))
    with pytest.raises(ValueError, match="limits of turn are 0.5 to -0.5"):
        held(crossed, Scene("plane", (FAR,)), np.zeros(3), np.full(3, 0.01))
    with pytest.raises(ValueError, match="a driven object has no velocity"):
        Object("ball", Sphere(0.02), 0.5, driven=True, velocity=[1.0, 0, 0])
