"""`icjax design` and its file: what is read, what is printed, and one clear line for what is wrong."""

import json
import math

import numpy as np
import pytest

from icjax.cli import main
from icjax.files import FileError
from icjax.fit import design, design_text, finger_candidates, finger_normal, read_design
from icjax.fit._expected_contact import touch_of
from icjax.model import index_finger

MODEL = """<mujoco model="two bars"><worldbody>
  <body name="upper"><joint name="shoulder" axis="0 1 0" stiffness="4"/>
    <inertial pos="0.1 0 0" mass="0.2" diaginertia="1e-5 7e-4 7e-4"/>
    <body name="lower" pos="0.2 0 0"><joint name="elbow" axis="0 1 0" stiffness="2"/>
      <inertial pos="0.1 0 0" mass="0.1" diaginertia="1e-5 4e-4 4e-4"/>
      <geom name="tip" class="pad" type="sphere" pos="0.2 0 0" size="0.01" mass="0" user="0.001"/></body></body>
</worldbody><default><default class="pad"/></default></mujoco>"""

TEXT = """
catch_trials = 3
[model]
file = "bars.xml"
[compliance]
elbow = 0.8
[instruments]
rate = 250
angle_sd = 0.002
offset_sd = 0.01
[[probe]]
name = "down"
angles = { shoulder = 20, elbow = 30 }
contact = "tip"
normal = [0, 0, 2]
speed = 0.15
[[probe]]
name = "along"
angles = { shoulder = 20, elbow = 5 }
contact = "lower"
point = [0.2, 0, 0]
normal = [-0.87, 0, 0.5]
contacts = 6
depth = 0.01
"""


@pytest.fixture
def plan(tmp_path):
    (tmp_path / "bars.xml").write_text(MODEL)
    path = tmp_path / "plan.toml"
    path.write_text(TEXT)
    return path


def test_what_is_read(plan):
    planned = read_design(plan)
    assert planned.catch_trials == 3
    assert planned.noise.rate == 250
    assert planned.noise.cutoff == 20
    np.testing.assert_allclose(planned.model.compliance, [0.25, 0.8])
    down, along = planned.probes
    np.testing.assert_allclose(down.q, np.radians([20, 30]))
    assert (down.normal, down.speed, down.contacts, down.depth) == ((0, 0, 1), 0.15, 12, math.inf)
    assert (along.contact, along.point, along.contacts, along.depth) == ("lower", (0.2, 0, 0), 6, 0.01)


def test_a_table_and_a_file(plan, tmp_path, capsys):
    out = tmp_path / "deep" / "design.json"
    assert main(["design", str(plan), "--out", str(out), "--best", "2"]) == 0
    printed = capsys.readouterr().out
    assert "3 catch trials" in printed
    assert "best 2 together, 12 contacts in all" in printed
    found = json.loads(out.read_text())
    assert found["joints"] == ["shoulder", "elbow"]
    widths = {row["probe"]: row["width"] for row in found["probes"]}
    assert set(widths) == {"down", "along"}
    assert max(found["probes"][0]["width"]) <= max(found["probes"][1]["width"])
    for row in found["probes"]:
        assert row["refused"] == [
            name for name, width in zip(found["joints"], row["width"], strict=True) if width > found["widest"]
        ]


def test_a_plan_without_catch_trials(plan, capsys):
    """From the file, and in its place from the command line."""
    assert main(["design", str(plan), "--catch-trials", "0"]) == 0
    printed = capsys.readouterr().out
    assert "no catch trials; *" in printed
    assert "where the movement before contact leaves" in printed
    plan.write_text(TEXT.replace("catch_trials = 3", "catch_trials = 0"))
    assert read_design(plan).catch_trials == 0
    assert main(["design", str(plan)]) == 0
    assert capsys.readouterr().out == printed


def test_the_table_is_that_of_python(plan, capsys):
    assert main(["design", str(plan), "--best", "2"]) == 0
    planned = read_design(plan)
    made = design(planned.model, planned.probes, planned.catch_trials, noise=planned.noise)
    assert capsys.readouterr().out == design_text(made, 2) + "\n"
    assert design_text(made, 9) == design_text(made, 2)
    with pytest.raises(ValueError, match="best = 0"):
        design_text(made, 0)


