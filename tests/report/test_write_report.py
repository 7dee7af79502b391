"""What the page says when parts are missing, and that it is written whole or not at all."""

import dataclasses
import re
from concurrent.futures import BrokenExecutor, Executor, Future, ThreadPoolExecutor

import equinox as eqx
import numpy as np
import pytest
from view.example_fit import REASON, make_fit
from view.example_leg import with_ball_joint, without_poses
from view.example_objects import make_object_rollout
from view.example_records import make_interaction, make_recording, make_rollout

from icjax import report as report_package
from icjax.files import FileError
from icjax.recording import Session
from icjax.report import Report, _estimates, _sections, write_report


@pytest.fixture
def no_scene(monkeypatch):
    """The 3-D export is tested elsewhere and takes seconds."""
    page = '<html><head><script>window.__VISER_EMBED_DATA__="AAAA";</script></head></html>'
    monkeypatch.setattr(_sections.view, "export_scene", lambda record, frames: page)


def test_empty_page_says_what_is_absent(tmp_path):
    text = write_report(tmp_path / "report.html").read_text(encoding="utf-8")
    for words in ("no recording, interaction or rollout", "No interaction was given", "No rollout was given"):
        assert words in text
    assert "does not say whether it was measured or simulated" in text


@pytest.mark.usefixtures("no_scene")
def test_recording_alone(tmp_path):
    text = write_report(tmp_path / "a" / "report.html", session=make_recording()).read_text(encoding="utf-8")
    assert "No interaction has been estimated yet" in text
    assert "no person was measured" in text
    assert "trial00" in text


@pytest.mark.usefixtures("no_scene")
def test_rollout_alone(tmp_path):
    rollout = make_rollout("bump", failed=True)
    text = write_report(tmp_path / "report.html", rollouts=(rollout,)).read_text(encoding="utf-8")
    assert "Not solved: 3 simulation steps" in text
    assert "1.500" in text
    assert "maximum number of pivots" in text
    assert "so the measured forces are not shown" in text


@pytest.mark.usefixtures("no_scene")
def test_text_from_records_is_escaped(tmp_path):
    session = Session(name="<b>x</b>", subject="", recordings=(make_recording('"><script>alert(1)</script>'),))
    text = write_report(tmp_path / "report.html", session=session, metrics={"<i>": "&"}).read_text(encoding="utf-8")
    assert "<b>x</b>" not in text
    assert "<script>alert" not in text
    assert "&lt;i&gt;" in text


def test_nothing_is_left_behind_when_it_fails(tmp_path, monkeypatch):
    def broken(*_arguments):
        raise OSError("disk full")

    target = tmp_path / "report.html"
    target.write_text("before")
    monkeypatch.setattr("os.replace", broken)
    with pytest.raises(FileError, match="disk full"):
        write_report(target)
    assert target.read_text() == "before"
    assert [item.name for item in tmp_path.iterdir()] == ["report.html"]


def test_the_same_viewer_is_stored_once():
    first, second = (f'<a>__VISER_EMBED_DATA__="{data}"</a></script>' for data in ("one", "two"))
    frame, script = report_package._page.player(["x", "<y>"], [first, second])
    assert script.count("__VISER_EMBED_DATA__") == 1
    assert "one" in script
    assert "two" in script
    assert "&lt;y&gt;" in frame
    assert script.count("</script>") == 1, "text inside must not end the script element"
    with pytest.raises(ValueError, match="__VISER_EMBED_DATA__"):
        report_package._page.player(["x"], ["<html></html>"])


def test_the_best_accepted_and_the_most_excited_negative_event_are_shown():
    accepted, negative = _estimates.representative(make_interaction(make_recording()))
    assert accepted is not None
    assert negative == (1, "PIP")


@pytest.mark.usefixtures("no_scene")
def test_a_ball_joint_is_left_out_of_the_plots_and_named(tmp_path):
    interaction = with_ball_joint(make_interaction(make_recording()))
    text = write_report(tmp_path / "report.html", interactions=(interaction,)).read_text(encoding="utf-8")
    assert "Left out: ankle_x, ankle_y, ankle_z." in text
    assert "Left out: ankle." in text
    assert "knee (deg)" in text
    assert "rail (mm)" in text
    assert "ankle (deg)" not in text
    chosen, _ = _estimates.representative(interaction)
    assert chosen is not None
    assert chosen[1] in ("knee", "rail")


