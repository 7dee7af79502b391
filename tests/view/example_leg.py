"""Records that a finger session does not give: a model with slide, hinge and ball joint, and rows without a pose."""

import equinox as eqx
import numpy as np

from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.model import load_model
from icjax.rollout import Rollout

LEG = """
<mujoco><worldbody><body name="thigh"><joint name="rail" type="slide" axis="0 0 1"/>
<joint name="knee" type="hinge" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .2 0 0"/>
<body name="foot" pos=".2 0 0"><joint name="ankle" type="ball"/>
<geom type="capsule" size=".02" fromto="0 0 0 .1 0 0"/></body></body></worldbody></mujoco>
"""


def with_ball_joint(interaction: Interaction) -> Interaction:
    """The same numbers hung on a model with a slide, a hinge and a ball joint; its events name the ball's parts."""
    model = load_model(LEG)
    steps, events = len(interaction.time), len(interaction.per_event.onset)
    rng = np.random.default_rng(3)
    q = np.concatenate([0.01 * rng.standard_normal((steps, 2)), np.tile([1.0, 0.0, 0.0, 0.0], (steps, 1))], axis=1)
    names, old = model.dof_names, interaction.per_event
    columns = np.arange(len(names)) % 4
    per_event = CompliancePerEvent(
        recording=old.recording,
        joint_names=names,
        onset=old.onset,
        compliance=old.compliance[:, columns],
        standard_error=old.standard_error[:, columns],
        status=np.zeros((events, len(names)), int),
        r_squared=old.r_squared[:, columns],
        torque_change=old.torque_change[:, columns],
        angle_before=old.angle_before[:, columns],
        angle_after=old.angle_after[:, columns],
        torque_after=old.torque_after[:, columns],
        window=old.window,
    )
    ones = np.ones(len(names))
    counts = np.full(len(names), events)
    return Interaction(
        name=interaction.name,
        model=model,
        time=interaction.time,
        compliance=np.ones((steps, len(names))),
        compliance_sd=np.ones((steps, len(names))),
        reference=q,
        reference_sd=0.01 * np.ones((steps, len(names))),
        q=q,
        torque=rng.standard_normal((steps, len(names))),
        contact_names=interaction.contact_names,
        contact_force=interaction.contact_force,
        contact_point=interaction.contact_point,
        per_event=per_event,
        summary=JointCompliance(
            joint_names=names, compliance=ones, lower=0.5 * ones, upper=2.0 * ones, accepted=counts,
            negative=0 * counts, events=counts,
        ),
        friction=None,
        provenance=interaction.provenance,
    )  # fmt: skip


def without_poses(record: Interaction | Rollout) -> Interaction | Rollout:
    """The same record with NaN in every row of everything that is computed from poses."""

    def lost(values: np.ndarray) -> np.ndarray:
        return np.full(np.shape(values), np.nan)

    record = eqx.tree_at(lambda item: (item.q, item.reference, item.torque), record, replace_fn=lost)
    record = eqx.tree_at(lambda item: item.contact_point, record, replace_fn=lost)
    if isinstance(record, Rollout):
        return eqx.tree_at(lambda item: (item.gap, item.residual), record, replace_fn=lost)
    per_event = eqx.tree_at(
        lambda item: (item.compliance, item.standard_error, item.r_squared), record.per_event, replace_fn=lost
    )
    per_event = eqx.tree_at(lambda item: item.status, per_event, replace_fn=lambda status: np.full_like(status, 3))
    return eqx.tree_at(lambda item: item.per_event, record, per_event)
