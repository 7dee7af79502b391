"""Resynthesis of strokes over a bump that an independent dynamic simulation recorded.

Input: true compliance and true reference (the same run without contact), the forearm's translation from its three
markers, the surfaces and friction that the session states, a pad of 750 N/m. Judged: contact force on the finger and
the path of the pad's centre. The hand there has inertia and damping, ours is quasi-static, so the first 100 ms after
each touch must differ.

Normal force NRMSE = RMS error of the force's z component over the contact samples of both trials, over the RMS of the
true one in the same samples. A contact lasts while the true normal force exceeds 20 mN. The finger bounces: judged as
asked, after the first 100 ms of *each* contact, a bounce starts a contact; with contacts less than 50 ms apart taken
as one the late figure is a little worse, and both are stated. Dividing by the range, as is also usual, gives numbers
about 2.5 times smaller.
"""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.signal import butter, filtfilt

from icjax.geometry import Ellipsoid, Plane
from icjax.model import load_model, pad_positions
from icjax.synthesis import Scene, Surface, Target, rollout

PAD = 1.0 / 750.0
BONE_TO_PAD = 1.0 / 1200.0  # m/N, between bone and sphere in the recording's model; the rest of the pad is the skin

pytestmark = pytest.mark.slow


def hand(description):
    """The session's kinematic model on a forearm that slides in x, y and z."""
    inertial = '<inertial pos="0 0 0" mass="0.01" diaginertia="1e-5 1e-5 1e-5"/>'
    pad = description["pad"]
    centre = " ".join(map(str, pad["centre"]))
    chain = f'<geom name="pad" type="sphere" size="{pad["radius"]}" pos="{centre}" mass="0.01" user="{PAD}"/>'
    for segment in reversed(description["segments"]):
        offset = " ".join(map(str, segment["offset"]))
        joint = f'<joint name="{segment["joint"]}" axis="0 1 0"/>'
        chain = f'<body name="{segment["name"]}" pos="{offset}">{joint}{inertial}{chain}</body>'
    slides = "".join(
        f'<joint name="{n}" type="slide" axis="{a}"/>' for n, a in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    )
    return load_model(f"""
        <mujoco model="subject"><size nuser_geom="1"/><worldbody>
        <body name="FA">{slides}{inertial}{chain}</body></worldbody></mujoco>""")


def forearm_path(path, nominal):
    """Translation of the forearm: mean of its markers minus their nominal places, gaps bridged, 20 Hz zero-phase."""
    import ezc3d

    file = ezc3d.c3d(str(path))
    labels = file["parameters"]["POINT"]["LABELS"]["value"]
    points = file["data"]["points"][:3].transpose(2, 1, 0) / 1000.0
    frame = np.arange(len(points))
    path = np.zeros((len(points), 3))
    for index, place in enumerate(nominal, 1):
        marker = points[:, labels.index(f"FA{index}")]
        seen = np.isfinite(marker).all(axis=1) & (np.abs(marker).sum(axis=1) > 0)
        path += np.stack([np.interp(frame, frame[seen], marker[seen, k]) for k in range(3)], axis=1) - np.array(place)
    b, a = butter(2, 20.0 / 0.802 / (file["header"]["points"]["frame_rate"] / 2))
    return filtfilt(b, a, path / len(nominal), axis=0)


