"""Random articulated bodies as MJCF text: branches, every kind of joint, off-centre anchors, references."""

import numpy as np


def random_tree(topology: int, seed: int = 0, bodies: int = 5) -> str:
    """A tree: its shape follows from `topology`, its numbers from `seed`.

    A body has zero to three joints with tilted axes, off-centre anchors and references, and a full inertia.
    """
    shape, rng = np.random.default_rng(topology), np.random.default_rng(seed)
    children: dict[int, list[int]] = {index: [] for index in range(bodies + 1)}
    for body in range(1, bodies + 1):
        children[int(shape.integers(0, body))].append(body)

    def vector(scale):
        return " ".join(f"{number:.17g}" for number in rng.normal(size=3) * scale)

    def joints(body, parent):
        kind = shape.choice(["hinge", "many", "slide", "ball", "free" if parent == 0 else "hinge", "none"])
        place = f'armature="{rng.uniform(0, 0.1):.17g}"'
        if kind == "free":
            return f'<joint name="f{body}" type="free" {place}/>'
        if kind == "ball":
            slide = f'<joint type="slide" axis="{vector(1)}" {place} ref="{rng.normal():.17g}"/>'
            return slide + f'<joint name="b{body}" type="ball" pos="{vector(0.2)}" {place}/>'
        kinds = {"hinge": ["hinge"], "slide": ["slide"], "none": []}.get(
            kind, list(shape.choice(["hinge", "slide"], size=3))
        )
        return "".join(
            f'<joint name="j{body}_{number}" type="{item}" axis="{vector(1)}" pos="{vector(0.2)}" '
            f'ref="{rng.normal():.17g}" {place} damping="0.1" stiffness="{rng.uniform(1, 2):.17g}" '
            f'range="-1 {rng.uniform(0, 1):.17g}" springref="{rng.normal():.17g}"/>'
            for number, item in enumerate(kinds)
        )

    def element(body, parent):
        inside = "".join(element(child, body) for child in children[body])
        size = rng.uniform(0.05, 0.2, size=3)
        return (
            f'<body name="body{body}" pos="{vector(0.4)}" axisangle="{vector(1)} {rng.uniform(0, 3):.17g}">'
            f"{joints(body, parent)}"
            f'<geom type="box" size="{size[0]} {size[1]} {size[2]}" pos="{vector(0.1)}" '
            f'axisangle="{vector(1)} 1.2" mass="{rng.uniform(0.2, 2):.17g}"/>'
            f'<site name="site{body}" pos="{vector(0.2)}"/>{inside}</body>'
        )

    trees = "".join(element(child, 0) for child in children[0])
    return (
        f'<mujoco><compiler angle="radian" autolimits="true"/><option gravity="{vector(5)}"/>'
        f"<worldbody>{trees}</worldbody></mujoco>"
    )
