"""Reading and checking a session file."""

import os
import re
from pathlib import Path
from typing import Any

from icjax.capture._angles import ANGLE_SD, angle_columns, movement_key
from icjax.capture._calibration_file import changed_by, read_calibration, read_posture
from icjax.capture._source_file import read_source, windows
from icjax.capture._spec import ClockSpec, ContactSpec, FilterSpec, SessionSpec, SourceSpec, TrialSpec
from icjax.files import FileError, Table, read_toml
from icjax.model import Model, human_hand, index_finger, load_model
from icjax.recording import NORMAL_ONLY, ROLES

PLACEMENT_SD = 0.001
"""m; how well a marker sits on its site where the session does not say: one millimetre."""

SHORTEST_PERIOD = 0.001
"""s; of synchronisation pulses."""

LEAST_CUTOFF = 0.1
"""Hz; a lower cut-off leaves nothing of a movement."""


def read_session(path: str | os.PathLike) -> SessionSpec:
    """Read a session file (TOML) and check every name it uses; data files are not opened yet.

    **Errors**: `FileError`, one line that names the file, the table and the key: not TOML, an unknown or missing
    key (with the nearest known one), a value of the wrong kind, an undefined environment variable, a file that
    does not exist, or a site, body, pad, source or trial that nothing defines.
    """
    path = Path(path)
    top = Table(path, "", read_toml(path))
    name = top.label("name", path.stem)
    subject = top.text("subject", "")
    simulated = top.flag("simulated", None)
    folder = _folder(top, path)
    model_table = top.table("model")
    model, model_source = _model(model_table, path)
    model = changed_by(model_table, top.table("sites", None), model)
    placement_sd = model_table.number("placement_sd", PLACEMENT_SD, above=0.0)
    angle_sd = model_table.number("angle_sd", ANGLE_SD, above=0.0)
    model_table.close()
    angles = angle_columns(top.table("angles", None), model)
    markers = () if angles and "markers" not in top.content else _markers(top.table("markers"), model)
    sources = tuple(read_source(table) for table in top.tables("source"))
    _unique(path, "source", [item.name for item in sources])
    trials = tuple(_trial(table, folder, model, sources) for table in top.tables("trial"))
    if not trials:
        raise FileError(path, "needs at least one trial, written [[trial]]")
    _unique(path, "trial", [item.name for item in trials])
    roles = {trial.name: trial.role for trial in trials}
    for trial in trials:
        if not (angles if trial.angles else markers):
            needed = "angles" if trial.angles else "markers"
            raise FileError(path, f"[[trial]] '{trial.name}': its movement needs the table [{needed}]")
        where = f"[[trial]] '{trial.name}': catch_of names"
        for repeated in trial.catch_of:
            if repeated not in roles:
                raise FileError(path, f"{where} the unknown trial '{repeated}'")
            if roles[repeated] != "trial":
                raise FileError(path, f"{where} '{repeated}', whose role is '{roles[repeated]}', not 'trial'")
    calibration = read_calibration(top.table("calibration", None), [trial.name for trial in trials])
    spec = SessionSpec(
        path=path,
        name=name,
        subject=subject,
        simulated=simulated,
        model=model,
        model_source=model_source,
        placement_sd=placement_sd,
        markers=markers,
        filter=_filter(top.table("filter", None)),
        contact=_contact(top.table("contact", None)),
        sources=sources,
        trials=trials,
        columns=_columns(top.table("columns", None)),
        angles=angles,
        angle_sd=angle_sd,
        clock=_clock(top.table("clock", None), sources),
        calibration=calibration,
        posture=read_posture(top.table("posture", None), model),
    )
    top.close()
    return spec


def _folder(top: Table, path: Path) -> Path:
    folder = path.parent / _expanded(top, "folder", top.text("folder", "."))
    if not folder.is_dir():
        raise FileError(path, f"key 'folder' names {folder}, which is not a folder")
    return folder


