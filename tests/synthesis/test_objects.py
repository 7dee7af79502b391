"""Free rigid objects: closed forms, conserved quantities, symmetry, a pinch; derivatives; bad input."""

import dataclasses
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from derivatives import check_derivatives
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from icjax.contact import contact_frame
from icjax.geometry import Box, Cylinder, Ellipsoid, Placed, Plane, Sphere
from icjax.model import load_model
from icjax.spatial import Pose, quaternion_to_rotation
from icjax.synthesis import PARTING, Object, PairFriction, Scene, Surface, Target, rollout

NOBODY = load_model('<mujoco model="nobody"/>')
GRAVITY = 9.81
HALF = np.array([0.015, 0.025, 0.035])
UP = np.array([0.0, 0.0, 1.0])


def table(friction=0.5, normal=UP):
    return Surface("table", Plane(np.zeros(3), normal), friction)


def alone(scene, steps, wrench=None, **running):
    """Nobody touches the objects."""
    return rollout(NOBODY, scene, Target(jnp.zeros((steps, 0)), jnp.zeros((steps, 0)), wrench), **running)


def in_chunks(scene, steps):
    """In chunks of one length, so that tests of one kind of scene share a compiled step."""
    return alone(scene, steps, chunk=100, progress=lambda fraction: None)


def at(position, rotation=None):
    return Pose(np.eye(3) if rotation is None else rotation.as_matrix(), np.asarray(position, float))


def test_free_fall_is_that_of_the_integrator():
    """x_k = h^2 g k (k + 1) / 2 for symplectic Euler, whatever the spin."""
    thrown = Object("box", Box(HALF), 0.5, mass=0.1, velocity=[0.3, 0, 1.0], angular_velocity=[3.0, 20.0, -5.0])
    far = Surface("table", Plane(np.array([0.0, 0.0, -100.0]), UP), 0.5)
    _, info = in_chunks(Scene("fall", (far,), objects=(thrown,)), 200)
    k = np.arange(1, 201)
    h = 0.002
    expected = np.stack([0.3 * h * k, 0 * k, 1.0 * h * k - GRAVITY * h * h * k * (k + 1) / 2], axis=1)
    np.testing.assert_allclose(info.object_position[:, 0], expected, rtol=0, atol=1e-12)


def spun(step, seconds, omega=(2.0, 25.0, 3.0)):
    spinning = Object("box", Box(HALF), 0.5, mass=0.1, angular_velocity=omega)
    far = Surface("table", Plane(np.array([0.0, 0.0, -100.0]), UP), 0.5)
    scene = Scene("spin", (far,), objects=(spinning,), gravity=np.zeros(3), step=step)
    return spinning, in_chunks(scene, round(seconds / step))


def test_a_spun_box_keeps_angular_momentum_exactly_and_its_energy_does_not_drift():
    """About the middle axis, where it tumbles."""
    box, (state, info) = spun(0.002, 10.0)
    inertia = np.asarray(box.inertia)
    start = inertia @ np.array([2.0, 25.0, 3.0])
    np.testing.assert_allclose(state.motions[0].angular_momentum, start, rtol=1e-13)
    R = Rotation.from_quat(np.asarray(info.object_quaternion)[:, 0], scalar_first=True).as_matrix()
    omega = np.einsum("tji,tj->ti", R, np.asarray(info.object_angular_velocity)[:, 0])
    energy = np.einsum("ti,ij,tj->t", omega, inertia, omega) / 2
    # (h omega)^2 of the energy goes to and fro; nothing is lost in 20 tumbles
    assert np.ptp(energy) < (0.002 * 26) ** 2 * energy[0]
    assert abs(energy[:500].mean() - energy[-500:].mean()) < 0.05 * np.ptp(energy)


