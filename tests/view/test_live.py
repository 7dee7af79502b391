"""What is behind the live page: variations, reruns in the background, playback, and the page without a browser."""

import dataclasses
import threading

import jax.monitoring
import numpy as np
import pytest
from view.example_live import MASS, RADIUS, make_pressing, make_scene
from view.example_objects import make_object_rollout
from view.example_records import make_recording

from icjax import view
from icjax.geometry import Box, Cylinder, Heightfield, Placed, Plane, Prism, Sphere, Union
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface
from icjax.view import Variation
from icjax.view._frames import pick_frames
from icjax.view._panel import contacts_html, status_html
from icjax.view._playback import Playback
from icjax.view._rerun import Rerun, Told
from icjax.view._substitutes import SUBSTITUTES, extent, lowest
from icjax.view._variation import can_resize

UP = np.array([0.0, 0.0, 1.0])
PATIENCE = 300.0
"""s to wait for a thread; nothing is asserted about time."""


def box_scene() -> Scene:
    """A box that stands on its head."""
    pose = Pose(np.diag([1.0, -1.0, -1.0]), np.array([0.1, 0.0, 0.02]))
    box = Object("box", Box(np.array([0.01, 0.03, 0.02])), 0.4, mass=0.2, com=np.array([0.0, 0.001, 0.0]), pose=pose)
    wall = Placed(Box(np.array([0.1, 0.01, 0.1])), Pose(np.eye(3), np.array([0.0, 0.5, 0.1])))
    return Scene("boxes", (Surface("table", Plane(np.zeros(3), UP), 0.6), Surface("wall", wall, 0.3)), objects=(box,))


def bottom(thing: Object) -> float:
    R = np.asarray(thing.pose.rotation)
    return float(thing.pose.position[2]) + lowest(thing.shape, R.T @ UP)


def test_numbers_of_a_scene_are_varied():
    scene = box_scene()
    box = scene.objects[0]
    varied = view.varied_scene(scene, Variation(friction={"wall": 0.7, "box": 0.1}, mass={"box": 0.6}))
    assert [float(item.friction) for item in varied.surfaces] == pytest.approx([0.6, 0.7])
    heavy = varied.objects[0]
    assert (float(heavy.friction), float(heavy.mass)) == pytest.approx((0.1, 0.6))
    np.testing.assert_allclose(heavy.inertia, 3.0 * box.inertia, rtol=1e-12)
    np.testing.assert_array_equal(heavy.com, box.com)
    large = view.varied_scene(scene, Variation(size={"box": 2.0, "wall": 0.5}))
    np.testing.assert_allclose(large.objects[0].shape.half_sizes, [0.02, 0.06, 0.04])
    np.testing.assert_allclose(large.objects[0].inertia, 4.0 * box.inertia, rtol=1e-12)
    np.testing.assert_allclose(large.objects[0].com, 2.0 * box.com)
    assert bottom(large.objects[0]) == pytest.approx(bottom(box), abs=1e-15)
    np.testing.assert_allclose(large.surfaces[1].shape.shape.half_sizes, [0.05, 0.005, 0.05])
    np.testing.assert_array_equal(large.surfaces[1].shape.pose.position, [0.0, 0.5, 0.1])  # about its middle
    same = view.varied_scene(scene, Variation())
    assert same.describe() == scene.describe()


@pytest.mark.parametrize("kind", SUBSTITUTES)
def test_another_shape_fills_the_same_room_and_stands_as_low(kind):
    scene = box_scene()
    box = scene.objects[0]
    other = view.varied_scene(scene, Variation(shape={"box": kind}, mass={"box": 0.3})).objects[0]
    assert bottom(other) == pytest.approx(bottom(box), abs=1e-15)
    half, volume = extent(other.shape)[1], float(other.shape.mass_properties().volume)
    assert float(other.mass) == pytest.approx(0.3)
    np.testing.assert_allclose(other.com, other.shape.mass_properties().com, atol=1e-15)  # filled evenly
    if kind in ("box", "ellipsoid"):
        np.testing.assert_allclose(half, [0.01, 0.03, 0.02], rtol=1e-12)
    elif kind == "wedge":  # 8 degrees: wider at the bottom, 0.01 at half the height; as high and as deep
        np.testing.assert_allclose(half, [0.01 + 0.02 * np.tan(np.radians(8.0)), 0.03, 0.02], rtol=1e-12)
        assert isinstance(other.shape.shape, Prism)
        top = np.asarray(other.pose.rotation) @ np.asarray(other.shape.pose.rotation) @ np.array([0.0, 1.0, 0.0])
        np.testing.assert_allclose(top, UP, atol=1e-15)
    elif kind == "sphere":
        assert volume == pytest.approx(4 / 3 * np.pi * 0.01 * 0.03 * 0.02)
    else:  # along y, the longest axis
        assert half[1] == pytest.approx(0.03)
        assert half[0] == half[2] == pytest.approx(np.sqrt(0.01 * 0.02))


