"""XML before MuJoCo sees it: read, checked, and relieved of what is missing."""

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from icjax.files import FileError

NOT_MODELLED = ("actuator", "tendon", "equality", "contact", "sensor", "keyframe", "deformable")
"""Sections of an MJCF file about things that a `Model` does not hold."""


def prepared_xml(source: str | os.PathLike, path: str, strip: bool) -> tuple[str, list[str]]:
    """XML text of a model file and what was dropped from it.

    Without `strip` the text is as found. With it includes are read in, absent ones dropped, as are meshes, height
    fields, textures and skins, the geoms made of them, and the sections in `NOT_MODELLED`.

    **Errors**: `FileError` for a file that is missing, no XML, or neither MJCF nor URDF.
    """
    if path == "XML text":
        text, folder = str(source), Path()
    else:
        if not Path(path).is_file():
            raise FileError(path, "does not exist")
        try:
            text, folder = Path(path).read_text(encoding="utf-8"), Path(path).parent
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(path, f"cannot be read as text: {error}") from error
    root = _parsed(text, path)
    if root.tag not in ("mujoco", "robot"):
        raise FileError(path, f"is neither MJCF (<mujoco>) nor URDF (<robot>): its root is <{root.tag}>")
    if not strip:
        return text, []
    dropped: list[str] = []
    _resolve_includes(root, folder, dropped)
    _drop_sections(root, dropped)
    _drop_meshes(root, dropped)
    return ElementTree.tostring(root, encoding="unicode"), dropped


def _parsed(text: str, path: str) -> ElementTree.Element:
    try:
        return ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise FileError(path, f"is not XML: {error}") from error


def _resolve_includes(element: ElementTree.Element, folder: Path, dropped: list[str]) -> None:
    """Replace includes by what they include (paths are relative to the main file, as in MuJoCo)."""
    children = list(element)
    for child in children:
        if child.tag != "include":
            _resolve_includes(child, folder, dropped)
            continue
        place = list(element).index(child)
        element.remove(child)
        file = folder / child.get("file", "")
        if not file.is_file():
            dropped.append(f"absent include {child.get('file')!r}")
            continue
        try:
            included = _parsed(file.read_text(encoding="utf-8"), str(file))
        except (OSError, UnicodeDecodeError) as error:
            raise FileError(file, f"cannot be read as text: {error}") from error
        _resolve_includes(included, folder, dropped)
        for offset, item in enumerate(list(included)):
            element.insert(place + offset, item)


def _drop_sections(root: ElementTree.Element, dropped: list[str]) -> None:
    for section in [child for child in root if child.tag in NOT_MODELLED]:
        if len(section):
            dropped.append(f"{len(section)} entries of <{section.tag}>")
        root.remove(section)


def _drop_meshes(root: ElementTree.Element, dropped: list[str]) -> None:
    """Remove mesh-like assets and everything that refers to them."""
    gone = {"mesh", "hfield", "skin", "texture", "material"}
    counts = dict.fromkeys(("mesh assets", "mesh geoms", "textures and materials"), 0)
    for parent in list(root.iter()):
        for child in list(parent):
            is_asset = parent.tag == "asset" and child.tag in gone
            is_shape = child.tag == "geom" and (
                child.get("type") in ("mesh", "hfield", "sdf") or "mesh" in child.attrib
            )
            is_urdf = child.tag in ("visual", "collision") and child.find("geometry/mesh") is not None
            if not (is_asset or is_shape or is_urdf):
                child.attrib.pop("material", None)
                continue
            parent.remove(child)
            look = child.tag in ("texture", "material")
            counts["textures and materials" if look else "mesh assets" if is_asset else "mesh geoms"] += 1
    dropped += [f"{count} {what}" for what, count in counts.items() if count]
