# ---
# jupyter:
#   jupytext:
#     text_representation:
#       format_name: percent
#   kernelspec:
#     display_name: Python 3
#     name: python3
# ---

# %% [markdown]
# # Estimate and transfer, in Python
#
# The main job in a notebook. A virtual capture studio records one trial of a simulated finger (so the data are
# *simulated*, by physics that shares no code with what follows); with your own files, start at `read_session`.

# %%
import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np

from icjax.capture import capture, read_session
from icjax.estimation import estimate
from icjax.geometry import Ellipsoid, Plane
from icjax.laboratory import record
from icjax.synthesis import Scene, Surface, Target, rollout, transfer

folder = Path(tempfile.mkdtemp())
record(folder, seed=3, trials=1, contacts=3, catch=0)
session = capture(read_session(folder / "session.toml"))
recording = session.recordings[0]
print(recording.name, f"{recording.rate:.0f} Hz,", len(recording.events.onset), "contacts")

# %% [markdown]
# ## Compliance and reference trajectory
#
# Torque by Eq. 2, compliance at every contact event by section 3.3, reference by Eq. 1.

# %%
interaction = estimate(session)[0]
for joint, value, lower, upper in zip(
    interaction.summary.joint_names,
    interaction.summary.compliance,
    interaction.summary.lower,
    interaction.summary.upper,
    strict=True,
):
    print(f"{joint:6s} {value:7.3f} rad/Nm   95 % [{lower:.3f}, {upper:.3f}]")

# %%
model = interaction.model
mp = model.coordinate_slices[model.joint("MP")].start
figure, axis = plt.subplots(figsize=(7, 2.6), layout="constrained")
axis.plot(interaction.time, np.degrees(interaction.q[:, mp]), label="measured")
axis.plot(interaction.time, np.degrees(interaction.reference[:, mp]), label="reference")
axis.set(xlabel="time (s)", ylabel="MP flexion (deg)")
axis.legend(frameon=False)
# %% [markdown]
# ## Transfer to a bump
#
# A bump on a plate is two surfaces; each gets its own contact slot.

# %%
plate = Surface(name="plate", shape=Plane(point=np.zeros(3), normal=np.array([0.0, 0.0, 1.0])), friction=0.6)
x = float(np.nanmedian(interaction.contact_point[..., 0]))
bump = Surface(
    name="bump",
    shape=Ellipsoid(centre=np.array([x, 0.0, 0.0]), rotation=np.eye(3), radii=np.array([0.012, 0.035, 0.003])),
    friction=0.6,
)
flat = transfer(interaction, Scene(name="flat", surfaces=(plate,)))
over = transfer(interaction, Scene(name="bump", surfaces=(plate, bump)))
figure, axis = plt.subplots(figsize=(7, 2.6), layout="constrained")
axis.plot(interaction.time, interaction.contact_force[:, 0, 2], color="0.6", label="measured on the plate")
axis.plot(flat.time, flat.contact_force.sum(axis=1)[:, 2], label="transferred to the plate")
axis.plot(over.time, over.contact_force.sum(axis=1)[:, 2], label="transferred to the bump")
axis.set(xlabel="time (s)", ylabel="normal force (N)")
axis.legend(frameon=False)
# %% [markdown]
# ## Differentiate through contact
#
# The whole rollout is differentiable, forward and in reverse. How does the impulse on the bump change with each
# joint's compliance?

# %%
first = int(np.searchsorted(interaction.time, recording.events.onset[0] - 0.05))
part = slice(first, first + 150)
targets = Target(
    reference=jnp.asarray(interaction.reference[part]), compliance=jnp.asarray(interaction.compliance[part])
)
scene = Scene(name="bump", surfaces=(plate, bump))


def impulse(scale):
    scaled = Target(reference=targets.reference, compliance=targets.compliance * scale)
    _, info = rollout(model, scene, scaled)
    return info.contact_force[..., 2].sum() * scene.step


gradient = jax.grad(impulse)(jnp.ones(model.nv))
for joint in ("wrist", "MP", "PIP", "DIP"):
    print(f"{joint:6s} {float(gradient[model.dof_names.index(joint)]):+.4f} N s per relative change of compliance")