def test_a_session_without_any_pose_still_gets_a_page(tmp_path):
    recording = make_recording()
    interaction = without_poses(with_ball_joint(make_interaction(recording)))
    recording = eqx.tree_at(
        lambda item: (item.q, item.marker_residual, item.valid),
        recording,
        (
            np.full_like(recording.q, np.nan),
            np.full_like(recording.marker_residual, np.nan),
            np.zeros_like(recording.valid),
        ),
    )
    rollout = without_poses(make_rollout("flat", bump=False))
    path = write_report(tmp_path / "report.html", session=recording, interactions=(interaction,), rollouts=(rollout,))
    text = path.read_text(encoding="utf-8")
    for words in ("no frame of measured (trial00), flat has a pose", "There is no contact event with an estimate",
                  "there is no path to show", "no markers"):  # fmt: skip
        assert words in text


@pytest.mark.usefixtures("no_scene")
def test_what_the_numbers_cover_is_said(tmp_path):
    recording = make_recording()
    interaction = make_interaction(recording)
    metrics = {"estimate": {"wrist": {"true_compliance": 0.2345}, "MP": {"compliance": 1.0}}}
    session = Session(name="two", subject="nobody", recordings=(recording, make_recording("trial01", seed=8)))
    path = write_report(tmp_path / "report.html", session=session, interactions=(interaction,), metrics=metrics)
    text = path.read_text(encoding="utf-8")
    for words in ("largest contact force, all 2 trials", "median marker residual, all 2 recordings", "was estimated",
                  "biased: inertia, damping and planned deceleration; see the caution", "truth (virtual subject)",
                  "0.234", "not stated", "Kry and Pai 2006"):  # fmt: skip
        assert words in text
    plain = write_report(tmp_path / "plain.html", interactions=(interaction,)).read_text(encoding="utf-8")
    assert "virtual subject" not in plain


class Gone(Executor):
    """A process that is no longer there when its results are wanted."""

    def submit(self, fn, /, *args, **kwargs):
        future = Future()
        future.set_exception(BrokenExecutor("killed"))
        return future


@pytest.mark.usefixtures("no_scene")
@pytest.mark.parametrize("executor", [ThreadPoolExecutor(1), Gone()])
def test_a_page_drawn_elsewhere_is_the_same(tmp_path, executor):
    recording = make_recording()
    interaction, rollout = make_interaction(recording), make_rollout("flat", bump=False)
    given = {"session": recording, "interactions": (interaction,), "rollouts": (rollout,)}
    expected = write_report(tmp_path / "report.html", **given).read_text(encoding="utf-8")
    report = Report(executor)
    report.measured(recording, (interaction,))
    report.transferred(rollout)
    assert report.write(tmp_path / "other.html").read_text(encoding="utf-8") == expected


@pytest.mark.usefixtures("no_scene")
def test_sensitivity_is_shown_where_the_recordings_are_at_hand(tmp_path):
    recording = make_recording()
    interaction = make_interaction(recording)
    session = Session(name="one", subject="nobody", recordings=(recording,))
    text = write_report(tmp_path / "a.html", session=session, interactions=(interaction,)).read_text(encoding="utf-8")
    assert 'aria-label="compliance of every joint against the length of the windows"' in text
    events, joints = np.asarray(interaction.per_event.status).shape
    lines = re.findall(rf"^(?:.*<pre>)?{recording.name} +\d+\.\d+ s  \w+: ", text, flags=re.MULTILINE)
    assert len(lines) == events * joints
    alone = write_report(tmp_path / "b.html", interactions=(interaction,)).read_text(encoding="utf-8")
    assert "so they were not repeated" in alone
    moved = eqx.tree_at(lambda item: item.events.onset, recording, np.asarray(recording.events.onset) + 0.01)
    session = Session(name="other", subject="nobody", recordings=(moved,))
    other = write_report(tmp_path / "c.html", session=session, interactions=(interaction,)).read_text(encoding="utf-8")
    assert "so they were not repeated" in other