def test_two_contacts_are_too_few_whatever_their_widths(plan, capsys):
    """The cure is a third contact, no other one; no width is without its star."""
    assert main(["design", str(plan), "--contacts", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "* above 4 or from fewer than 3 contacts: no number" in lines[0]
    for line in lines[2:4]:
        assert all(cell.endswith("*") for cell in line.split()[-2:])
    assert "a session needs at least 3 contacts; every probe has fewer" in lines


def test_many_that_are_missing_are_told_by_joint():
    """One line for each joint, of the probe that comes nearest to a number."""
    model = index_finger(0.19, "fixed")
    made = design(model, finger_candidates(model)[:4], catch_trials=0)
    assert np.sum(made.widths > 4.0) > 12
    lines = [line for line in design_text(made, 1).splitlines() if " is loaded by " in line]
    assert len(lines) == 4
    for j, line in enumerate(lines):
        assert line.startswith(f"{made.probes[int(np.argmin(made.widths[:, j]))].name}: {made.joints[j]} is loaded by")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('contact = "tip"', 'contact = "thumb"', "'thumb' is no pad or body of the model (tip, upper, lower)"),
        ("speed = 0.15", "speed = 0", "probe 'down': speed = 0.0: must be above zero"),
        ("normal = [0, 0, 2]", "normal = [0, 0, 0]", "normal = (0.0, 0.0, 0.0): must be a direction"),
        ("elbow = 30", "knee = 30", "unknown key 'knee'"),
        ("point = [0.2, 0, 0]", "", "is a body; say which point of it touches"),
        ("catch_trials = 3", "catch_trials = -1", "key 'catch_trials' must be a whole number of at least 0"),
        ("elbow = 0.8", "ankle = 0.8", "unknown key 'ankle'"),
        ('file = "bars.xml"', 'file = "none.xml"', "none.xml"),
        ("angle_sd = 0.002", "", "angle_sd and offset_sd belong together"),
        ('name = "along"', 'name = "down"', "two are named 'down'"),
        ("[[probe]]", "[[prob]]", "needs at least one [[probe]] table"),
    ],
)
def test_one_clear_line(plan, capsys, old, new, said):
    plan.write_text(TEXT.replace(old, new))
    assert main(["design", str(plan)]) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("icjax: ")]
    assert len(error) == 1
    assert said in error[0]


def test_no_compliant_joint(tmp_path, capsys):
    """A body that floats freely has none."""
    (tmp_path / "ball.xml").write_text(
        """<mujoco model="ball"><worldbody><body name="ball"><freejoint/><geom type="sphere" size="0.03"/></body>
        </worldbody></mujoco>"""
    )
    path = tmp_path / "plan.toml"
    path.write_text('[model]\nfile = "ball.xml"\n[[probe]]\ncontact = "ball"\npoint = [0, 0, 0]\n')
    assert main(["design", str(path)]) == 2
    assert "icjax: model 'ball' has no compliant joint" in capsys.readouterr().err


def test_a_file_or_a_model(plan, capsys):
    assert main(["design", str(plan), "--model", "index_finger"]) == 2
    assert "give either PLAN.TOML or --model" in capsys.readouterr().err
    assert main(["design", str(plan), "--best", "0"]) == 2
    assert "--best 0" in capsys.readouterr().err


def test_a_file_error_names_the_file(plan):
    plan.write_text(TEXT.replace("speed = 0.15", 'speed = "fast"'))
    with pytest.raises(FileError, match="plan.toml"):
        read_design(plan)


def test_candidates_touch_with_the_palmar_side():
    """The normal leans from the pad (0 degrees) to the tip (90) and never to the nail; names are all different."""
    model = index_finger(0.19, "fixed")
    probes = finger_candidates(model)
    assert len({probe.name for probe in probes}) == len(probes) == 13
    degrees = (3, 18, 27, 20)
    pitch = np.radians(sum(degrees))
    palmar, forward = np.array([np.sin(pitch), 0, np.cos(pitch)]), np.array([np.cos(pitch), 0, -np.sin(pitch)])
    np.testing.assert_allclose(finger_normal(degrees, 0.0), palmar)
    np.testing.assert_allclose(finger_normal(degrees, 90.0), -forward, atol=1e-12)
    for probe in probes:
        assert touch_of(model, (0, 1, 2, 3), probe).stiffness == pytest.approx(750.0)
