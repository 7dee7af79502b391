"""A planned session from a TOML file: model, instruments and the contacts to choose from."""

import dataclasses
import math
import os
from pathlib import Path
from typing import NamedTuple

import numpy as np

from icjax.files import FileError, Table, as_numbers, read_toml
from icjax.fit._probe import Instruments, Probe
from icjax.model import Model, human_hand, index_finger, load_model, neutral


class Planned(NamedTuple):
    """Arguments of `design`."""

    model: Model
    probes: tuple[Probe, ...]
    catch_trials: int = 2
    noise: Instruments = Instruments()


def read_design(path: str | os.PathLike) -> Planned:
    """Read the file of a planned session.

        catch_trials = 2             # of every trial (default), 0 for none
        [model]
        builtin = "index_finger"     # or "human_hand", or file = "subject.xml"
        hand_length = 0.185          # m (default 0.19)
        [compliance]                 # rad/Nm that are expected; default: the model's, 0.5 where it states none
        PIP = 0.5
        [instruments]                # all keys have defaults
        rate = 200                   # Hz of the cameras
        cutoff = 20                  # Hz of the filter
        marker_sd = 0.0002           # m a frame
        placement_sd = 0.001         # m, constant
        [[probe]]
        name = "bent, flat pad"
        angles = { wrist = 3, MP = 18, PIP = 50, DIP = 33 }   # degrees; joints that are not named are neutral
        contact = "fingertip"        # pad, or body with point = [x, y, z] in its frame, m
        normal = [0.97, 0, -0.24]    # of the surface, out of it and to the finger, world axes (default [0, 0, 1])
        speed = 0.1                  # m/s of approach (default)
        contacts = 12                # (default)

    Further keys of a probe: `slide`, `depth`, `hover`, `duration`, `friction`, `pad_stiffness`, as in [`Probe`]; of the
    instruments: `angle_sd`, `offset_sd`, as in [`Instruments`].

    **Errors**: `FileError`, one line naming the file, the table and the key.
    """
    path = Path(path)
    top = Table(path, "", read_toml(path))
    catch_trials = top.whole("catch_trials", 2, least=0)
    model = _model(top.table("model"), path)
    if (table := top.table("compliance", None)) is not None:
        model = _with_compliance(table, model)
    noise = _instruments(top.table("instruments", None))
    probes = tuple(_probe(table, model) for table in top.tables("probe"))
    if not probes:
        raise FileError(path, "needs at least one [[probe]] table")
    top.close()
    return Planned(model, probes, catch_trials, noise)


def _model(table: Table, path: Path) -> Model:
    builtin = table.choice("builtin", ["index_finger", "human_hand"], None)
    file = table.text("file", None)
    hand_length = table.number("hand_length", None, above=0.0)
    table.close()
    if (builtin is None) == (file is None):
        raise table.error("needs either the key 'builtin' or the key 'file'")
    if file is not None and hand_length is not None:
        raise table.error("key 'hand_length' belongs to a builtin model, not to a file")
    try:
        if file is not None:
            return load_model(path.parent / file)
        return (human_hand if builtin == "human_hand" else index_finger)(hand_length or 0.19)
    except (ValueError, OSError) as error:
        raise table.error(str(error)) from error


def _with_compliance(table: Table, model: Model) -> Model:
    compliance = np.array(model.compliance, float)
    for index, name in enumerate(model.dof_names):
        compliance[index] = table.number(name, compliance[index], above=0.0)
    table.close()
    return dataclasses.replace(model, compliance=compliance)


def _instruments(table: Table | None) -> Instruments:
    if table is None:
        return Instruments()
    given = {
        field.name: table.number(field.name, field.default, above=0.0) for field in dataclasses.fields(Instruments)
    }
    table.close()
    try:
        return Instruments(**given)
    except ValueError as error:
        raise FileError(table.path, str(error)) from error


def _probe(table: Table, model: Model) -> Probe:
    q = np.array(neutral(model), float)
    angles = table.table("angles", None)
    if angles is not None:
        for name, kind, at in zip(model.joint_names, model.joint_types, model.coordinate_slices, strict=True):
            if kind == "hinge":
                q[at] = math.radians(angles.number(name, math.degrees(q[at.start])))
        angles.close()
    plain = {field.name: field.default for field in dataclasses.fields(Probe)}
    given = {name: table.vector(name, plain[name]) for name in ("normal", "slide", "point")}
    for name in ("speed", "depth", "hover", "duration", "friction", "pad_stiffness"):
        given[name] = table.take(name, lambda value: as_numbers([value], 1)[0], "a number", plain[name])
    given |= {"name": table.text("name", plain["name"]), "contacts": table.whole("contacts", plain["contacts"])}
    contact = table.text("contact")
    table.close()
    try:
        return Probe(tuple(q.tolist()), contact, **given)
    except ValueError as error:
        raise FileError(table.path, str(error)) from error