def test_a_spun_box_turns_as_eulers_equations_say():
    def euler(_, y):
        w, x, omega = y[0], y[1:4], y[4:]
        rate = 0.5 * np.concatenate([[-x @ omega], w * omega + np.cross(x, omega)])
        return np.concatenate([rate, np.linalg.solve(inertia, -np.cross(omega, inertia @ omega))])

    inertia = np.asarray(Object("box", Box(HALF), 0.5, mass=0.1).inertia)
    start = np.concatenate([[1.0, 0, 0, 0], [2.0, 25.0, 3.0]])
    exact = solve_ivp(euler, (0.0, 0.5), start, rtol=1e-11, atol=1e-12).y[:4, -1]
    errors = []
    for step in (0.002, 0.001):
        _, (_, info) = spun(step, 0.5)
        found = Rotation.from_quat(np.asarray(info.object_quaternion)[-1, 0], scalar_first=True)
        errors.append((found * Rotation.from_quat(exact, scalar_first=True).inv()).magnitude())
    assert errors[0] < 0.05  # rad, of two turns
    assert errors[1] < 0.6 * errors[0]  # at least first order


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape", "height"),
    [(Box(HALF), 0.035), (Cylinder(0.02, 0.03), 0.03), (Sphere(0.02), 0.02)],
    ids=["box", "cylinder", "sphere"],
)
def test_at_rest_it_stays_and_its_weight_is_carried(shape, height):
    resting = Object("thing", shape, 0.5, mass=0.3, pose=at([0.01, 0.02, height]))
    _, info = in_chunks(Scene("rest", (table(),), objects=(resting,)), 5000)
    assert np.all(np.asarray(info.status) == 0)
    moved = np.asarray(info.object_position)[:, 0] - np.array([0.01, 0.02, height])
    assert np.max(np.abs(moved)) < 1e-9
    total = np.asarray(info.contact_force).sum(axis=1)
    np.testing.assert_allclose(total, np.broadcast_to([0, 0, 0.3 * GRAVITY], total.shape), rtol=0, atol=1e-8)


@pytest.mark.parametrize("slope", [0.3, 0.49, 0.51, 0.8])
def test_on_a_slope_it_slides_exactly_where_the_slope_exceeds_friction(slope):
    """tan(slope) > mu = 0.5, down a tangent of the cone: constant acceleration g (sin - mu cos), else none."""
    angle = np.arctan(slope)
    turn = Rotation.from_euler("y", angle)  # x of the block points down the slope
    normal = turn.apply(UP)
    block = Object("block", Box(np.array([0.03, 0.03, 0.01])), 0.5, mass=0.2, pose=at(0.01 * normal, turn))
    scene = Scene("slope", (table(0.5, normal),), objects=(block,))
    _, info = in_chunks(scene, 100)
    k, h = np.arange(1, 101), 0.002
    down = turn.apply([1.0, 0.0, 0.0])
    way = (np.asarray(info.object_position)[:, 0] - 0.01 * normal) @ down
    acceleration = max(0.0, GRAVITY * (np.sin(angle) - 0.5 * np.cos(angle)))
    np.testing.assert_allclose(way, acceleration * h * h * k * (k + 1) / 2, rtol=0, atol=1e-9)


@pytest.mark.parametrize("facets", [2, 4])
def test_between_two_tangents_a_facet_holds_less(facets):
    """Pushed midway between two of the 2m tangents: there the polygon reaches mu cos(pi / 2m)."""
    least = 0.5 * np.cos(np.pi / (2 * facets))
    _, first, second = np.asarray(contact_frame(jnp.asarray(UP))).T
    direction = np.cos(np.pi / (2 * facets)) * first + np.sin(np.pi / (2 * facets)) * second
    for push, slides in ((least - 0.01, False), (least + 0.01, True)):
        block = Object("block", Box(np.array([0.03, 0.03, 0.01])), 0.5, mass=0.2, pose=at([0, 0, 0.01]))
        gravity = GRAVITY * (push * direction - UP)
        scene = Scene("pushed", (table(),), objects=(block,), facets=facets, gravity=gravity)
        _, info = in_chunks(scene, 20)
        way = np.linalg.norm(np.asarray(info.object_position)[-1, 0] - [0, 0, 0.01])
        assert (way > 1e-6) == slides


