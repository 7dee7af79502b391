"""Figures: what they draw is what the records hold; bad requests are named."""

import importlib
import re

import numpy as np
import pytest
from view.example_leg import with_ball_joint
from view.example_records import (
    COMPLIANCE,
    coordinates,
    finger,
    make_interaction,
    make_recording,
    make_rollout,
    reference,
    surface,
    tip,
    touch,
)

from icjax import view
from icjax.view import _extras, _meshes, _skeleton, _surfaces
from icjax.view._force_plots import stated_friction
from icjax.view._motion_plots import contact_intervals

ROUNDING = 1e-12
"""Allowed where both sides are the same few float64 operations on numbers of order one."""


@pytest.fixture(scope="module")
def interaction():
    return make_interaction(make_recording())


@pytest.fixture(scope="module")
def bump():
    return make_rollout("bump")


def lines(axis) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {line.get_label(): (np.asarray(line.get_xdata()), np.asarray(line.get_ydata())) for line in axis.lines}


def test_the_example_obeys_equation_1():
    _, planned = reference()
    state = touch(0.5, True)
    np.testing.assert_allclose(state["angles"], planned + COMPLIANCE * state["torque"], atol=ROUNDING)


def test_pad_path_is_the_finger_tip():
    model = finger()
    root, planned = reference()
    expected = np.array([tip(model, *row)[0] for row in zip(root, planned, strict=True)])
    found = _skeleton.pad_path(model, coordinates(root, planned))
    np.testing.assert_allclose(found, expected, atol=ROUNDING)


def test_every_segment_of_the_finger_is_drawn():
    model = finger()
    drawn = {model.body_names[bone.body]: bone for bone in _skeleton.bones(model)}
    assert set(drawn) == set(model.body_names) - {"world"}
    # The forearm's frame sits at the wrist, so the segment ends there and starts behind it.
    np.testing.assert_array_equal(drawn["forearm"].end, np.zeros(3))
    assert drawn["forearm"].start[0] < -0.1


def test_contact_figure_draws_the_fit_and_the_data(interaction):
    figure = view.plot_contact_event(interaction, 1, "MP")
    top, bottom = figure.axes
    drawn = lines(top)
    column = interaction.per_event.joint_names.index("MP")
    s, before = drawn["fits"]
    expected = np.polynomial.polynomial.polyval(1e-3 * s, interaction.per_event.angle_before[1, column])
    np.testing.assert_allclose(before, np.degrees(expected), atol=1e-10)
    shown, angle = drawn["measured angle θ"]
    times = float(interaction.per_event.onset[1]) + 1e-3 * shown
    samples = np.interp(times, interaction.time, np.degrees(interaction.q[:, 8]))
    np.testing.assert_allclose(angle, samples, atol=1e-9)
    assert "deg" in top.get_ylabel()
    assert "mNm" in bottom.get_ylabel()
    assert "ms" in bottom.get_xlabel()
    assert "accepted" in top.get_title(loc="left")


def test_negative_event_is_marked_with_the_reference_it_would_need(interaction):
    top = view.plot_contact_event(interaction, 1, "PIP", trial_compliance=1.0).axes[0]
    assert "negative" in top.get_title(loc="left")
    assert any("C = 1 rad/Nm" in label for label in lines(top))


def test_bad_requests_are_named(interaction):
    with pytest.raises(ValueError, match="event is 99"):
        view.plot_contact_event(interaction, 99, "MP")
    with pytest.raises(ValueError, match="elbow"):
        view.plot_contact_event(interaction, 0, "elbow")
    with pytest.raises(ValueError, match="nothing to draw"):
        view.plot_forces(None, ())
    with pytest.raises(ValueError, match="nothing to draw"):
        view.plot_path(None)


def test_no_event_is_hidden_and_no_bar_leaves_the_panel(interaction):
    per_event = interaction.per_event
    for axis, column in zip(view.plot_compliance(per_event, interaction.summary).axes, range(4), strict=True):
        low, high = axis.get_ylim()
        dots = [line for line in axis.lines if line.get_marker() not in ("None", None, "")]
        numbers = np.arange(1, len(per_event.onset) + 1)
        np.testing.assert_array_equal([float(line.get_xdata()[0]) for line in dots], numbers)
        assert all(low < np.min(line.get_ydata()) and np.max(line.get_ydata()) < high for line in axis.lines)
        for event, dot in enumerate(dots):
            usable = per_event.status[event, column] < 2
            height = float(dot.get_ydata()[0])
            if usable:
                assert height == per_event.compliance[event, column]
            else:
                assert height < low + 0.1 * (high - low)
                assert dot.get_markerfacecolor() == "white"


