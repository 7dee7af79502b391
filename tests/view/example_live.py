"""A pad on springs that comes down on a ball on a plate: the smallest scene with everything that can be varied."""

import numpy as np
from synthesis.hands import compliance_of, sprung_tip

from icjax.geometry import Plane, Sphere
from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.spatial import Pose
from icjax.synthesis import Object, Scene, Surface

RADIUS = 0.02
MASS = 0.05
STEPS = 80


def make_scene() -> Scene:
    plate = Surface("plate", Plane(np.zeros(3), np.array([0.0, 0.0, 1.0])), 0.5)
    ball = Object("ball", Sphere(RADIUS), 0.5, mass=MASS, pose=Pose(np.eye(3), np.array([0.0, 0.0, RADIUS])))
    return Scene("ball", (plate,), objects=(ball,))


def make_pressing() -> Interaction:
    """The pad begins 5 mm above the ball's top and goes down by 15 mm, a little beside its middle."""
    model = sprung_tip()
    time = 0.002 * np.arange(STEPS)
    top = 2.0 * RADIUS + float(np.asarray(model.pad_radius)[0])
    reference = np.stack([0 * time, 0 * time + 0.002, np.linspace(top + 0.005, top - 0.01, STEPS)], axis=1)
    nv, none = model.nv, np.zeros((0, model.nv))
    each = np.ones(nv)
    return Interaction(
        name="press",
        model=model,
        time=time,
        compliance=np.tile(compliance_of(model), (STEPS, 1)),
        compliance_sd=np.zeros((STEPS, nv)),
        reference=reference,
        reference_sd=np.zeros((STEPS, nv)),
        q=reference,
        torque=np.zeros((STEPS, nv)),
        contact_names=(),
        contact_force=np.zeros((STEPS, 0, 3)),
        contact_point=np.zeros((STEPS, 0, 3)),
        per_event=CompliancePerEvent(
            recording=(),
            joint_names=model.joint_names,
            onset=np.zeros(0),
            compliance=none,
            standard_error=none,
            status=none.astype(int),
            r_squared=np.zeros((0, nv, 3)),
            torque_change=none,
            angle_before=np.zeros((0, nv, 3)),
            angle_after=np.zeros((0, nv, 3)),
            torque_after=np.zeros((0, nv, 3)),
            window=np.array([0.1, 0.1]),
        ),
        summary=JointCompliance(
            joint_names=model.joint_names,
            compliance=each,
            lower=each,
            upper=each,
            accepted=each.astype(int),
            negative=each.astype(int),
            events=each.astype(int),
        ),
        friction=None,
        provenance="{}",
    )