PINCH = load_model("""
    <mujoco model="pinch"><worldbody>
    <body name="left"><joint name="lx" type="slide" axis="1 0 0"/><joint name="ly" type="slide" axis="0 1 0"/>
    <joint name="lz" type="slide" axis="0 0 1"/><geom name="pad_left" type="sphere" size="0.0075" mass="0.01"/></body>
    <body name="right"><joint name="rx" type="slide" axis="1 0 0"/><joint name="ry" type="slide" axis="0 1 0"/>
    <joint name="rz" type="slide" axis="0 0 1"/><geom name="pad_right" type="sphere" size="0.0075" mass="0.01"/></body>
    </worldbody></mujoco>""")
FINGER, PAD = 1 / 85, 1 / 750


def pinched(mass, friction, depth=0.01, steps=1000, facets=4):
    """Two fingers pressed `depth` into a box from both sides, whose weight comes upon them slowly."""
    model = dataclasses.replace(PINCH, pad_compliance=np.full(2, PAD))
    box = Object("box", Box(HALF), friction, mass=mass)
    far = Surface("table", Plane(np.array([0.0, 0.0, -10.0]), UP), 0.5)
    reach = HALF[0] + 0.0075 - depth
    reference = jnp.tile(jnp.array([-reach, 0.0, 0.0, reach, 0.0, 0.0]), (steps, 1))
    part = np.clip(np.arange(steps) / (0.8 * steps), 0.0, 1.0)
    carried = mass * GRAVITY * (1 - part**3 * (10 - 15 * part + 6 * part**2))
    wrench = np.zeros((steps, 1, 6))
    wrench[:, 0, 5] = carried
    scene = Scene("pinch", (far,), objects=(box,), facets=facets)
    return rollout(model, scene, Target(reference, jnp.full((steps, 6), FINGER), wrench))


@pytest.mark.slow
def test_a_pinch_squeezes_as_its_springs_say_and_drops_what_is_too_heavy():
    """f = depth / (C + C_pad) on each side; the box falls exactly where 2 mu f < m g."""
    squeeze = 0.01 / (FINGER + PAD)
    for factor, held in ((0.98, True), (1.02, False)):
        check_pinch(factor * 2 * 0.6 * squeeze / GRAVITY, squeeze, held)


def check_pinch(mass, squeeze, held):
    _, info = pinched(mass, 0.6)
    assert np.all(np.asarray(info.status) == 0)
    force = np.asarray(info.contact_force)[:, [1, 3]]  # of left and right on the box; 0 and 2 are the table's
    np.testing.assert_allclose(force[-1, :, 0], [-squeeze, squeeze], rtol=1e-9)
    if held:
        ringing = 1e-3  # an undamped box on springs
        np.testing.assert_allclose(force[-1, :, 2], -mass * GRAVITY / 2, rtol=ringing)
        # each finger hangs on its springs and its pad: m g / 2 (C + C_pad)
        sunk = mass * GRAVITY / 2 * (FINGER + PAD)
        np.testing.assert_allclose(info.object_position[-1, 0, 2], -sunk, rtol=ringing)
    else:
        np.testing.assert_allclose(force[-1, :, 2], -0.6 * squeeze, rtol=1e-9)
        assert np.asarray(info.object_position)[-1, 0, 2] < -mass * GRAVITY / 2 * (FINGER + PAD) - 1e-3


