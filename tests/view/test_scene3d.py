"""The exported 3-D page: bounded, self-contained, and no server is left behind."""

import threading

import equinox as eqx
import numpy as np
import pytest
from view.example_records import make_recording, make_rollout

from icjax.view import export_scene


def test_export_is_one_bounded_page_without_addresses_of_its_own(capsys):
    before = set(threading.enumerate())
    page = export_scene(make_rollout("bump"), frames=60)
    assert page.lstrip().lower().startswith("<!doctype html>")
    assert "__VISER_EMBED_DATA__" in page
    assert len(page) < 1.5e6
    assert capsys.readouterr().out == ""
    left = [thread for thread in set(threading.enumerate()) - before if not thread.daemon and thread.is_alive()]
    assert [thread.name for thread in left if "ThreadPool" not in thread.name] == []


def test_frames_without_a_pose_are_left_out():
    recording = make_recording()
    q = np.array(recording.q)
    q[:300] = np.nan
    half = eqx.tree_at(lambda item: item.q, recording, q)
    assert "__VISER_EMBED_DATA__" in export_scene(half, frames=5, markers=True)
    empty = eqx.tree_at(lambda item: item.q, recording, np.full_like(q, np.nan))
    with pytest.raises(ValueError, match="no frame has a pose"):
        export_scene(empty)