def contacts(normal_force, bounce=0.0, rate=500):
    """Boolean masks: all contact samples, and those later than 100 ms after their onset; bounces (s) end no contact."""
    edges = np.diff(np.concatenate([[0], (normal_force > 0.02).astype(int), [0]]))
    merged = []
    for start, end in zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True):
        if merged and start - merged[-1][1] < bounce * rate:
            merged[-1][1] = end
        else:
            merged.append([start, end])
    during, late = np.zeros(len(normal_force), bool), np.zeros(len(normal_force), bool)
    for start, end in merged:
        during[start:end] = True
        late[start + rate // 10 : end] = True
    return during, late, len(merged)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def resynthesis(shared_data):
    """For the surfaces "bump" and "flat": found and true force and pad path, contact masks; both trials in a row."""
    folder = shared_data / "virtual_sessions" / "bump"
    description = json.loads((folder / "hand_model.json").read_text())
    session = json.loads((folder / "session.json").read_text())
    model = hand(description)
    centres = jax.jit(jax.vmap(lambda q: pad_positions(model, q)[0]))
    result = {}
    for kind in ("bump", "flat"):
        rows = {name: [] for name in ("force", "true_force", "path", "true_path", "during", "late", "merged", "status")}
        for trial in session["trials"]:
            truth = np.load(folder / f"{trial['trial']}_truth.npz")
            surfaces = [Surface("plate", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), trial["friction"])]
            for bump in trial["bumps"] if kind == "bump" else ():
                radii = np.array([bump["r"], 0.035, bump["h"]])
                shape = Ellipsoid(np.array([bump["x"], 0.0, 0.0]), np.eye(3), radii)
                surfaces.append(Surface("bump", shape, trial["friction"]))
            root = forearm_path(folder / f"{trial['trial']}.c3d", description["markers"]["FA"])
            compliance = np.concatenate([np.zeros(3), truth["C"]])
            targets = Target(
                reference=jnp.asarray(np.concatenate([root, truth["theta_free"]], axis=1), float),
                compliance=jnp.tile(jnp.asarray(compliance), (len(root), 1)),
            )
            _, info = rollout(model, Scene(kind, tuple(surfaces), 4, 0.002), targets)
            force, true_force = np.asarray(info.contact_force).sum(axis=1), truth["f_contact"].astype(float)
            during, late, _ = contacts(true_force[:, 2])
            _, merged, count = contacts(true_force[:, 2], bounce=0.05)
            assert count == len(trial["contacts"])
            rows["force"].append(force)
            rows["true_force"].append(true_force)
            rows["path"].append(np.asarray(centres(info.q)) + BONE_TO_PAD * force)
            rows["true_path"].append(truth["pad"].astype(float))
            rows["during"].append(during)
            rows["late"].append(late)
            rows["merged"].append(merged)
            rows["status"].append(np.asarray(info.status))
        result[kind] = {name: np.concatenate(parts) for name, parts in rows.items()}
    return result


def nrmse(run, axis, samples):
    error = run["force"][run[samples], axis] - run["true_force"][run[samples], axis]
    return rms(error) / rms(run["true_force"][run[samples], axis])


def path_error(run, samples):
    return np.linalg.norm((run["path"] - run["true_path"])[run[samples]], axis=1)


def test_every_step_is_solved(resynthesis):
    assert np.all(resynthesis["bump"]["status"] == 0)


def test_normal_force(resynthesis):
    run = resynthesis["bump"]
    assert nrmse(run, 2, "during") <= 0.20  # measured 0.195
    assert nrmse(run, 2, "late") <= 0.10  # measured 0.093
    # Bounces within 50 ms taken as one contact: 0.101 measured. What remains is the damping of the recorded joints.
    assert nrmse(run, 2, "merged") <= 0.105


def test_fingertip_path(resynthesis):
    error = path_error(resynthesis["bump"], "during")
    assert rms(error) <= 0.5e-3  # measured 0.22 mm
    assert np.percentile(error, 95) <= 0.5e-3
    assert np.max(error) <= 1.5e-3  # measured 1.1 mm, in the first milliseconds of a touch


def test_tangential_force(resynthesis):
    assert nrmse(resynthesis["bump"], 0, "during") <= 0.30  # measured 0.26


def test_the_bump_matters(resynthesis):
    """Without it the normal force hardly changes, but the path and the tangential force do."""
    bump, flat = resynthesis["bump"], resynthesis["flat"]
    assert nrmse(flat, 2, "during") < 1.3 * nrmse(bump, 2, "during")
    assert nrmse(flat, 0, "during") > 1.4 * nrmse(bump, 0, "during")
    assert rms(path_error(flat, "during")) > 4 * rms(path_error(bump, "during"))