def bowl(turn):
    """A box and a ball fall askew between a table and a wall, everything turned."""
    R = turn.as_matrix()
    askew = turn * Rotation.from_rotvec([0.4, -0.3, 0.2])
    box = Object("box", Box(HALF), 0.4, mass=0.1, pose=at(R @ [0.0, 0.0, 0.06], askew), velocity=R @ [0.2, 0.1, 0.0])
    ball = Object("ball", Sphere(0.012), 0.0, mass=0.05, pose=at(R @ [0.01, 0.0, 0.13], turn))
    plate = Surface("table", Plane(np.zeros(3), R @ UP), 0.0)
    wall = Surface("wall", Plane(R @ [0.04, 0.0, 0.0], R @ [-0.8, 0.0, 0.6]), 0.0)
    return (plate, wall), (box, ball), R @ [0.0, 0.0, -GRAVITY]


@pytest.mark.slow
def test_the_same_in_any_frame_and_order():
    """Frictionless, so that facets do not matter."""
    surfaces, objects, gravity = bowl(Rotation.identity())
    _, here = alone(Scene("bowl", surfaces, objects=objects, gravity=gravity), 100)
    assert np.max(np.asarray(here.contact_force)) > 1.0
    turn = Rotation.from_euler("xyz", [0.3, -0.4, 0.7])
    turned = bowl(turn)
    _, there = alone(Scene("bowl", turned[0], objects=turned[1], gravity=turned[2]), 100)
    _, swapped = alone(Scene("bowl", surfaces[::-1], objects=objects, gravity=gravity), 100)
    rounding = 1e-7  # of a hundred steps with impacts, each pivoted in another order
    position = np.asarray(here.object_position)
    np.testing.assert_allclose(np.asarray(there.object_position), position @ turn.as_matrix().T, rtol=0, atol=rounding)
    np.testing.assert_allclose(swapped.object_position, position, rtol=0, atol=rounding)


def energy_of(item, info, scene):
    """Kinetic and potential, `[time]`."""
    R = jax.vmap(jax.vmap(quaternion_to_rotation))(info.object_quaternion)[:, 0]
    spin = jnp.einsum("tji,tj->ti", R, info.object_angular_velocity[:, 0])
    velocity = info.object_velocity[:, 0]
    centre = info.object_position[:, 0]
    moving = (item.mass * jnp.sum(velocity**2, axis=1) + jnp.einsum("ti,ij,tj->t", spin, item.inertia, spin)) / 2
    return moving - item.mass * centre @ scene.gravity


@pytest.mark.slow
def test_no_drop_gains_energy():
    """Boxes thrown askew: what the table returns is never more than what came."""
    random = np.random.default_rng(8)
    count = 60
    turns = Rotation.random(count, random_state=9).as_matrix()
    velocity = random.normal(size=(count, 3)) * [0.5, 0.5, 0.2]
    spin = 5 * random.normal(size=(count, 3))
    friction = random.choice([0.0, 0.2, 0.8], count)

    @jax.jit
    def energies(numbers):
        def one(numbers):
            turn, velocity, spin, friction = numbers
            box = Object(
                "box",
                Box(HALF),
                friction,
                mass=0.1,
                pose=Pose(turn, jnp.array([0.0, 0.0, 0.08])),
                velocity=velocity,
                angular_velocity=spin,
            )
            scene = Scene("drop", (Surface("table", Plane(np.zeros(3), UP), friction),), objects=(box,), facets=2)
            _, info = alone(scene, 400)
            return energy_of(box, info, scene), info.status, info.object_position[-1, 0, 2]

        return jax.lax.map(one, numbers)

    energy, status, height = (np.asarray(x) for x in energies((turns, velocity, spin, friction)))
    assert np.all(status == 0)
    gained = np.max(energy[:, 1:] - np.minimum.accumulate(energy, axis=1)[:, :-1], axis=1)
    scale = energy[:, 0]
    assert np.max(gained / scale) < 2e-3, gained / scale
    assert np.all(energy[:, -1] < energy[:, 0])
    assert np.all(height > 0.01)


