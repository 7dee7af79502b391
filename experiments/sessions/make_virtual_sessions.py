"""Write the session files and subject models of the simulated sessions from their own descriptions.

    python experiments/sessions/make_virtual_sessions.py SHARED_DATA

reads `virtual_sessions/*/session.json` and `hand_model.json` (never the truth) and writes `virtual_*.toml` and
`models/virtual_subject_*.xml` beside this script. The data are simulated: no person was measured.
"""

import json
import math
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
SUBJECTS = {
    "explore": "A",
    "explore_cruise": "A",
    "bump": "A",
    "perturb_explore": "A",
    "scratch": "B",
    "perturb_scratch": "B",
}
PLACEMENT_SD = 0.0003
"""m, per axis: what the README of the sessions states."""

MASSES = {"HA": 0.45, "PP": 0.020, "MP": 0.011, "DP": 0.006}
"""kg, hand with its other fingers and the phalanges of an index finger, of a hand that is `HAND_LENGTH` long; they grow
with its third power. The values of `index_finger`."""

HAND_LENGTH = 0.19
"""m, wrist to fingertip."""

THICKNESS = {"FA": 0.035, "HA": 0.02, "PP": 0.009, "MP": 0.008, "DP": 0.007}
"""m, radius of a segment; it only shapes its inertia."""


def subject_model(hand: dict, subject: str) -> str:
    """MJCF of the kinematic model that the session gives to its user."""
    tips = [item["offset"][0] for item in hand["segments"][1:]] + [hand["pad"]["centre"][0]]
    lengths = dict(zip(["HA", "PP", "MP", "DP"], tips, strict=True))
    scale = ((sum(tips) + hand["pad"]["radius"]) / HAND_LENGTH) ** 3
    text = _body(hand, "FA", -0.2, 0.0, '<freejoint name="root"/>', 'density="1000"')
    indent = "    "
    for item in hand["segments"]:
        indent += "  "
        axis = " ".join(f"{value:g}" for value in item["axis"])
        joint = f'<joint name="{item["joint"]}" type="hinge" axis="{axis}"/>'
        name = item["name"]
        text += _body(
            hand, name, 0.0, lengths[name], joint, f'mass="{scale * MASSES[name]:.4g}"', item["offset"], indent
        )
    pad = hand["pad"]
    text += f'{indent}  <geom name="fingertip" class="pad" type="sphere" pos="{_row(pad["centre"])}"'
    text += f' size="{pad["radius"]!r}"/>\n'
    for depth in range(len(hand["segments"]), -1, -1):
        text += "    " + "  " * depth + "</body>\n"
    return (
        f"<!-- Subject {subject} of the simulated sessions: the kinematic model given with them (hand_model.json).\n"
        "     Segment masses are those of a hand of this length, spread along the segment; the forearm is water. -->\n"
        f'<mujoco model="virtual_subject_{subject}">\n'
        '  <compiler angle="radian"/>\n  <default><default class="pad"><geom mass="0"/></default></default>\n'
        f"  <worldbody>\n{text}  </worldbody>\n</mujoco>\n"
    )


def _body(hand, name, start, stop, joint, weight, offset=(0.0, 0.0, 0.0), indent="    "):
    lines = [f'{indent}<body name="{name}" pos="{_row(offset)}">', f"{indent}  {joint}"]
    place = f'fromto="{start!r} 0 0 {stop!r} 0 0" size="{THICKNESS[name]!r}"'
    lines.append(f'{indent}  <geom type="cylinder" {place} {weight}/>')
    for number, place in enumerate(hand["markers"][name], 1):
        lines.append(f'{indent}  <site name="{name}{number}" pos="{_row(place)}"/>')
    return "\n".join(lines) + "\n"


def _row(values) -> str:
    return " ".join(repr(float(value)) for value in values)


