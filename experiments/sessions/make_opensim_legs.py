"""Session model of OpenSim's gait subject: reads subject01.osim, writes models/opensim_subject01.xml (MJCF).

    ICJAX_SHARED_DATA=... python experiments/sessions/make_opensim_legs.py

What is kept: every body with mass, centre of mass and inertia, the tree, joint centres, rotation axes and their order,
coordinate names, gravity (along -y), markers as sites. An OpenSim CustomJoint places the child by T(p) R1 R2 R3:
translations in the axes of the parent first, then rotations about axes that turn with the body. Slides before hinges
of one MJCF body mean the same.

What differs: OpenSim's knee is no hinge. The tibia's origin follows two splines of the knee angle in the femur,
p(a) = (x(a), y(a)). A hinge at c that carries the tibia's origin at -d moves it on a circle, p(a) = c - Rz(a) d; c
and d here are those of least squares over KNEE_RANGE, in which the recorded walk stays. The script prints what is
left.
Coordinates whose range has no width (the toes') are welded. Muscles, other limits and wrapping surfaces are left out.
"""

import os
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline

KNEE_RANGE = (-1.35, 0.1)
"""rad; knee angle (flexion is negative) over which the hinge is fitted."""

HERE = Path(__file__).resolve().parent
HEADER = """
    The subject of OpenSim's gait example (github.com/opensim-org/opensim-core, subject01.osim, Apache-2.0), written by
    make_opensim_legs.py from the .osim file. y points up, x ahead, z to the right. Joint coordinates have OpenSim's
    names, order and signs. The knee is the hinge that follows OpenSim's splines best; see that script.
  """


def numbers(element: ElementTree.Element, name: str) -> np.ndarray:
    """The numbers of a child element."""
    return np.array((element.findtext(name) or "").split(), dtype=float)


def text(values: np.ndarray) -> str:
    """Numbers for an attribute, a hundredth of a micrometre."""
    return " ".join(f"{value:.8g}" for value in np.round(np.atleast_1d(values), 8) + 0.0)


def spline(axis: ElementTree.Element) -> CubicSpline:
    """OpenSim's NaturalCubicSpline of one translation."""
    found = axis.find("function/NaturalCubicSpline")
    assert found is not None
    return CubicSpline(numbers(found, "x"), numbers(found, "y"), bc_type="natural")


def knee_hinge(axes: list[ElementTree.Element]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre in the femur, centre in the tibia and the RMS distance to OpenSim's path in x and y (m).

    p(a) = c - Rz(a) d is linear in c and d: x = c_x - cos(a) d_x + sin(a) d_y, y = c_y - sin(a) d_x - cos(a) d_y.
    """
    angle = np.linspace(*KNEE_RANGE, 200)
    path = np.concatenate([spline(axes[0])(angle), spline(axes[1])(angle)])
    one, zero = np.ones(200), np.zeros(200)
    design = np.stack(
        [
            np.concatenate([one, zero]),
            np.concatenate([zero, one]),
            np.concatenate([-np.cos(angle), -np.sin(angle)]),
            np.concatenate([np.sin(angle), -np.cos(angle)]),
        ],
        axis=1,
    )
    solution, *_ = np.linalg.lstsq(design, path)
    left = (path - design @ solution).reshape(2, -1)
    return np.append(solution[:2], 0.0), np.append(solution[2:], 0.0), np.sqrt(np.mean(left**2, axis=1))


def add_joints(body: ElementTree.Element, joint: ElementTree.Element) -> None:
    """Slides, then hinges, in the order of the CustomJoint; the body is placed at its joint's place in the parent."""
    for unused in ("orientation", "location", "orientation_in_parent"):
        assert not numbers(joint, unused).any(), unused
    place = numbers(joint, "location_in_parent")
    axes = joint.findall("SpatialTransform/TransformAxis")
    translations, rotations = axes[3:], axes[:3]
    coordinates = joint.findall("CoordinateSet/objects/Coordinate")
    locked = {item.get("name") for item in coordinates if not np.ptp(numbers(item, "range"))}
    centre = np.zeros(3)
    if translations[0].find("function/NaturalCubicSpline") is not None:
        femur, centre, left = knee_hinge(translations)
        place = place + femur - centre
        print(f"{joint.get('name')}: hinge at {femur} in the femur; off OpenSim's path by {1e3 * left} mm RMS (x, y)")
    body.set("pos", text(place))
    for kind, axis in [("slide", item) for item in translations] + [("hinge", item) for item in rotations]:
        coordinate = (axis.findtext("coordinates") or "").strip()
        follows = axis.find("function/NaturalCubicSpline") is not None
        if not coordinate or coordinate in locked or follows:
            continue
        coefficients = axis.find("function/LinearFunction/coefficients")
        assert coefficients is not None
        assert (coefficients.text or "").split() == ["1.00000000", "0.00000000"]
        ElementTree.SubElement(
            body,
            "joint",
            {"name": coordinate, "type": kind, "axis": text(numbers(axis, "axis"))}
            | ({"pos": text(centre)} if centre.any() else {}),
        )


def session_model(osim: Path) -> ElementTree.Element:
    """The MJCF tree of an OpenSim model made of CustomJoints."""
    model = ElementTree.parse(osim).getroot().find("Model")
    assert model is not None
    root = ElementTree.Element("mujoco", {"model": "opensim_subject01"})
    root.append(ElementTree.Comment(HEADER))
    ElementTree.SubElement(root, "compiler", {"angle": "radian"})
    ElementTree.SubElement(root, "option", {"gravity": text(numbers(model, "gravity"))})
    bodies = {"ground": ElementTree.SubElement(root, "worldbody")}
    for source in model.findall("BodySet/objects/Body"):
        joint = source.find("Joint/CustomJoint")
        if joint is None:
            continue
        name = source.get("name") or ""
        parent = (joint.findtext("parent_body") or "").strip()
        body = bodies[name] = ElementTree.SubElement(bodies[parent], "body", {"name": name})
        add_joints(body, joint)
        inertia = [float(source.findtext(f"inertia_{part}") or 0) for part in ("xx", "yy", "zz", "xy", "xz", "yz")]
        ElementTree.SubElement(
            body,
            "inertial",
            {
                "pos": text(numbers(source, "mass_center")),
                "mass": text(numbers(source, "mass")),
                "fullinertia": text(np.array(inertia)),
            },
        )
    for marker in model.findall("MarkerSet/objects/Marker"):
        body = bodies[(marker.findtext("body") or "").strip()]
        site = {"name": marker.get("name") or "", "pos": text(numbers(marker, "location"))}
        ElementTree.SubElement(body, "site", site)
    ElementTree.indent(root)
    return root


if __name__ == "__main__":
    source = Path(os.environ["ICJAX_SHARED_DATA"]) / "opensim_core_gait" / "subject01" / "subject01.osim"
    target = HERE / "models" / "opensim_subject01.xml"
    target.write_text(ElementTree.tostring(session_model(source), encoding="unicode") + "\n", encoding="utf-8")
    print(f"wrote {target.relative_to(HERE)}")