def _expanded(table: Table, key: str, text: str) -> str:
    """A path with its ${VARIABLES} replaced."""

    def value(match: re.Match) -> str:
        variable = match.group(1)
        if variable not in os.environ:
            raise table.error(f"key '{key}' uses the environment variable {variable}, which is not set")
        return os.environ[variable]

    return re.sub(r"\$\{(\w+)\}", value, text)


def _model(table: Table, path: Path) -> tuple[Model, str]:
    builtin = table.choice("builtin", ["index_finger", "human_hand"], None)
    file = table.text("file", None)
    hand_length = table.number("hand_length", None, above=0.0)
    hand_breadth = table.number("hand_breadth", None, above=0.0)
    side = table.choice("side", ["right", "left"], None)
    root = table.choice("root", ["free", "fixed"], None)
    strip = table.flag("strip", False)
    if (builtin is None) == (file is None):
        raise table.error("needs either the key 'builtin' or the key 'file'")
    if builtin is None and hand_length is not None:
        raise table.error("key 'hand_length' belongs to a builtin model, not to a file")
    for key, value in (("hand_breadth", hand_breadth), ("side", side)):
        if builtin != "human_hand" and value is not None:
            raise table.error(f"key '{key}' belongs to the builtin model 'human_hand'")
    if builtin is None:
        try:
            source = path.parent / _expanded(table, "file", file)
            return load_model(source, free_root=root == "free", strip=strip), file
        except FileError as error:
            raise table.error(f"key 'file': {error}") from error
    try:
        if builtin == "human_hand":
            return human_hand(hand_length or 0.19, hand_breadth, side or "right", root or "compliant"), builtin
        return index_finger(hand_length or 0.19, root or "free"), builtin
    except ValueError as error:
        raise table.error(str(error)) from error


def _markers(table: Table, model: Model) -> tuple[tuple[str, str], ...]:
    pairs = table.pairs()
    if not pairs:
        raise table.error("names no marker")
    for label, site in pairs:
        if site not in model.site_names:
            raise table.error(f"key '{label}': {_named(model.site, site)}")
    _unique(table.path, "marker site", [site for _, site in pairs])
    return pairs


def _filter(table: Table | None) -> FilterSpec:
    if table is None:
        return FilterSpec()
    standard = FilterSpec()
    spec = FilterSpec(
        markers=table.number("markers", standard.markers, least=LEAST_CUTOFF),
        forces=table.number("forces", standard.forces, least=LEAST_CUTOFF),
        events=table.number("events", standard.events, least=LEAST_CUTOFF),
        angles=table.number("angles", None, least=LEAST_CUTOFF),
        stated=tuple(key for key in ("markers", "forces", "events", "angles") if key in table.content),
    )
    table.close()
    return spec


def _contact(table: Table | None) -> ContactSpec:
    if table is None:
        return ContactSpec()
    standard = ContactSpec()
    spec = ContactSpec(
        onset=table.number("onset", None, above=0.0),
        release=table.number("release", None, above=0.0),
        shortest=table.number("shortest", standard.shortest, above=0.0),
        gap=table.number("gap", standard.gap, above=0.0),
        point_sd=table.number("point_sd", standard.point_sd, above=0.0),
    )
    if spec.release is not None and (spec.onset is None or spec.release >= spec.onset):
        raise table.error("key 'release' must be below the key 'onset'")
    table.close()
    return spec


def _clock(table: Table | None, sources: tuple[SourceSpec, ...]) -> ClockSpec | None:
    if table is None:
        return None
    standard = ClockSpec()
    spec = ClockSpec(
        sync=table.text("sync", None),
        period=table.number("period", None, above=SHORTEST_PERIOD),
        start=table.number("start", standard.start),
        marker_sync=table.text("marker_sync", None),
        correlate=table.choice("correlate", [item.name for item in sources], None),
        within=table.number("within", standard.within, above=0.0),
        offset=table.number("offset", None),
        drift_sd=table.number("drift_sd", standard.drift_sd, above=0.0),
    )
    if (spec.sync is None) == (spec.correlate is None):
        raise table.error("needs either the key 'sync' or the key 'correlate'")
    if (spec.sync is not None) != ((spec.period is None) != (spec.marker_sync is None)):
        raise table.error("needs one of the keys 'period' and 'marker_sync' exactly when it has the key 'sync'")
    table.close()
    return spec