def session_file(folder: str, session: dict, hand: dict, subject: str, daq: bool = False) -> str:
    """TOML of one session; with `daq`, of the trial whose force a separately clocked acquisition recorded too."""
    sensor = hand["sensor"]
    rows = sensor["R_sensor_from_world"]
    rotation = [[rows[column][row] for column in range(3)] for row in range(3)]
    labels = [f"{name}{number}" for name in ("FA", "HA", "PP", "MP", "DP") for number in _numbers(hand, name)]
    lines = [
        "# Simulated with MuJoCo, independently of icjax; no person was measured. Written by make_virtual_sessions.py.",
        f'name = "{folder}{"_daq" if daq else ""}"',
        f'subject = "{subject}"',
        "simulated = true",
        f'folder = "${{ICJAX_SHARED_DATA}}/virtual_sessions/{folder}"',
        "",
        "[model]",
        f'file = "models/virtual_subject_{subject}.xml"',
        f"placement_sd = {PLACEMENT_SD}",
        "",
        "[markers]",
        *(f'{label} = "{label}"' for label in labels),
        "",
        "[[source]]",
        'name = "plate"',
        'kind = "six_axis"',
        'channels = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]',
        f"position = {[float(value) for value in sensor['origin_world']]}",
        f"rotation = {rotation}",
        'sign = "on_environment"',
        f"surface = {{ point = [0.0, 0.0, {sensor['plate_top_z']}], normal = [0.0, 0.0, 1.0] }}",
        "tare = [0.0, 0.2]",
    ]
    if folder.startswith("perturb"):  # the plate jumps; elsewhere it stands still
        lines.append(
            "# `top` would take the plate's inertia out of the force. Not here: markers smear the jump over 8 ms,"
        )
        lines.append("# which moves its onset and spoils a fit of 25 ms. After 30 ms the plate rests.")
        lines.append(f'# top = {{ mass = {sensor["top_plate_mass"]}, markers = ["PL1", "PL2", "PL3", "PL4"] }}')
    if daq:
        lines += ["", "[clock]", 'sync = "SYNC"', "period = 1.0"]
        trial = next(item for item in session["trials"] if item["trial"] == "trial00")
        lines += ["", "[[trial]]", f'name = "{trial["trial"]}"', f'markers = "{trial["trial"]}_markers.csv"']
        lines += [f'forces = "{trial["trial"]}_force_daq.csv"', 'touches = { plate = "fingertip" }']
        return "\n".join([*lines, f"friction = {trial['friction']}"]) + "\n"
    friction = {item["trial"]: item.get("friction") for item in session["trials"]}
    for item in sorted(session["trials"], key=lambda item: "catch_of" in item):
        name = item["trial"]
        of = item.get("catch_of")
        lines += ["", "[[trial]]", f'name = "{name}"', f'file = "{name}.c3d"']
        lines += [f'role = "{"catch" if of else "trial"}"'] + ([f'catch_of = "{of}"'] if of else [])
        lines.append('touches = { plate = "fingertip" }')
        if friction.get(name) is not None:
            lines.append(f"friction = {friction[name]}")
    return "\n".join(lines) + "\n"


