"""Objects in pictures are where the rollout says, and forces are those on them or on the hand."""

import base64
import dataclasses
import re
import struct

import numpy as np
import pytest
import zstandard
from view.example_objects import (
    BALL_MASS,
    BOX_MASS,
    CORNERS,
    GRAVITY,
    HALF,
    PUSH,
    RADIUS,
    ROLLING,
    SLIDE,
    course,
    make_object_rollout,
)
from view.example_records import make_interaction, make_recording, make_rollout

from icjax import view
from icjax.view import _frames
from icjax.view._force_plots import stated_friction
from icjax.view._objects import moving, object_colour, upward
from icjax.view._pairs import largest_force, pair_forces

ROUNDING = 1e-12


@pytest.fixture(scope="module")
def rollout():
    return make_object_rollout()


def test_objects_are_where_they_are(rollout):
    rows = np.array([0, 250, 450, 599])
    box, turn, ball, roll = course(np.asarray(rollout.time)[rows])
    first, second = moving(rollout, rows)
    assert (first.solid.name, second.solid.name) == ("box", "ball")
    assert first.colour != second.colour
    point = np.array([[0.001, 0.002, 0.003]])
    for k in range(len(rows)):
        np.testing.assert_allclose(first.at(k, point)[0], box[k] + turn[k].apply(point)[0], atol=ROUNDING)
        np.testing.assert_allclose(second.at(k, point)[0], ball[k] + roll[k].apply(point)[0], atol=ROUNDING)
    assert moving(make_rollout("flat", bump=False)) == ()
    assert moving(make_recording()) == ()


def test_corners_are_summed_at_the_centre_of_pressure(rollout):
    pairs = pair_forces(rollout)
    assert pairs.bodies == (("fingertip", "plate"), ("fingertip", "box"), ("box", "plate"), ("ball", "plate"))
    np.testing.assert_array_equal(pairs.on_hand, [True, True, False, False])
    weight = np.array([0.0, 0.0, BOX_MASS * GRAVITY])
    np.testing.assert_allclose(pairs.force[0, 2], weight, atol=ROUNDING)
    corners = np.array([[x, y, -HALF[2]] for x in (-HALF[0], HALF[0]) for y in (-HALF[1], HALF[1])])
    expected = np.asarray(rollout.object_position)[0, 0] + np.array([0.4, 0.3, 0.2, 0.1]) @ corners
    np.testing.assert_allclose(pairs.point[0, 2], expected, atol=ROUNDING)
    assert pairs.state[0, 2] == 1
    assert pairs.state[220, 2] == 2  # one of its corners slides
    np.testing.assert_allclose(largest_force(pairs), np.linalg.norm(rollout.contact_force[:, :2], axis=2).max())


def test_records_without_objects_are_left_as_they_are():
    bump = make_rollout("bump")
    pairs = pair_forces(bump, np.arange(0, 600, 7))
    np.testing.assert_array_equal(pairs.force, bump.contact_force[::7])
    np.testing.assert_array_equal(pairs.point, bump.contact_point[::7])
    np.testing.assert_array_equal(pairs.state, bump.slip_state[::7])
    recording = make_recording()
    np.testing.assert_array_equal(pair_forces(recording).force, recording.contact_force)
    assert not pair_forces(recording).state.any()


def test_a_blow_between_objects_does_not_shrink_the_arrows(rollout):
    force = np.zeros_like(rollout.contact_force)
    force[:, 2, 2] = 1.0
    force[300, 2, 2] = 500.0
    assert largest_force(pair_forces(dataclasses.replace(rollout, contact_force=force))) == 1.0
    assert largest_force(pair_forces(dataclasses.replace(rollout, contact_force=0 * force))) > 0.0


def test_force_plots_are_of_the_hand(rollout):
    flat = make_rollout("flat", bump=False)
    normal, tangential = view.force_components(rollout)
    t = np.asarray(rollout.time)
    pushing = (t >= 1.0) & (t < 1.5)
    alone = view.force_components(flat)
    np.testing.assert_allclose(normal, alone[0] + np.where(pushing, PUSH, 0.0), atol=ROUNDING)
    np.testing.assert_allclose(tangential, alone[1], atol=ROUNDING)
    # mu of a pair without a pad says nothing of the hand
    assert stated_friction(rollout.scene, rollout.model.pad_names) == 0.5
    assert stated_friction(rollout.scene, ("box",)) is None


