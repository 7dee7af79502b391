"""The session file that goes with a recording."""

from icjax.laboratory._subject import Subject
from icjax.laboratory._surface import SENSOR_DEPTH, SENSOR_ROTATION, Surface


def session_text(name: str, subject: Subject, surface: Surface, entries: list[tuple[str, str, str]]) -> str:
    """TOML text that describes the session; `entries` are (recording, role, trial it belongs to)."""
    rotation = ", ".join("[" + ", ".join(f"{value:g}" for value in row) + "]" for row in SENSOR_ROTATION)
    lines = [
        "# Simulated by icjax.laboratory: no person was measured.",
        f'name = "{name or "laboratory"}"',
        'subject = "simulated"',
        "simulated = true",
        "",
        "[model]",
        'builtin = "index_finger"',
        f"hand_length = {subject.hand_length!r}",
        'root = "free"',
        "",
        "[markers]",
        *(f'{label} = "{label}"' for label in subject.markers()),
        "",
        "[filter]",
        "markers = 20.0",
        "forces = 60.0",
        "",
        "[[source]]",
        'name = "plate"',
        'kind = "six_axis"',
        'channels = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]',
        f"position = [0.0, 0.0, {surface.height - SENSOR_DEPTH!r}]",
        f"rotation = [{rotation}]",
        'sign = "on_environment"',
        f"surface = {{ point = [0.0, 0.0, {surface.height!r}], normal = [0.0, 0.0, 1.0] }}",
        "tare = [0.0, 0.2]",
    ]
    for recording, role, trial in entries:
        lines += ["", "[[trial]]", f'name = "{recording}"', f'file = "{recording}.c3d"', f'role = "{role}"']
        if role == "catch":
            lines.append(f'catch_of = "{trial}"')
        lines += ['touches = { plate = "fingertip" }', f"friction = {surface.friction!r}"]
    return "\n".join(lines) + "\n"
