"""`icjax perturbation`: the response to a sudden movement of the surface, beside Table 2."""

import json
import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import tyro

LITERATURE = {
    "exploring": (0.677, 0.017, 2.04, 89.16, 81.86),
    "scratching": (1.345, 0.018, 3.86, 257.04, 285.96),
    "HH97": (2.0, 0.006, 2.0, 137.0, None),
    "MF98": (None, None, None, 283.0, None),
    "KPN03": (9.0, 0.142, 5.03, 538.0, None),
}
"""f0 N, m kg, b Ns/m, k N/m, k_G N/m: Kry and Pai 2006, Table 2 (two tasks); Hajian and Howe 1997; Milner and Franklin
1998; Kuchenbecker, Park and Niemeyer 2003. Where the table prints "(relaxed)" there is no force."""

NOTES = (
    "the columns exploring to KPN03 are printed in Table 2 of the paper, for comparison; none is of this recording",
    "k_G has the bias of the compliances that it is computed from; its interval has only their scatter",
    "displacement and stiffness are those of the bone; the pad in series is in the row 'k with pad'",
    "m, b, k of a short window describe the window, not the finger: a jointed finger is not one mass on a spring",
    "the vertical secant is k_G only if the tangential force does not change; the one along the force does not need it",
    "m holds what the force sensor carries, if the recording was not freed of the plate's inertia",
)


@dataclass(frozen=True)
class Perturbation:
    """Analyse trials in which the touched surface suddenly moves: f0, m, b, k, secant stiffness, reaction time, k_G.

    Prints them beside the values of Table 2 of Kry and Pai (2006); with --out writes perturbation.json.
    """

    recording: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORDING.NC")]
    """Recording or session written by `icjax capture`."""
    trial: str | None = None
    """One trial; all if not given."""
    interaction: Path | None = None
    """Interaction whose compliances give k_G at the posture of the perturbation."""
    window: float = 0.025
    """Length of the fit of m, b and k after the onset, s."""
    secant: tuple[float, float] = (0.05, 0.09)
    """Window of the secant stiffness after the onset, s."""
    out: Path | None = None
    """Folder for perturbation.json; nothing is written if not given."""

    def run(self) -> None:
        from icjax.cli._output import Steps
        from icjax.estimation import perturbation
        from icjax.interaction import Interaction
        from icjax.recording import Session

        session = Session.load(self.recording)
        known = [item.name for item in session.trials()]
        if self.trial is not None and self.trial not in known:
            raise ValueError(f"--trial {self.trial}: {self.recording} has the trials {', '.join(known)}")
        chosen = [item for item in session.trials() if self.trial in (None, item.name)]
        if not chosen:
            raise ValueError(f"{self.recording}: no recording with the role 'trial'")
        interaction = Interaction.load(self.interaction) if self.interaction else None
        found = []
        with Steps(1).step("response to the perturbation") as progress:
            for done, item in enumerate(chosen):
                try:
                    found.append(perturbation(item, interaction, self.window, self.secant))
                except ValueError as error:
                    raise ValueError(f"{self.recording}, {item.name}: {error}") from error
                progress((done + 1) / len(chosen))
        print(perturbation_table(found))
        if self.out:
            record = {"session": session.name, "trials": {item.name: numbers(item) for item in found}}
            write_json(self.out / "perturbation.json", {**record, "table 2": LITERATURE, "notes": NOTES})
            print(f"wrote {self.out / 'perturbation.json'}")