def grasp_model(hand: dict) -> str:
    """MJCF of the five-finger hand; pads are the fingertip spheres."""
    children: dict[str, list[dict]] = {}
    for item in hand["segments"]:
        children.setdefault(item["parent"], []).append(item)

    def body(item: dict, indent: str) -> str:
        name = item["name"]
        inner = children.get(name, [])
        place = f'pos="{_row(item["offset"])}" quat="{_row(item["quat_wxyz"])}"'
        lines = [f'{indent}<body name="{name}" {place}>']
        for joint in item["joints"]:
            axis = " ".join(f"{value:g}" for value in joint["axis"])
            lines.append(f'{indent}  <joint name="{joint["name"]}" type="{joint["type"]}" axis="{axis}"/>')
        length = max([math.dist(child["offset"], (0, 0, 0)) for child in inner], default=0.0) or 0.2
        width = THICKNESS.get(name, THICKNESS["MP"])
        shape = f'fromto="0 0 0 {(-length if name == "FA" else length)!r} 0 0" size="{width!r}"'
        lines.append(f'{indent}  <geom type="cylinder" {shape} density="1000"/>')
        for number, marker in enumerate(hand["markers"][name], 1):
            lines.append(f'{indent}  <site name="{name}{number}" pos="{_row(marker)}"/>')
        for child in inner:
            if child["name"].endswith("_pad"):
                finger = child["name"].removesuffix("_pad")
                radius = hand["pad_radius"].get(finger, hand["pad_radius"]["other"])
                lines.append(
                    f'{indent}  <geom name="{finger}" class="pad" type="sphere" pos="{_row(child["offset"])}" '
                    f'size="{radius!r}"/>'
                )
        text = "\n".join(lines) + "\n"
        text += "".join(body(child, indent + "  ") for child in inner if not child["name"].endswith("_pad"))
        return text + f"{indent}</body>\n"

    return (
        "<!-- Subject C of the simulated sessions: the kinematic model given with them (hand_model.json).\n"
        "     Segment masses are those of water-filled cylinders. -->\n"
        '<mujoco model="virtual_subject_C">\n'
        '  <compiler angle="radian"/>\n  <default><default class="pad"><geom mass="0"/></default></default>\n'
        f"  <worldbody>\n{''.join(body(item, '    ') for item in children['world'])}  </worldbody>\n</mujoco>\n"
    )


def grasp_file(session: dict, hand: dict) -> str:
    """TOML of the five-finger session: normal-only sensors on the fingertips.

    The object stands with its faces across x, the thumb beyond it: the force on the thumb points along -x, that
    on the fingers along +x.
    """
    lines = [
        "# Simulated with MuJoCo, independently of icjax; no person was measured. Written by make_virtual_sessions.py.",
        'name = "grasp5"',
        'subject = "C"',
        "simulated = true",
        'folder = "${ICJAX_SHARED_DATA}/virtual_sessions/grasp5"',
        "",
        "[model]",
        'file = "models/virtual_subject_C.xml"',
        "",
        "[markers]",
        *(f'{name}{i} = "{name}{i}"' for name, places in hand["markers"].items() for i in range(1, len(places) + 1)),
    ]
    for finger in hand["fingers"]:
        lines += ["", "[[source]]", f'name = "{finger}"', 'kind = "normal"', f'channels = ["Fn_{finger}"]']
        sign = -1.0 if finger == "thumb" else 1.0
        lines += ['frame = "world"', f"normal = [{sign}, 0.0, 0.0]", "tare = [0.0, 0.2]"]
    touches = ", ".join(f'{finger} = "{finger}"' for finger in hand["fingers"])
    for item in session["trials"]:
        lines += ["", "[[trial]]", f'name = "{item["trial"]}"', f'file = "{item["trial"]}.c3d"']
        lines += [f"touches = {{ {touches} }}", f"friction = {item['friction']}"]
    return "\n".join(lines) + "\n"


def _numbers(hand, name):
    return range(1, len(hand["markers"][name]) + 1)


def main(shared: Path) -> None:
    (HERE / "models").mkdir(exist_ok=True)
    for folder, subject in SUBJECTS.items():
        source = shared / "virtual_sessions" / folder
        hand = json.loads((source / "hand_model.json").read_text())
        session = json.loads((source / "session.json").read_text())
        (HERE / f"virtual_{folder}.toml").write_text(session_file(folder, session, hand, subject))
        (HERE / "models" / f"virtual_subject_{subject}.xml").write_text(subject_model(hand, subject))
        if folder == "explore":
            (HERE / "virtual_explore_daq.toml").write_text(session_file(folder, session, hand, subject, daq=True))
    source = shared / "virtual_sessions" / "grasp5"
    hand = json.loads((source / "hand_model.json").read_text())
    session = json.loads((source / "session.json").read_text())
    (HERE / "virtual_grasp5.toml").write_text(grasp_file(session, hand))
    (HERE / "models" / "virtual_subject_C.xml").write_text(grasp_model(hand))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
