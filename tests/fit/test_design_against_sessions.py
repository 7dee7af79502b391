"""What a plan expects is what a recorded session then shows: MuJoCo subject, skin, tremor, noisy instruments."""

import dataclasses
import json

import numpy as np
import pytest
from scipy.optimize import root_scalar

from icjax.capture import capture, read_session
from icjax.fit import Probe, design, session_problem
from icjax.inference import jacobian, laplace
from icjax.laboratory import Subject, Surface, record
from icjax.laboratory._movement import reach
from icjax.model import index_finger

TOLERANCE = 1.5
"""Factor of the standard deviation of log C; complete fits were within 0.65 to 1.36 (experiments, design.json)."""

FRICTION = 0.6
COMPLIANCE = (0.25, 0.70, 0.45, 1.10)


def planned(path) -> list[Probe]:
    """The laboratory's touches as an experimenter would state them."""
    subject, surface = Subject(compliance=COMPLIANCE), Surface(friction=FRICTION)
    probes = []
    for trial, touches in enumerate(json.loads(path.read_text())["touches"]):
        for number, touch in enumerate(touches):
            way = touch["hover"] + touch["depth"]
            part = touch["hover"] / way
            u = root_scalar(lambda u, part=part: 10 * u**3 - 15 * u**4 + 6 * u**5 - part, bracket=(0.0, 1.0)).root
            speed = 30 * u**2 * (1 - u) ** 2 * way / touch["descent"]
            angles = reach(subject, surface, touch["x_from"] + touch["lead"] * touch["depth"] / way, 0.0)
            slide = (-touch["lead"] / way * speed, 0.0, 0.0)
            probes.append(
                Probe(
                    (0, 0, 0, 1, 0, 0, 0, *angles),
                    "fingertip",
                    speed=speed,
                    slide=slide,
                    depth=touch["depth"],
                    hover=touch["hover"],
                    friction=FRICTION,
                    contacts=1,
                    name=f"{trial} {number}",
                )  # fmt: skip
            )
    return probes


def recorded(folder, catch):
    """The problem of a recorded session, standard deviations of log C in it at the subject's compliance, the model with
    that compliance, and what an experimenter would have planned."""
    paths = record(folder, seed=21, trials=2, contacts=3, catch=catch, compliance=COMPLIANCE, friction=FRICTION)
    made = session_problem(capture(read_session(paths.session)))
    parameters = made.problem.parameters
    place = parameters.slices["compliance"]
    x = np.array(parameters.start)
    x[place] = np.log(COMPLIANCE)
    found = laplace(np.asarray(jacobian(made.problem.data, x)), np.asarray(jacobian(parameters.prior, x)))
    probes = planned(folder / "truth" / "subject.json")
    assert len(made.windows) == len(probes)
    model = index_finger()
    own = np.array(model.compliance)
    own[-4:] = COMPLIANCE
    return made, np.asarray(found.sd)[place], dataclasses.replace(model, compliance=own), probes


@pytest.mark.slow
def test_expected_and_found_information(tmp_path):
    """Standard deviations of log C at the subject's compliance: of the recording's own problem, and of the plan."""
    made, sd, model, probes = recorded(tmp_path, catch=2)
    plan = design(model, probes)
    ratio = sd / plan.expected(range(len(probes))).sd
    assert np.all((ratio > 1 / TOLERANCE) & (ratio < TOLERANCE)), ratio
    peaks = [np.abs(made.motions[w.trial].torque[w.onset : w.last + 1]).max(axis=0) for w in made.windows]
    np.testing.assert_allclose(np.median(peaks / plan.torque, axis=0)[:2], 1.0, atol=0.3)


@pytest.mark.slow
def test_expected_and_found_without_catch_trials(tmp_path):
    """Standard deviations, with the movement that the session's fit learns; with a typical one, which this subject's
    is not (smoother by a factor of two), within a factor of two."""
    made, sd, model, probes = recorded(tmp_path, catch=0)
    assert made.expected.movement is not None
    for movement, tolerance in ((None, 2.0), (made.expected.movement, TOLERANCE)):
        plan = design(model, probes, catch_trials=0, planned_movement=movement)
        ratio = sd / plan.expected(range(len(probes))).sd
        assert np.all((ratio > 1 / tolerance) & (ratio < tolerance)), ratio