def test_the_course_of_an_object_in_closed_form(rollout):
    t = np.asarray(rollout.time)
    box, ball = view.object_course(rollout, "box"), view.object_course(rollout, "ball")
    assert (box.ball, ball.ball) == (False, True)
    np.testing.assert_allclose(ball.moved, ROLLING * t, atol=ROUNDING)
    np.testing.assert_allclose(RADIUS * ball.turned, ball.moved, atol=ROUNDING)  # it rolls
    np.testing.assert_allclose(ball.speed, ROLLING, rtol=1e-9)
    np.testing.assert_allclose(ball.carried, ball.weight, rtol=1e-12)
    assert ball.weight == pytest.approx(BALL_MASS * GRAVITY)
    assert not ball.pushed.any()
    slid = np.searchsorted(t, 1.7)
    np.testing.assert_allclose(box.moved[slid], SLIDE, atol=ROUNDING)
    np.testing.assert_allclose(box.lifted[-1], HALF[0] - HALF[2], atol=ROUNDING)
    np.testing.assert_allclose(box.lifted.max(), np.hypot(HALF[0], HALF[2]) - HALF[2], rtol=1e-3)  # on its edge
    np.testing.assert_allclose(np.degrees(box.tilt[[slid, -1]]), [0.0, 90.0], atol=1e-5)  # arccos near 1
    np.testing.assert_allclose(box.carried, BOX_MASS * GRAVITY, rtol=1e-12)
    np.testing.assert_allclose(box.pushed.max(), PUSH)
    assert box.overlap == pytest.approx(0.003)
    unstated = dataclasses.replace(rollout, scene='{"name": "objects"}')
    assert view.object_course(unstated, "box").weight is None


def test_up_is_against_the_gravity_of_the_scene(rollout):
    np.testing.assert_array_equal(upward(rollout), [0.0, 0.0, 1.0])
    turned = dataclasses.replace(rollout, scene=rollout.scene.replace("[0.0, 0.0, -9.81]", "[0.0, -9.81, 0.0]"))
    np.testing.assert_array_equal(upward(turned), [0.0, 1.0, 0.0])
    weightless = dataclasses.replace(rollout, scene=rollout.scene.replace("[0.0, 0.0, -9.81]", "[0.0, 0.0, 0.0]"))
    np.testing.assert_array_equal(upward(weightless), [0.0, 0.0, 1.0])


def test_plots_of_objects_draw_their_course(rollout):
    figure = view.plot_objects(rollout)
    assert len(figure.axes) == 10
    moved, lifted, tilt, speed, force = figure.axes[::2]
    box = view.object_course(rollout, "box")
    np.testing.assert_array_equal(moved.lines[0].get_ydata(), 1e3 * box.moved)
    np.testing.assert_array_equal(tilt.lines[0].get_ydata(), np.degrees(box.tilt))
    assert [axis.get_ylabel() for axis in (lifted, tilt, speed)] == ["lifted (mm)", "tilt (deg)", "speed (mm/s)"]
    assert figure.axes[5].get_ylabel() == "turned (deg)"
    carried, pushed, weight = force.lines
    np.testing.assert_allclose(carried.get_ydata(), box.weight, rtol=1e-12)
    np.testing.assert_allclose(pushed.get_ydata().max(), PUSH, rtol=1e-12)
    assert weight.get_ydata()[0] == box.weight
    (touched,) = moved.patches
    np.testing.assert_allclose(touched.get_x(), 1.0)
    np.testing.assert_allclose(touched.get_width(), 0.495)
    assert len(view.plot_objects(rollout, ("ball",)).axes) == 5
    with pytest.raises(ValueError, match="unknown object 'cup'; the rollout has box, ball"):
        view.plot_objects(rollout, ("cup",))
    with pytest.raises(ValueError, match="has no objects to draw"):
        view.plot_objects(make_rollout("bump"))