def numbers(found) -> dict[str, Any]:
    """What a perturbation gave, as numbers with units in their names; no NaN, JSON has none."""
    fit, secant, reaction = found.fit, found.secant, found.reaction
    result: dict[str, Any] = {
        "contact": found.contact,
        "onset s": found.onset,
        "f0 N": found.rest_force,
        "fit": _fit_numbers(fit),
        "fit by derivatives": _fit_numbers(found.fit_derivative) if found.fit_derivative else None,
        "secant": {
            "window s": list(secant.window),
            "vertical N/m": secant.stiffness,
            "vertical 95 %": [secant.lower, secant.upper],
            "with pad N/m": with_pad(found),
            "along the force N/m": secant.along,
            "along 95 %": [secant.along_lower, secant.along_upper],
            "direction": list(secant.direction),
        },
        "reaction ms": 1e3 * reaction.time,
        "reaction 95 % ms": [1e3 * reaction.lower, 1e3 * reaction.upper],
    }
    if found.stiffness is not None:
        k = found.stiffness
        result["k_G"] = {
            "N/m": k.stiffness,
            "95 %": [k.lower, k.upper],
            "95 % by sampling": [k.sampled_lower, k.sampled_upper],
            "share of each degree of freedom": list(k.share),
        }
    return plain(result)


def perturbation_table(found) -> str:
    """The rows of Table 2, a column a trial and then the literature."""
    columns = [item.name for item in found]
    width = max(26, *(len(name) + 2 for name in columns))
    lines = ["".join([f"{'':22s}", *(f"{name:>{width}s}" for name in columns), *(f"{n:>12s}" for n in LITERATURE)])]
    rows: list[tuple[str, list[str], int | None]] = [("f0 (N)", [f"{item.rest_force:.3f}" for item in found], 0)]
    for index, (name, row) in enumerate((("m (kg)", 1), ("b (Ns/m)", 2), ("k (N/m)", 3))):
        cells = [interval(x.fit.value[index], x.fit.lower[index], x.fit.upper[index]) for x in found]
        rows.append((name, cells, row))
    window = f"{1e3 * found[0].secant.window[0]:.0f}-{1e3 * found[0].secant.window[1]:.0f} ms"
    rows += [
        ("R2 of the fit", [f"{item.fit.r_squared:.4f}" for item in found], None),
        (f"k {window}", [interval(x.secant.stiffness, x.secant.lower, x.secant.upper) for x in found], None),
        ("k with pad", [f"{with_pad(item):.1f}" for item in found], None),
        (
            "k along the force",
            [interval(x.secant.along, x.secant.along_lower, x.secant.along_upper) for x in found],
            None,
        ),
        ("reaction (ms)", [interval(*(1e3 * value for value in item.reaction)) for item in found], None),
    ]
    if found[0].stiffness is not None:
        cells = [interval(x.stiffness.stiffness, x.stiffness.lower, x.stiffness.upper) for x in found]
        rows.append(("k_G (N/m)", cells, 4))
    for name, cells, row in rows:
        told = [values[row] if row is not None else None for values in LITERATURE.values()]
        literature = "".join(f"{'' if value is None else f'{value:g}':>12s}" for value in told)
        lines.append(f"{name:22s}" + "".join(f"{cell:>{width}s}" for cell in cells) + literature)
    return "\n".join([*lines, *(f"- {note}" for note in NOTES)])


def with_pad(found) -> float:
    """Vertical secant stiffness with the pad in series, N/m."""
    from icjax.estimation import in_series

    return float(in_series(found.secant.stiffness, found.pad_compliance))


def interval(value: float, lower: float, upper: float) -> str:
    """Value and interval as text."""
    if not math.isfinite(value):
        return "not seen"
    return f"{value:.3g} [{lower:.3g}, {upper:.3g}]"


def plain(value: Any) -> Any:
    """Python numbers throughout; a number that is not finite becomes a word."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, str) or value is None:
        return value
    number = float(value)
    return number if math.isfinite(number) else str(number)


def write_json(path: Path, content: dict) -> None:
    """Write a file complete or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        temporary.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def _fit_numbers(fit) -> dict[str, Any]:
    names = ("m kg", "b Ns/m", "k N/m", "f0 N")
    return {
        **{name: fit.value[i] for i, name in enumerate(names)},
        "95 %": {name: [fit.lower[i], fit.upper[i]] for i, name in enumerate(names)},
        "window s": fit.window,
        "R2": fit.r_squared,
        "residual N": fit.residual,
        "condition": fit.condition,
    }