def test_derivatives():
    """Of pose, velocity and forces after a landing, with respect to mass, size, friction, velocity and a push."""

    def landed(x):
        box = Object(
            "box",
            Box(HALF * x[1]),
            x[2],
            mass=0.1 * x[0],
            pose=at([0.0, 0.0, 0.042], Rotation.from_rotvec([0.2, -0.1, 0.3])),
            velocity=x[3:6] + jnp.array([0.2, 0.0, -0.3]),
        )
        scene = Scene("drop", (Surface("table", Plane(np.zeros(3), UP), 1.0),), objects=(box,))
        push = jnp.tile(jnp.concatenate([jnp.zeros(3), x[6:9]])[None, None], (12, 1, 1))
        state, info = alone(scene, 12, push)
        force = jnp.sum(info.contact_force[-1], axis=0)
        return jnp.concatenate([*state.motions[0], force, info.object_angular_velocity[-1, 0]])

    x = np.concatenate([[1.0, 1.0, 0.3], np.zeros(3), np.zeros(3)])
    assert np.max(np.abs(landed(x)[-6:-3])) > 0.1  # it has landed
    check_derivatives(landed, x, tolerance=1e-5)


def test_an_overlap_is_no_blow():
    """A box a centimetre inside the table rises at PARTING and flies no higher than that speed carries it."""
    sunk = Object("box", Box(HALF), 0.5, mass=0.1, pose=at([0.0, 0.0, HALF[2] - 0.01]))
    _, info = in_chunks(Scene("sunk", (table(),), objects=(sunk,)), 200)
    assert np.all(np.asarray(info.status) == 0)
    height = np.asarray(info.object_position)[:, 0, 2]
    assert np.max(height) < HALF[2] + PARTING**2 / (2 * GRAVITY)
    np.testing.assert_allclose(height[-1], HALF[2], atol=1e-9)


def test_nothing_to_touch_is_refused():
    box = Object("box", Box(HALF), 0.5, mass=0.1)
    with pytest.raises(ValueError, match="nothing in the scene can touch"):
        alone(Scene("empty", (), objects=(box,)), 3)


@pytest.mark.slow
def test_a_ball_meets_everything():
    """One comes to rest on a pole, another on top of it, a third on the table."""
    pole = Surface("pole", Box(np.array([0.02, 0.02, 0.1])), 0.5)
    balls = [
        Object(name, Sphere(0.01), 0.5, mass=0.05, pose=at([x, 0.0, z]))
        for name, x, z in [("low", 0.0, 0.111), ("high", 0.0, 0.1325), ("aside", 0.2, 0.012)]
    ]
    _, info = in_chunks(Scene("balls", (table(), pole), objects=tuple(balls)), 400)
    assert np.all(np.asarray(info.status) == 0)
    np.testing.assert_allclose(np.asarray(info.object_position)[-1, :, 2], [0.11, 0.13, 0.01], rtol=0, atol=1e-6)


def test_friction_of_pairs():
    block = Object("block", Box(np.array([0.03, 0.03, 0.01])), 0.5, mass=0.2, pose=at([0, 0, 0.01]))
    slope = np.array([2.0, 0.0, -9.0])
    smooth = Scene("a", (table(),), objects=(block,), gravity=slope, frictions=(PairFriction(("table", "block"), 0.1),))
    _, info = in_chunks(smooth, 20)
    assert np.asarray(info.object_position)[-1, 0, 0] > 1e-4
    _, info = in_chunks(dataclasses.replace(smooth, frictions=()), 20)
    assert np.abs(np.asarray(info.object_position)[-1, 0, 0]) < 1e-9
    with pytest.raises(ValueError, match="'tabel'"):
        alone(dataclasses.replace(smooth, frictions=(PairFriction(("tabel", "block"), 0.1),)), 20)