@pytest.mark.usefixtures("no_scene")
def test_objects_get_a_section_of_their_own(tmp_path):
    flat, rollout = make_rollout("flat", bump=False), make_object_rollout()
    text = write_report(tmp_path / "a.html", rollouts=(flat, rollout)).read_text(encoding="utf-8")
    section = text[text.index('<section id="objects">') : text.index('<section id="rollouts">')]
    rows = re.findall(r"<tr>(<td.*?)</tr>", section)
    cells = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in rows]
    # Slid by 20 mm, then turned about its edge: by 8 + 20 mm, at pi rad/s on a radius of 21.5 mm.
    assert cells == [
        ["box", "objects", "0.491", "0.491", "48.0", "1.5", "90", "68", "0.30", "3.000"],
        ["ball", "objects", "0.0981", "0.0981", "179.7", "0.0", "a ball", "60", "not touched", "0.000"],
    ]
    assert section.count("<svg") == 2  # the objects, and how the fingertip holds them
    assert "friction over μ times the normal force" in section
    assert 'aria-label="place, tilt, speed and forces of box, ball over time"' in section
    for words in ("objects have inertia", "Objects are dashed where they began", "Forces of surfaces and other objects",
                  "Forces on objects are further below", '<i style="background:#7A5195"></i>box</li>'):  # fmt: skip
        assert words in text
    trusted = text[text.index('<section id="rollouts">') :]
    # The deepest gap is the pad's, as on the plate alone, not that of the box.
    first, second = (
        re.findall(r"<td[^>]*>([^<]*)</td>", row)[5:] for row in re.findall(r"<tr>(<td.*?)</tr>", trusted)[:2]
    )
    assert first[0] == second[0]
    alone = write_report(tmp_path / "b.html", rollouts=(flat,)).read_text(encoding="utf-8")
    for words in ('id="objects"', "inertia and are rigid", "dashed where they began", "other objects"):
        assert words not in alone


@pytest.mark.usefixtures("no_scene")
def test_many_objects_are_drawn_few_at_a_time(tmp_path):
    rollout, count = make_object_rollout(), 14
    names = tuple(f"ball{k}" for k in range(count))
    columns = {
        name: np.repeat(getattr(rollout, name)[:, 1:], count, axis=1)
        for name in ("object_position", "object_quaternion", "object_velocity", "object_angular_velocity")
    }
    many = dataclasses.replace(rollout, object_names=names, **columns)
    text = write_report(tmp_path / "many.html", rollouts=(many,)).read_text(encoding="utf-8")
    section = text[text.index('<section id="objects">') : text.index('<section id="rollouts">')]
    assert section.count("<svg") == 4 + 1  # twelve, three at a time; and the grip
    assert "Not drawn: ball12, ball13." in section
    assert section.count("<tr><td") == count


def test_fit_alone(tmp_path):
    """Compliances beside the paper's, the refused joint with its reason, figures with ids of their own."""
    page = write_report(tmp_path / "report.html", fits=(make_fit("<i>"), make_fit("two"))).read_text(encoding="utf-8")
    assert "<i>" not in page.replace("<i><", "")
    assert "no person was measured" in page
    assert f"MP: refused, since {REASON}." in page
    assert "wrist 0.25, MP refused rad/Nm" in page
    assert "1 of 2" in page
    assert "0.227\N{NO-BREAK SPACE}to\N{NO-BREAK SPACE}0.276" in page
    for number in (0, 1):
        for figure in ("compliance", "response", "spectrum", "reference"):
            assert f'id="fit-{number}-{figure}-' in page
    assert "That variance was multiplied by 1.20" in page
    assert "compliance wrist" in page


def test_a_fit_has_no_sections_of_others(tmp_path):
    """Nobody asked for what a fit has no part in."""
    text = write_report(tmp_path / "report.html", fits=(make_fit(),)).read_text(encoding="utf-8")
    assert "was given" not in text
    assert "Nothing to show" not in text
    assert "Fit of the whole session" in text
