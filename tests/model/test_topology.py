"""A model whose topology contradicts itself cannot be built."""

import dataclasses

import mujoco
import pytest

from icjax.model import index_finger, load_model

MODEL = index_finger()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"body_parents": (0, 5, 1, 2, 3, 4)}, "the parent of body 1 is 5"),
        ({"body_parents": (0, 0, 1, 2, 3)}, "body_parents has 5 entries, not 6"),
        ({"joint_types": ("banana", *MODEL.joint_types[1:])}, "'banana' of joint"),
        ({"joint_bodies": (77, *MODEL.joint_bodies[1:])}, "is on body 77 of 6"),
        ({"site_bodies": MODEL.site_bodies[:-1]}, "site_bodies has 15 entries, not 16"),
        ({"pad_bodies": (9,)}, "is on body 9 of 6"),
    ],
)
def test_contradictions_are_named(fields, message):
    with pytest.raises(ValueError, match=f"model 'index_finger'.*{message}"):
        dataclasses.replace(MODEL, **fields)


def test_gravity_that_is_switched_off_is_none(tmp_path):
    body = '<worldbody><body><joint type="hinge"/><geom size="0.1" mass="1"/></body></worldbody>'
    for flag, expected in (("", -9.81), ('<option><flag gravity="disable"/></option>', 0.0)):
        (tmp_path / "model.xml").write_text(f"<mujoco>{flag}{body}</mujoco>")
        assert load_model(tmp_path / "model.xml").gravity[2] == expected
    assert mujoco.mjtDisableBit.mjDSBL_GRAVITY == 128