def test_shapes_whose_contacts_can_be_found_are_offered():
    for scene, name in ((make_scene(), "ball"), (box_scene(), "box")):
        assert view.shapes_for(scene, name) == ("as given", *SUBSTITUTES)


def test_a_union_grows_as_a_whole_and_coupled_joints_soften_together():
    low = Pose(np.eye(3), np.array([0.0, 0.0, -0.03]))
    bulb = Object("bulb", Union([Sphere(0.02), Placed(Cylinder(0.01, 0.02), low)]), 0.5, mass=0.03)
    scene = Scene("bulb", box_scene().surfaces, objects=(bulb,))
    (same,) = view.varied_scene(scene, Variation()).objects
    (found,) = view.varied_scene(scene, Variation(size={"bulb": 1.5})).objects
    for point in np.random.default_rng(0).normal(scale=0.04, size=(20, 3)):
        given = float(bulb.shape.signed_distance(point))
        np.testing.assert_allclose(same.shape.signed_distance(point), given, atol=1e-15)
        np.testing.assert_allclose(found.shape.signed_distance(1.5 * point), 1.5 * given, atol=1e-15)
    ground = Surface("ground", Heightfield(np.zeros((4, 4)), 0.01), 0.5)
    assert not can_resize(ground.shape)
    (kept,) = view.varied_scene(Scene("ground", (ground,)), Variation()).surfaces
    np.testing.assert_array_equal(kept.shape.heights, ground.shape.heights)
    pressing = make_pressing()
    full = np.array([np.diag(row) for row in np.asarray(pressing.compliance)])
    softer = view.varied_interaction(dataclasses.replace(pressing, full_compliance=full), Variation(compliance=3.0))
    np.testing.assert_array_equal(softer.full_compliance, 3.0 * full)


def test_what_cannot_be_varied_is_refused():
    scene = make_scene()
    for wrong, words in (
        (Variation(mass={"cup": 1.0}), "mass of 'cup', which is none of ball, plate"),
        (Variation(size={"ball": 0.0}), "size must be positive"),
        (Variation(mass={"ball": -1.0}), "mass must be positive"),
        (Variation(shape={"ball": "torus"}), "unknown shape 'torus'"),
    ):
        with pytest.raises(ValueError, match=words):
            view.varied_scene(scene, wrong)
    with pytest.raises(ValueError, match="zero or more"):
        view.varied_interaction(make_pressing(), Variation(compliance=-1.0))


def test_playback_goes_round_and_keeps_its_moment():
    play = Playback(np.array([1.0, 1.1, 1.4]), speed=0.5)
    assert (play.at, play.row) == (1.0, 0)
    assert play.advance(0.4)
    assert play.at == pytest.approx(1.2)
    assert play.row == 1
    play.advance(0.12)
    assert play.row == 2
    play.advance(0.4)  # past the end by 0.06 s
    assert play.at == pytest.approx(1.06)
    play.playing = False
    assert not play.advance(1.0)
    play.go_to(9.0)
    assert (play.at, play.row) == (1.4, 2)
    play.replace(np.array([0.0, 1.2]))
    assert (play.at, play.row) == (1.2, 1)
    assert Playback(np.zeros(1)).row == 0


def test_only_the_latest_request_is_finished():
    begun, go_on = threading.Event(), threading.Event()
    made: list = []
    told: list = []

    def compute(request, progress):
        if request == "first":
            begun.set()
            assert go_on.wait(PATIENCE)
        progress(0.5)
        if request == "wrong":
            raise ValueError("no such\nthing")
        return request.upper()

    rerun = Rerun(compute, lambda request, result: made.append((request, result)), told.append, pause=0.02)
    try:
        rerun.ask("first")
        assert begun.wait(PATIENCE)
        rerun.ask("second")
        rerun.ask("third")
        go_on.set()
        assert rerun.wait(PATIENCE)
        assert made == [("third", "THIRD")]
        assert told[-1] == Told("ready", 1.0)
        rerun.ask("wrong")
        assert rerun.wait(PATIENCE)
        assert told[-1] == Told("failed", 0.0, "no such thing")
        rerun.ask("fourth")
        assert rerun.wait(PATIENCE)
        assert made[1:] == [("fourth", "FOURTH")]
    finally:
        rerun.close()


@pytest.fixture(scope="module")
def page():
    """A live page of a pad that presses a ball, its first transfer done."""
    page = view.explore(make_pressing(), make_scene(), port=0, browser=False)
    assert page.explorer.wait(PATIENCE)
    yield page
    page.close()


def peak(rollout) -> float:
    return float(np.linalg.norm(np.asarray(rollout.contact_force)[:, 1], axis=1).max())


