"""Reading and checking a session file."""

import os
import re
from pathlib import Path
from typing import Any

from icjax.capture._calibration_file import changed_by, read_calibration, read_posture
from icjax.capture._spec import ContactSpec, FilterSpec, SessionSpec, SourceSpec, SurfaceSpec, TrialSpec
from icjax.files import FileError, Table, as_numbers, as_rotation, read_toml
from icjax.model import Model, index_finger, load_model
from icjax.recording import ROLES

CHANNELS = {"six_axis": 6, "force_plate": 0, "force_at_point": 9}
"""Kinds of source and the number of channels that each one names."""

PLACEMENT_SD = 0.001
"""m; how well a marker sits on its site where the session does not say: one millimetre."""

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def read_session(path: str | os.PathLike) -> SessionSpec:
    """Read a session file (TOML) and check every name it uses; data files are not opened yet.

    **Errors**: `FileError`, one line that names the file, the table and the key: not TOML, an unknown or missing
    key (with the nearest known one), a value of the wrong kind, an undefined environment variable, a file that
    does not exist, or a site, body, pad, source or trial that nothing defines.
    """
    path = Path(path)
    top = Table(path, "", read_toml(path))
    name = top.text("name", path.stem)
    subject = top.text("subject", "")
    folder = _folder(top, path)
    model_table = top.table("model")
    model, model_source = _model(model_table, path)
    model = changed_by(model_table, top.table("sites", None), model)
    placement_sd = model_table.number("placement_sd", PLACEMENT_SD, above=0.0)
    model_table.close()
    markers = _markers(top.table("markers"), model)
    sources = tuple(_source(table) for table in top.tables("source"))
    _unique(path, "source", [item.name for item in sources])
    trials = tuple(_trial(table, folder, model, sources) for table in top.tables("trial"))
    if not trials:
        raise FileError(path, "needs at least one trial, written [[trial]]")
    _unique(path, "trial", [item.name for item in trials])
    roles = {trial.name: trial.role for trial in trials}
    for trial in trials:
        if trial.catch_of is None:
            continue
        where = f"[[trial]] '{trial.name}': catch_of names"
        if trial.catch_of not in roles:
            raise FileError(path, f"{where} the unknown trial '{trial.catch_of}'")
        if roles[trial.catch_of] != "trial":
            raise FileError(path, f"{where} '{trial.catch_of}', whose role is '{roles[trial.catch_of]}', not 'trial'")
    calibration = read_calibration(top.table("calibration", None), [trial.name for trial in trials])
    spec = SessionSpec(
        path=path,
        name=name,
        subject=subject,
        model=model,
        model_source=model_source,
        placement_sd=placement_sd,
        markers=markers,
        filter=_filter(top.table("filter", None)),
        contact=_contact(top.table("contact", None)),
        sources=sources,
        trials=trials,
        columns=_columns(top.table("columns", None)),
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
            raise table.error(f"key '{key}' uses the environment variable {variable}, which is not defined")
        return os.environ[variable]

    return re.sub(r"\$\{(\w+)\}", value, text)


def _model(table: Table, path: Path) -> tuple[Model, str]:
    builtin = table.choice("builtin", ["index_finger"], None)
    file = table.text("file", None)
    hand_length = table.number("hand_length", None, above=0.0)
    root = table.choice("root", ["free", "fixed"], None)
    strip = table.flag("strip", False)
    if (builtin is None) == (file is None):
        raise table.error("needs either the key 'builtin' or the key 'file'")
    if builtin is None:
        if hand_length is not None:
            raise table.error("key 'hand_length' belongs to a builtin model, not to a file")
        try:
            source = path.parent / _expanded(table, "file", file)
            return load_model(source, free_root=root == "free", strip=strip), file
        except FileError as error:
            raise table.error(f"key 'file': {error}") from error
    try:
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
        markers=table.number("markers", standard.markers, above=0.0),
        forces=table.number("forces", standard.forces, above=0.0),
        events=table.number("events", standard.events, above=0.0),
        stated=tuple(key for key in ("markers", "forces", "events") if key in table.content),
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


def _columns(table: Table | None) -> dict[str, Any]:
    if table is None:
        return {}
    columns = dict(table.content)
    for key in ("time", "markers", "length_unit", "channels", "units"):
        table.take(key, lambda value: value, "", None)
    table.close()
    return columns


def _source(table: Table) -> SourceSpec:
    name = table.text("name")
    kind = table.choice("kind", CHANNELS)
    plate = None
    channels: tuple[str, ...] = ()
    if kind == "force_plate":
        plate = table.whole("plate", least=1)
    else:
        channels = table.texts("channels")
        if len(channels) != CHANNELS[kind]:
            raise table.error(f"key 'channels' lists {len(channels)} channels; kind '{kind}' needs {CHANNELS[kind]}")
    surface = table.table("surface", None)
    rotation = IDENTITY
    position = (0.0, 0.0, 0.0)
    sign = "on_subject"
    if kind == "six_axis":
        position = table.vector("position")
        sign = table.choice("sign", ["on_environment", "on_subject"])
    else:
        sign = table.choice("sign", ["on_environment", "on_subject"], sign)
    if kind != "force_plate":
        rotation = table.take("rotation", as_rotation, "three rows of a rotation matrix", IDENTITY)
    spec = SourceSpec(
        name=name,
        kind=kind,
        channels=channels,
        plate=plate,
        position=position,
        rotation=rotation,
        sign=sign,
        surface=None if surface is None else _surface(surface),
        tare=table.take("tare", _windows, "an interval [from, to] in s, or a list of them", ()),
    )
    table.close()
    return spec


def _surface(table: Table) -> SurfaceSpec:
    point, normal = table.vector("point"), table.vector("normal")
    length = sum(value * value for value in normal) ** 0.5
    if not length > 0:
        raise table.error("key 'normal' must not be zero")
    table.close()
    return SurfaceSpec(point=point, normal=(normal[0] / length, normal[1] / length, normal[2] / length))


def _trial(table: Table, folder: Path, model: Model, sources: tuple[SourceSpec, ...]) -> TrialSpec:
    name = table.text("name")
    role = table.choice("role", ROLES, "trial")
    catch_of = table.text("catch_of", None)
    if (role == "catch") != (catch_of is not None):
        raise table.error("needs the key 'catch_of' exactly when its role is 'catch'")
    file, markers, forces = (table.text(key, None) for key in ("file", "markers", "forces"))
    if (file is None) == (markers is None) or (file is not None and forces is not None):
        raise table.error("needs either the key 'file' or the key 'markers' (with 'forces')")
    touches = table.table("touches", None)
    pairs = () if touches is None else touches.pairs()
    for source, body in pairs:
        known = [item.name for item in sources]
        if source not in known:
            raise table.error(f"key 'touches' names the unknown source '{source}'; known: {', '.join(known) or 'none'}")
        if body not in model.pad_names and body not in model.body_names[1:]:
            names = ", ".join((*model.pad_names, *model.body_names[1:]))
            raise table.error(f"key 'touches' names '{body}', neither a pad nor a body of the model; it has {names}")
    spec = TrialSpec(
        name=name,
        role=role,
        catch_of=catch_of,
        markers=_existing(table, folder, file or markers, "file" if file else "markers"),
        forces=None if forces is None else _existing(table, folder, forces, "forces"),
        touches=pairs,
        friction=table.number("friction", None, least=0.0),
        tare=table.take("tare", _windows, "an interval [from, to] in s, or a list of them", None),
    )
    table.close()
    return spec


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


def _windows(value: Any) -> tuple[tuple[float, float], ...]:
    """One interval [from, to] or a list of them, s. **Errors**: `ValueError`."""
    if not isinstance(value, list) or not value:
        raise ValueError
    items = value if isinstance(value[0], list) else [value]
    windows = tuple(as_numbers(item, 2) for item in items)
    if any(end <= start for start, end in windows):
        raise ValueError
    return tuple((start, end) for start, end in windows)