def _columns(table: Table | None) -> dict[str, Any]:
    if table is None:
        return {}
    columns: dict[str, Any] = {}
    for key in ("time", "length_unit"):
        if key in table.content:
            columns[key] = table.text(key)
    for key in ("channels", "units"):
        if key in table.content:
            columns[key] = dict(table.table(key).pairs())
    if "markers" in table.content:
        triples = table.table("markers")
        columns["markers"] = {name: list(triples.texts(name)) for name in triples.content}
        for name, triple in columns["markers"].items():
            if len(triple) != 3:
                raise triples.error(f"key '{name}' must list three columns")
    table.close()
    return columns


def _trial(table: Table, folder: Path, model: Model, sources: tuple[SourceSpec, ...]) -> TrialSpec:
    name = table.label("name")
    role = table.choice("role", ROLES, "trial")
    catch_of = table.take("catch_of", _repeated, "the name of a trial, or a list of them", ())
    if (role == "catch") != bool(catch_of):
        raise table.error("needs the key 'catch_of' exactly when its role is 'catch'")
    movement, degrees = movement_key(table)
    forces = table.text("forces", None)
    if movement == "file" and forces is not None:
        raise table.error("needs either the key 'file' or the key 'markers' (with 'forces')")
    touches = table.table("touches", None)
    pairs = () if touches is None else _touched(touches)
    for source, body in pairs:
        known = [item.name for item in sources]
        blind = [item.name for item in sources if item.kind in NORMAL_ONLY and item.frame == "body"]
        if source in blind and [name for name, _ in pairs].count(source) > 1:
            raise table.error(f"key 'touches' names two bodies for '{source}', a sensor that one body carries")
        if source not in known:
            raise table.error(f"key 'touches' names the unknown source '{source}'; known: {', '.join(known) or 'none'}")
        if body not in model.pad_names and body not in model.body_names[1:]:
            names = ", ".join((*model.pad_names, *model.body_names[1:]))
            raise table.error(f"key 'touches' names '{body}', neither a pad nor a body of the model; it has {names}")
    spec = TrialSpec(
        name=name,
        role=role,
        catch_of=catch_of,
        markers=_existing(table, folder, table.content[movement], movement),
        forces=None if forces is None else _existing(table, folder, forces, "forces"),
        touches=pairs,
        friction=table.number("friction", None, least=0.0),
        tare=table.take("tare", windows, "an interval [from, to] in s, or a list of them", None),
        angles=movement == "angles",
        degrees=degrees,
    )
    table.close()
    return spec


def _repeated(value: Any) -> tuple[str, ...]:
    found = [value] if isinstance(value, str) else value
    if not isinstance(found, list) or not found or not all(isinstance(item, str) and item for item in found):
        raise ValueError
    return tuple(dict.fromkeys(found))


def _touched(table: Table) -> tuple[tuple[str, str], ...]:
    """Pairs (source, pad or body); a source may list several that touch it in turn."""
    pairs = []
    for source, value in table.content.items():
        bodies = table.texts(source) if isinstance(value, list) else (table.text(source),)
        pairs += [(source, body) for body in bodies]
    return tuple(pairs)


def _existing(table: Table, folder: Path, name: str, key: str) -> Path:
    path = folder / name
    if not path.is_file():
        raise table.error(f"key '{key}' names {path}, which does not exist")
    return path


def _unique(path: Path, kind: str, names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise FileError(path, f"{kind} '{name}' is named twice")


def _named(lookup: Any, name: str) -> str:
    try:
        lookup(name)
    except ValueError as error:
        return str(error)
    return ""
