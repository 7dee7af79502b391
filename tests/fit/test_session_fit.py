"""A recorded session to compliances with intervals, judged by the laboratory's truth."""

import dataclasses

import jax
import numpy as np
import pytest

from icjax.fit import FitOptions, session_problem

TRUTH = np.array([0.25, 0.70, 0.45, 1.10])


@pytest.mark.slow
def test_wrist_and_knuckle_are_found(fit):
    """Within 15 % from 12 contacts with catch trials; at most one interval misses its truth."""
    assert not fit.warnings
    for joint, truth in list(zip(fit.joints, TRUTH, strict=True))[:2]:
        assert not joint.refused
        assert joint.compliance == pytest.approx(truth, rel=0.15)
    inside = [j.lower <= c <= j.upper for j, c in zip(fit.joints, TRUTH, strict=True) if not j.refused]
    assert sum(inside) >= len(inside) - 1
    assert 0.3 < fit.chi2 < 1.5


def test_bad_sessions(session):
    catches = tuple(item for item in session.recordings if item.role == "catch")
    with pytest.raises(ValueError, match="no recording with the role 'trial'"):
        session_problem(dataclasses.replace(session, recordings=catches))
    first = session.trials()[0]
    dumb = dataclasses.replace(
        first,
        contact_names=(),
        contact_bodies=(),
        contact_force=first.contact_force[:, :0],
        contact_point=first.contact_point[:, :0],
        contact_moment=first.contact_moment[:, :0],
        touching=first.touching[:, :0],
        contact_force_sd=None,
        contact_point_sd=None,
    )
    with pytest.raises(ValueError, match="no contact forces"):
        session_problem(dataclasses.replace(session, recordings=(dumb,)))
    slower = dataclasses.replace(catches[0], time=np.asarray(catches[0].time) * 2.0)
    with pytest.raises(ValueError, match="frames a second"):
        session_problem(dataclasses.replace(session, recordings=(first, slower)))
    few = jax.tree.map(lambda x: x[:1], first.events)
    with pytest.raises(ValueError, match="1 contacts"):
        session_problem(dataclasses.replace(session, recordings=(dataclasses.replace(first, events=few), catches[0])))


@pytest.mark.parametrize(
    ("field", "value"), [("after", 2.0), ("before", 0.0), ("widest", 1.0), ("spacing", float("nan"))]
)
def test_bad_options(field, value):
    with pytest.raises(ValueError, match=field):
        FitOptions(**{field: value})


def test_nothing_free_to_learn_from(session):
    """Without catch trials and without free movement beside the contacts."""
    first = session.trials()[0]
    time, events = np.asarray(first.time), first.events
    busy = np.ones(len(time), bool)
    for onset in np.asarray(events.onset):
        busy[(time > onset - 0.2) & (time < onset)] = False
    touching = np.asarray(first.touching) | busy[:, None]
    held = dataclasses.replace(first, touching=touching, contact_point=np.nan_to_num(first.contact_point))
    with pytest.raises(
        ValueError, match=r"without a catch trial \('trial00'\): 0 stretches of 0.3\d s without contact"
    ):
        session_problem(dataclasses.replace(session, recordings=(held,)))