def test_moving_a_slider_compiles_nothing_and_a_failure_keeps_the_last_result(page):
    explorer, compiled = page.explorer, []
    first = explorer.take()[0]
    assert first is not None
    assert first.slot_names == ("pad/plate", "pad/ball", "ball/plate")
    jax.monitoring.register_event_duration_secs_listener(
        lambda name, seconds, **_: compiled.append(name) if "backend_compile" in name else None
    )
    changed = Variation(0.5, friction={"ball": 0.9, "plate": 0.1}, mass={"ball": 2.0 * MASS}, size={"ball": 1.1})
    explorer.vary(changed)
    assert explorer.wait(PATIENCE)
    second, told = explorer.take()
    assert told == Told("ready", 1.0)
    assert compiled == []
    assert second is not first
    # Half the compliance on a ball whose top is 4 mm higher presses harder.
    assert peak(second) > 1.5 * peak(first)
    radius = float(np.asarray(second.object_position)[0, 0, 2])
    assert radius == pytest.approx(1.1 * RADIUS, abs=1e-6)
    explorer.vary(Variation(mass={"ball": -1.0}))
    assert explorer.wait(PATIENCE)
    kept, told = explorer.take()
    assert kept is second
    assert told.state == "failed"
    assert "mass must be positive" in told.text
    explorer.vary(Variation())
    assert explorer.wait(PATIENCE)
    np.testing.assert_array_equal(explorer.take()[0].contact_force, first.contact_force)
    assert compiled == []


def test_the_page_follows_the_explorer(page):
    page.tick(0.0)
    assert page.record is page.explorer.rollout
    slider = page.sliders._handles["mass", "ball"][0]
    assert slider.value == pytest.approx(1e3 * MASS)
    assert page.sliders.variation() == Variation()
    slider.value = 120.0
    page.sliders._handles["compliance", ""][0].value = 2.0
    page.sliders._handles["shape", "ball"][0].value = "box"
    assert page.sliders.variation() == Variation(2.0, mass={"ball": 0.12}, shape={"ball": "box"})
    assert page.sliders.variation().form() == (("ball", "box"),)
    page.explorer.vary(Variation(size={"ball": -1.0}))
    assert page.explorer.wait(PATIENCE)
    page.tick(0.0)
    assert "failed: " in page._status.content
    assert "size must be positive" in page._status.content
    assert "Shown: the last result" in page._status.content
    assert isinstance(page.record, type(page.explorer.rollout))
    page.sliders.reset()
    assert page.explorer.wait(PATIENCE)
    page.tick(0.0)
    assert page.sliders.variation() == Variation()
    assert "failed" not in page._status.content


def test_a_finished_rollout_is_only_played():
    rollout = make_object_rollout()
    page = view.explore(rollout, port=0, browser=False)
    try:
        assert page.explorer is None
        page._time.play(False)
        page.playback.go_to(1.2)
        page.tick(0.1)
        page._table_due = 0.0
        page._tabled = (0, -1)
        page.tick(0.0)
        assert page.playback.at == 1.2
        assert "fingertip on box" in page._table.content
        assert page.stage.cones.root.visible is False
        page._shown["friction cones"].value = True
        assert page.stage.cones.root.visible is True
    finally:
        page.close()
    assert not page._thread.is_alive()


def test_a_scene_goes_with_an_interaction():
    with pytest.raises(ValueError, match="a scene goes with an interaction; got a rollout"):
        view.explore(make_object_rollout(), make_scene(), browser=False)
    scene = make_scene()
    named = dataclasses.replace(scene, surfaces=(dataclasses.replace(scene.surfaces[0], name="pad"),))
    with pytest.raises(ValueError, match="'pad' is the name of a pad"):
        view.explore(make_pressing(), named, browser=False)


def test_the_table_of_contacts_tells_force_state_and_share_of_friction():
    rollout = make_object_rollout()
    shown = pick_frames(rollout, 600, 200.0)
    k = int(np.searchsorted(shown.time, 1.2))
    cells = contacts_html(shown, k, True)
    weight = np.hypot(MASS_OF_BOX * 9.81, 0.3)
    assert "box on plate</td><td" in cells
    assert f"{weight:.2f} N" in cells
    assert ">sliding<" in cells
    share = 0.3 / (MASS_OF_BOX * 9.81) / 0.3  # friction of the pair is 0.3
    assert f"{share:.0%}" in cells
    bare = dataclasses.replace(rollout, contact_force=0 * rollout.contact_force, slip_state=0 * rollout.slip_state)
    assert "Nothing touches" in contacts_html(pick_frames(bare, 600, 200.0), k, True)
    measured = pick_frames(make_recording(), 600, 200.0)
    assert "of μ" in contacts_html(measured, 100, False)
    assert "&lt;b&gt;" in status_html("<b>", Told("failed", text="<b>"), "nothing")


MASS_OF_BOX = 0.05


def test_a_ball_keeps_its_kind():
    assert isinstance(view.varied_scene(make_scene(), Variation(size={"ball": 1.5})).objects[0].shape, Sphere)