def test_bad_objects_are_named():
    box = Box(HALF)
    for arguments, words in [
        ({"mass": 0.0}, "'cup'.*mass must be positive"),
        ({"mass": -1.0}, "mass must be positive"),
        ({"mass": np.nan}, "mass must be finite"),
        ({}, "mass .* or its density"),
        ({"mass": 1.0, "density": 1.0}, "mass .* or its density"),
        ({"mass": 1.0, "inertia": np.diag([1.0, 1.0, 3.0])}, "no body has"),
        ({"mass": 1.0, "inertia": np.diag([1.0, 1.0, -1.0])}, "no body has"),
        ({"mass": 1.0, "velocity": [np.inf, 0, 0]}, "velocity must be finite"),
        ({"mass": 1.0, "pose": Pose(2 * np.eye(3), np.zeros(3))}, "no rotation"),
        ({"mass": 1.0, "pose": at([0.0, 0.0, 1e6])}, "position must be within"),
        ({"mass": [1.0, 1.0]}, "mass must be one number"),
        ({"mass": 1.0, "velocity": 1.0}, "velocity must be 3 numbers"),
        ({"mass": 1.0, "com": [0.0, 0.0]}, "com must be 3 numbers"),
        ({"mass": 1.0, "inertia": [1e-5, 1e-5, 1e-5]}, "inertia must be 3 x 3 numbers"),
    ]:
        with pytest.raises(ValueError, match=words):
            Object("cup", box, 0.5, **arguments)
    with pytest.raises(ValueError, match="friction must be 0 to"):
        Object("cup", box, -0.5, mass=1.0)
    with pytest.raises(ValueError, match="half_sizes must be positive"):
        Object("cup", Box(np.array([0.1, 0.0, 0.1])), 0.5, mass=1.0)
    with pytest.raises(ValueError, match="half-space has no mass"):
        Object("cup", Plane(np.zeros(3), UP), 0.5, mass=1.0)
    for wrong, words in [  # in the tests' strict mode the annotation speaks first
        (lambda: Object("cup", None, 0.5, mass=1.0), "shape"),
        (lambda: Object("cup", box, 0.5, mass=1.0, pose=np.eye(4)), "pose"),
        (lambda: Surface("table", None, 0.5), "shape"),
        (lambda: Scene("s", (table(),), facets=2.5), "facets"),
    ]:
        with pytest.raises(TypeError, match=words):
            wrong()
    bent = Pose(np.diag([1.0, 1.0, -1.0]), np.zeros(3))
    for wrong, words in [
        (lambda: Object("cup", box, [0.5, 0.2], mass=1.0), "friction must be one number"),
        (lambda: Object("cup", Placed(box, bent), 0.5, mass=1.0), "'cup': rotation is no rotation"),
        (lambda: Surface("egg", Ellipsoid(np.zeros(3), 2 * np.eye(3), HALF), 0.5), "'egg': rotation is no rotation"),
        (lambda: Scene("s", (table(),), gravity=-9.81), "gravity must be 3 numbers"),
        (lambda: Scene("s", (), objects=(Object("a/b", box, 0.5, mass=1.0),)), "without '/'"),
        (lambda: PairFriction(("cup", "cup"), 0.5), "two different things"),
    ]:
        with pytest.raises(ValueError, match=words):
            wrong()
    named = Scene("s", (table(),), objects=(Object("pad_left", box, 0.5, mass=1.0),))
    with pytest.raises(ValueError, match="'pad_left' is the name of a pad"):
        rollout(PINCH, named, Target(jnp.zeros((2, 6)), jnp.zeros((2, 6))))
    cup = Object("cup", box, 0.5, density=1000.0)
    np.testing.assert_allclose(cup.mass, 1000 * 8 * np.prod(HALF))
    with pytest.raises(ValueError, match="one name twice"):
        Scene("twice", (Surface("cup", Plane(np.zeros(3), UP), 0.5),), objects=(cup,))
    scene = Scene("one", (table(),), objects=(cup,))
    with pytest.raises(ValueError, match=r"wrench must be \[time, 1, 6\]"):
        alone(scene, 3, jnp.zeros((3, 2, 6)))
    assert json.loads(scene.describe())["objects"][0]["half_sizes"] == HALF.tolist()
