"""Press tests on the fingertip pads of `virtual_sessions/grasp5`: stiffness between bone and surface at a given force.

    python experiments/kry_pai_2006/pad_press.py

The simulated pad is a sphere on a linear spring, its contact a soft one that yields most at first touch, so that the
whole pad is softer for small forces; their README states 720 to 800 N/m. icjax's pad is linear. Here two opposite pads
with the parameters of the session's own model pinch a free body of the object's mass in MuJoCo, as an experimenter
would press a fingertip, and the secant stiffness f / approach is read.
"""

import functools

import numpy as np
from virtual_sessions import shared_data

DEPTHS = (5e-5, 1e-4, 2e-4, 3e-4, 4e-4, 6e-4, 1e-3, 3e-3)
"""m; how far the bones are driven together beyond first touch."""

SETTLE = 2.0
"""s"""

BONE = 1e6
"""N/m; the bone is held this much stiffer than the pad, and what it gives is taken off."""


@functools.cache
def press(name: str = "box12g", finger: str = "index") -> tuple[np.ndarray, np.ndarray]:
    """Normal force (N) and secant stiffness (N/m) for every depth, for the object and the pads of a trial's model."""
    import mujoco as mj

    model = mj.MjModel.from_xml_path(
        str(shared_data() / "virtual_sessions" / "grasp5" / f"simulated_subject_TRUTH_{name}.xml")
    )
    pad, spring = model.geom(f"{finger}_pad"), model.joint(f"{finger}_padx")
    mass, radius = model.body(f"{finger}_pad").mass[0], pad.size[0]
    contact = "solref='{} {}' solimp='{} {} {} {} {}'".format(*pad.solref, *pad.solimp)
    half = model.geom("object").size[0]
    passive = f"stiffness='{spring.stiffness[0]}' damping='{model.dof_damping[spring.id]}'"
    passive = f"stiffness='{spring.stiffness[0]}' damping='{model.dof_damping[spring.id]}'"
    slides = "".join(f"<joint type='slide' axis='{axis}' {passive}/>" for axis in ("1 0 0", "0 1 0", "0 0 1"))

    def bone(side: int, depth: float) -> str:
        return (
            f"<body pos='{side * (half + radius - depth)} 0 0'>"
            f"<joint name='bone{side}' type='slide' axis='1 0 0' stiffness='{BONE}' damping='300'/>"
            "<geom type='sphere' size='0.005' mass='0.02' contype='0' conaffinity='0'/>"
            f"<body><inertial pos='0 0 0' mass='{mass}' diaginertia='1e-8 1e-8 1e-8'/>{slides}"
            f"<geom type='sphere' size='{radius}' mass='0' contype='1' conaffinity='2' {contact}/></body></body>"
        )

    force, stiffness = [], []
    for depth in DEPTHS:
        pinch = mj.MjModel.from_xml_string(
            f"<mujoco><option timestep='{model.opt.timestep}' gravity='0 0 0' integrator='implicitfast'/><worldbody>"
            f"<body><freejoint/><geom type='box' size='{half} {half} {half}' mass='{model.body('object').mass[0]}' "
            f"contype='2' conaffinity='1' {contact}/></body>{bone(-1, depth)}{bone(1, depth)}</worldbody></mujoco>"
        )
        data, wrench = mj.MjData(pinch), np.zeros(6)
        for _ in range(round(SETTLE / model.opt.timestep)):
            mj.mj_step(pinch, data)
        mj.mj_contactForce(pinch, data, 0, wrench)
        force.append(wrench[0])
        stiffness.append(wrench[0] / (depth - abs(data.joint("bone1").qpos[0])))
    return np.array(force), np.array(stiffness)


def secant_stiffness(force: np.ndarray, name: str = "box12g") -> np.ndarray:
    """Stiffness (N/m) at each force (N), between the measured ones by straight lines; the fingers' pads are alike."""
    return np.interp(force, *press(name))


if __name__ == "__main__":
    for force, stiffness in zip(*press(), strict=True):
        print(f"{1e3 * force:6.0f} mN: {stiffness:.0f} N/m")