def test_heights_are_those_of_the_world_and_the_measured_path_lies_on_top(interaction, bump):
    axis = view.plot_path(interaction, (bump,)).axes[0]
    model = interaction.model
    lowest = _skeleton.pad_path(model, interaction.q)[:, 2] - float(np.asarray(model.pad_radius)[0])
    measured = next(line for line in axis.lines if line.get_label() == "measured")
    simulated = next(line for line in axis.lines if line.get_label() == "simulated")
    np.testing.assert_allclose(measured.get_ydata(), 1e3 * lowest, atol=1e3 * ROUNDING)
    assert axis.lines.index(measured) > axis.lines.index(simulated)
    assert measured.is_dashed()


def test_a_ball_joint_has_no_curve(interaction):
    ball = with_ball_joint(interaction)
    assert [joint.name for joint in view.scalar_joints(ball.model)] == ["rail", "knee"]
    with pytest.raises(ValueError, match="ankle_x"):
        view.plot_contact_event(ball, 0, "ankle_x")
    top, bottom = view.plot_contact_event(ball, 0, "rail").axes
    assert "(mm)" in top.get_ylabel()
    assert "(N)" in bottom.get_ylabel()
    assert len(view.plot_angles(ball).axes) == 2


def test_contact_intervals_match_the_force(interaction):
    starts = [start for start, _ in contact_intervals(interaction)]
    # The shading threshold (0.05 N) is passed within 20 ms of the onset at this approach speed.
    np.testing.assert_allclose(starts, interaction.per_event.onset, atol=0.02)


def test_force_components_split_the_force(bump):
    normal, tangential = view.force_components(bump)
    total = np.linalg.norm(bump.contact_force.sum(axis=1), axis=-1)
    np.testing.assert_allclose(np.hypot(normal, tangential), total, atol=ROUNDING)
    assert normal.min() >= 0
    assert stated_friction(bump.scene) == 0.5
    assert stated_friction("") is None


def test_profile_is_the_surface(bump):
    shapes = _surfaces.surfaces_of(bump)
    distance = np.linspace(-0.03, 0.03, 61)
    along, up = np.eye(3)[0], np.eye(3)[2]
    height = _surfaces.profile(shapes, np.zeros(3), along, up, distance)
    # The example smooths away the outermost 2 % of the ellipsoid, which lies below the plate.
    np.testing.assert_allclose(height, [surface(float(x), True)[0] for x in distance], atol=ROUNDING)
    assert _surfaces.scene_surfaces("not json") == ()


@pytest.mark.parametrize("which", ["bone", "bump", "shaft", "head"])
def test_meshes_are_closed_and_face_outwards(bump, which):
    shaft, head = _meshes.arrow_meshes(0.1, 0.2, 0.3, sectors=64)
    shapes = {
        "bone": lambda: _meshes.bone_mesh(_skeleton.Bone(1, np.zeros(3), np.array([0.0, 0.0, 1.0]), 0.1, 0.1), 24, 96),
        "bump": lambda: _surfaces.bump_mesh(_surfaces.surfaces_of(bump)[1], 64, 96),
        "shaft": lambda: shaft,
        "head": lambda: head,
    }
    volumes = {
        "bone": np.pi * 0.1**2 * (1.0 + 0.4 / 3),
        "bump": 4 / 3 * np.pi * 0.02 * 0.03 * 0.012,
        "shaft": np.pi * 0.1**2,
        "head": np.pi * 0.2**2 * 0.3 / 3,
    }
    vertices, faces = shapes[which]()
    corners = vertices[faces]
    volume = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    # The volume is positive only where faces point outwards; inscribed polygons lose less than 1 %.
    assert 0.99 * volumes[which] < volume <= volumes[which]


def test_svg_stands_alone_and_its_ids_carry_the_prefix(interaction):
    text = view.svg(view.plot_angles(interaction), "fig-1", 'a "figure" <1>')
    assert text.startswith("<svg")
    assert all(name.startswith("fig-1-") for name in re.findall(r'\bid="([^"]*)"', text))
    assert all(name.startswith("fig-1-") for name in re.findall(r"url\(#([^)]*)\)", text))
    assert "<text" in text
    assert "DejaVu" not in text
    outside = re.sub(r'xmlns(:xlink)?="[^"]*"', "", text)
    assert "http" not in outside
    assert 'aria-label="a &quot;figure&quot; &lt;1>"' in text


def test_snapshot_writes_a_picture(tmp_path, bump, interaction):
    path = view.snapshot(bump, tmp_path / "new" / "picture.png", measured=interaction)
    assert path.read_bytes().startswith(b"\x89PNG")
    assert [item.name for item in path.parent.iterdir()] == ["picture.png"]


def test_a_missing_package_is_named_with_its_cure(monkeypatch):
    def absent(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(ImportError, match=r'viser .* pip install "icjax\[viz\]"'):
        _extras.require("viser.transforms")
