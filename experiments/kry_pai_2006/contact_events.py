"""What figures 3 and 8 share: a simulated session, its estimates at contact, one event as a picture and as numbers."""

import json
import tempfile
from pathlib import Path

import numpy as np

from icjax.capture import capture, read_session
from icjax.estimation import EstimationOptions, estimate
from icjax.interaction import STATUS, Interaction
from icjax.laboratory import load_truth, record
from icjax.view import plot_contact_event, save

RESULTS = Path(__file__).resolve().parent.parent / "results" / "kry_pai_2006"
SIMULATED = "simulated by icjax.laboratory (MuJoCo subject with inertia and damping); no person was measured"


def interactions_of(seed: int, trials: int, contacts: int, options: EstimationOptions):
    """Record in the virtual laboratory, capture and estimate; also the compliance the simulated subject has."""
    with tempfile.TemporaryDirectory() as folder:
        paths = record(folder, seed=seed, trials=trials, contacts=contacts, catch=0)
        session = capture(read_session(paths.session))
        truth = load_truth(Path(folder) / "truth" / "trial00.npz")
    found = estimate(session, options)
    return found, dict(zip(found[0].per_event.joint_names, (float(value) for value in truth.C), strict=True))


def write(
    name: str,
    folder: Path,
    interactions: tuple[Interaction, ...],
    event: int,
    joint: str,
    caption: str,
    result: dict,
    margin: float,
) -> dict:
    """Save NAME.png and NAME.json of one event and joint; returns the numbers."""
    per_event = interactions[0].per_event
    column = per_event.joint_names.index(joint)
    own = next(item for item in interactions if item.name == per_event.recording[event])
    figure = plot_contact_event(own, event, joint, margin=margin)
    figure.supxlabel(caption, fontsize=7.5, color="#5B616B")
    figure.set_size_inches(6.6, 5.0)
    save(figure, folder / f"{name}.png")
    numbers = {
        "data": SIMULATED,
        **result,
        "event": {
            "trial": per_event.recording[event],
            "onset s": float(per_event.onset[event]),
            "joint": joint,
            "status": STATUS[int(per_event.status[event, column])],
            "compliance rad/Nm": float(per_event.compliance[event, column]),
            "standard error rad/Nm": float(per_event.standard_error[event, column]),
            "R2 angle before, angle after, torque": [float(r) for r in per_event.r_squared[event, column]],
            "torque change mNm": 1e3 * float(per_event.torque_change[event, column]),
        },
        "joint over the session": counts(interactions[0], column),
    }
    (folder / f"{name}.json").write_text(json.dumps(rounded(numbers), indent=1) + "\n")
    return rounded(numbers)


def counts(interaction: Interaction, column: int) -> dict:
    """Events by status, and the pooled value with its interval."""
    status = np.asarray(interaction.per_event.status)[:, column]
    summary = interaction.summary
    return {
        **{text: int(np.sum(status == code)) for code, text in enumerate(STATUS)},
        "pooled rad/Nm": float(summary.compliance[column]),
        "95 % interval rad/Nm": [float(summary.lower[column]), float(summary.upper[column])],
    }


def rounded(value):
    """Three significant digits, so that the committed file does not change with the machine; JSON has no NaN."""
    if isinstance(value, dict):
        return {key: rounded(item) for key, item in value.items()}
    if isinstance(value, list):
        return [rounded(item) for item in value]
    if isinstance(value, float):
        return float(f"{value:.3g}") if np.isfinite(value) else str(value)
    return value