def test_the_grip_is_that_of_every_fingertip(rollout):
    figure = view.plot_grip(rollout)
    normal, friction, ratio = figure.axes
    (line,) = normal.lines
    assert line.get_label() == "fingertip"
    t = np.asarray(rollout.time)
    pushing = (t >= 1.0) & (t < 1.5)
    alone = view.force_components(make_rollout("flat", bump=False))
    np.testing.assert_allclose(line.get_ydata(), alone[0] + np.where(pushing, PUSH, 0.0), atol=ROUNDING)
    np.testing.assert_allclose(friction.lines[0].get_ydata(), alone[1], atol=ROUNDING)
    # On the plate mu is 0.5; where its force is below a twentieth of the largest there is no ratio of it.
    shown = alone[0] > 0.05 * max(alone[0].max(), PUSH)
    found = ratio.lines[0].get_ydata()
    np.testing.assert_allclose(found[shown], alone[1][shown] / (0.5 * alone[0][shown]), atol=1e-9)
    assert not np.isfinite(found[~shown & ~pushing]).any()
    np.testing.assert_array_equal(found[~shown & pushing], 0.0)
    assert sorted(item.get_ydata()[0] for item in ratio.lines[1:]) == pytest.approx([np.cos(np.pi / 8), 1.0])
    stiffer = np.where(t > 1.2, 0.25, 1.0)[:, None] * np.concatenate([np.zeros(6), np.ones(4)])
    last = view.plot_grip(dataclasses.replace(rollout, compliance=stiffer)).axes[3]
    np.testing.assert_allclose(last.lines[0].get_ydata(), np.where(t > 1.2, 0.25, 1.0))
    still = view.plot_grip(dataclasses.replace(rollout, compliance=np.ones((len(t), 10))))
    assert len(still.axes) == 3
    with pytest.raises(ValueError, match="nothing touches the hand"):
        view.plot_grip(dataclasses.replace(rollout, contact_force=0.0 * rollout.contact_force))


def coloured(artists, colour):
    from matplotlib.colors import same_color

    return [item for item in artists if same_color(item.get_facecolor()[:3], colour)]


def test_the_snapshot_shows_objects_and_what_the_hand_does_to_them(rollout):
    side = view.draw_snapshot(rollout, times=[0.5, 1.2, 2.2]).axes[0]
    for number in (0, 1):
        assert len(coloured(side.patches, object_colour(number))) == 3
    # fingertip on plate and box where they press; at the moment with the largest force also box and ball on the plate
    pairs = pair_forces(rollout, np.searchsorted(rollout.time, [0.5, 1.2, 2.2]))
    pressing = np.linalg.norm(pairs.force[:, :2], axis=2) > 0.04 * largest_force(pair_forces(rollout))
    assert len(side.texts) == int(pressing.sum()) + 2
    assert coloured(side.patches, "#D9D2C5"), "the rail is cut"


def test_the_path_shows_objects_at_both_ends_but_not_what_has_left(rollout):
    interaction = make_interaction(make_recording())
    axis = view.plot_path(interaction, (rollout,)).axes[0]
    (box,) = coloured(axis.patches, object_colour(0))
    start = next(line for line in axis.lines if line.get_color() == object_colour(0))
    assert start.is_dashed()
    height = np.ptp(start.get_ydata())
    assert height == pytest.approx(2e3 * HALF[2])
    assert np.ptp(box.get_xy()[:, 1]) == pytest.approx(2e3 * HALF[0])  # it lies on its side
    left, _ = axis.get_xlim()
    assert left > 1e3 * (0.5 * (-0.12 - 0.12 - 3.0 * ROLLING)), "the ball that rolled away is not waited for"
    assert [text.get_text() for text in axis.texts] == ["box", "ball"]


def test_the_3d_page_moves_the_objects(rollout):
    page = view.export_scene(rollout, frames=12)
    data = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]*)"', page)[1])
    messages = zstandard.ZstdDecompressor().decompress(data[data.index(b"\x28\xb5\x2f\xfd") :], max_output_size=1 << 24)
    double = rb"\xcb(.{8})"
    placed = rb"\x92" + double + rb"\x84\xa4name\xa9/object/1\xa8position\x93" + 3 * double
    seen = np.array([[struct.unpack(">d", part)[0] for part in found] for found in re.findall(placed, messages, re.S)])
    assert len(seen) == 12
    rows = np.searchsorted(rollout.time, seen[:, 0] - 1e-9)
    assert len(set(rows)) == 12
    np.testing.assert_array_equal(seen[:, 1:], rollout.object_position[rows, 1])
    # The box stands still for a third of the time, which is not told again and again.
    assert len(re.findall(rb"/object/0\xa8position", messages)) >= 6
    assert b"/surface/1/lines" in messages
    force_nodes = set(re.findall(rb"/force/\d+-[0-9a-f]{6}", messages))
    assert len(force_nodes) < CORNERS, "an arrow a pair and colour, none a corner"


def test_the_3d_view_looks_at_the_fingers_and_what_is_near(rollout):
    def framed(item):
        return _frames.framing(item, _frames.pick_frames(item, 12, 30.0))

    whole, close = framed(make_rollout("flat", bump=False)), framed(rollout)
    assert close[1] < whole[1]
    for place in np.asarray(rollout.object_position)[:: len(rollout.time) - 1, 0]:
        assert np.linalg.norm(place - close[0]) < close[1]
