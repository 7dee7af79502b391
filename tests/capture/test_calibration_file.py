"""The tables of a session file about the model: what they change, and what they refuse in one line."""

import numpy as np
import pytest

from icjax.capture import read_session
from icjax.capture._posture import prior_rows
from icjax.files import FileError
from icjax.model import human_hand, index_finger

MARKERS = ("HA1", "HA2", "HA3", "PP1", "MP1", "DP1", "nail")
TEXT = """
[model]
builtin = "index_finger"
part = "hand"
locked = ["wrist"]
root = "free"
[sites]
nail = { body = "distal", position = [0.01, 0.0, 0.01] }
[posture]
noise = 0.002
limits = 0.1
sd = 0.5
[posture.angles]
MP = { mean = 0.3, sd = 0.2 }
[posture.couplings]
DIP = { of = "PIP", ratio = 0.667, sd = 0.1 }
[calibration]
trials = ["rom"]
size = 0.1
axes = false
[markers]
""" + "\n".join(f'{name} = "{name}"' for name in MARKERS)
TRIAL = '\n[[trial]]\nname = "rom"\nfile = "rom.trc"\nrole = "range_of_motion"\n'


@pytest.fixture
def session(tmp_path):
    def read(old="", new=""):
        (tmp_path / "rom.trc").write_text("not read here")
        (tmp_path / "session.toml").write_text(TEXT.replace(old, new, 1) + TRIAL)
        return read_session(tmp_path / "session.toml")

    return read


def test_the_model_is_cut_locked_and_given_its_site(session):
    spec = session()
    assert spec.model.body_names == ("world", "hand", "proximal", "middle", "distal")
    assert spec.model.joint_names == ("root", "MP", "PIP", "DIP")
    np.testing.assert_array_equal(spec.model.site_position[spec.model.site("nail")], [0.01, 0.0, 0.01])
    assert (spec.calibration.size, spec.calibration.lengths, spec.calibration.axes) == (0.1, 0.05, None)
    assert spec.calibration.trials == ("rom",)


def test_beliefs_about_the_posture_are_rows_in_metres(session):
    spec = session()
    q = np.array(spec.model.zero)
    q[7:] = [0.5, 0.6, 2.0]  # DIP is limited to 1.4
    r, J = prior_rows(spec.model, spec.posture, q)
    expected = [(0.5 - 0.3) / 0.2, 0.6 / 0.5, (2.0 - 0.667 * 0.6) / 0.1, 0.0, 0.0, (2.0 - 1.4) / 0.1]
    np.testing.assert_allclose(r, 0.002 * np.array(expected), atol=1e-15)
    slope = [[1 / 0.2, 0, 0], [0, 1 / 0.5, 0], [0, -0.667 / 0.1, 1 / 0.1], [0, 0, 0], [0, 0, 0], [0, 0, 1 / 0.1]]
    np.testing.assert_allclose(np.asarray(J)[:, 6:], 0.002 * np.array(slope), atol=1e-15)
    assert np.all(np.asarray(J)[:, :6] == 0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('part = "hand"', 'part = "foot"', r"\[model\] unknown body 'foot'"),
        ('locked = ["wrist"]', 'locked = ["elbow"]', r"\[model\] unknown joint 'elbow'"),
        ('body = "distal"', 'body = "toe"', r"\[sites\] unknown body 'toe'"),
        ("position = [0.01, 0.0, 0.01]", "position = [0.01]", r"\[sites\] nail key 'position' must be three numbers"),
        ('trials = ["rom"]', 'trials = ["static"]', r"\[calibration\] key 'trials' names 'static'"),
        ('trials = ["rom"]', "trials = []", r"\[calibration\] key 'trials' names no trial"),
        ("size = 0.1", "size = true", r"\[calibration\] key 'size' must be a standard deviation between 0 and 1, or"),
        ("size = 0.1", "lengths = false\nplacement = false", "calibrates nothing"),
        ("MP = {", "elbow = {", r"\[posture\] unknown joint 'elbow'"),
        ('of = "PIP"', 'of = "root"', r"\[posture\] joint 'root' is neither a hinge nor a slide"),
        ("noise = 0.002", "", r"\[posture\] needs the key 'noise'"),
    ],
)
def test_mistakes_are_named(session, old, new, message):
    with pytest.raises(FileError, match=message):
        session(old, new)


def test_a_session_without_the_tables_is_as_before(tmp_path):
    (tmp_path / "rom.trc").write_text("not read here")
    text = '[model]\nbuiltin = "index_finger"\n[markers]\nHA1 = "HA1"\n' + TRIAL
    (tmp_path / "session.toml").write_text(text)
    spec = read_session(tmp_path / "session.toml")
    assert (spec.calibration, spec.posture) == (None, None)
    assert spec.model.joint_names == index_finger().joint_names


HAND = '[model]\nbuiltin = "human_hand"\nhand_length = 0.2\nhand_breadth = 0.09\nside = "left"\n'


def test_the_shipped_hand_is_named_with_its_measures_and_side(tmp_path):
    (tmp_path / "rom.trc").write_text("not read here")
    (tmp_path / "session.toml").write_text(HAND + '[markers]\nM1 = "index_distal2"\n' + TRIAL)
    model = read_session(tmp_path / "session.toml").model
    expected = human_hand(0.2, 0.09, "left")
    np.testing.assert_array_equal(model.site_position, expected.site_position)
    np.testing.assert_array_equal(model.compliance, expected.compliance)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"left"', '"both"', r"\[model\] key 'side' must be one of 'right', 'left'"),
        ("0.09", "0.9", r"\[model\] breadth is 0.9 m; it must lie between 0.3 and 0.6 of the length, 0.2 m"),
        ("human_hand", "index_finger", r"\[model\] key 'hand_breadth' belongs to the builtin model 'human_hand'"),
        ('hand_breadth = 0.09\nside = "left"', "", "unknown site 'thumb9'"),
    ],
)
def test_mistakes_about_the_hand_are_named(tmp_path, old, new, message):
    (tmp_path / "rom.trc").write_text("not read here")
    text = HAND.replace(old, new, 1) + '[markers]\nM1 = "thumb9"\n' + TRIAL
    (tmp_path / "session.toml").write_text(text)
    with pytest.raises(FileError, match=message):
        read_session(tmp_path / "session.toml")
