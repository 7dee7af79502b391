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
# # Design an experiment
#
# Which contacts are worth a subject's time? `design` simulates each kind of contact that might be recorded and says
# how wide the 95 % interval of every joint would be after the fit. Here it continues a pilot session, that of
# [](fit_your_recording.py): the finger explored a level plate, and the intervals of PIP and DIP span a factor
# of four, and PIP has no number.
# What should be recorded next? The pilot comes from the virtual finger studio; no person was measured.

# %%
import dataclasses
import os
import tempfile
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)

import matplotlib.pyplot as plt
import numpy as np

from icjax.capture import capture, read_session
from icjax.fit import (
    FitRecord,
    Probe,
    Variability,
    design,
    design_text,
    finger_candidates,
    fit_record,
    fit_session,
)
from icjax.laboratory import record
from icjax.model import pad_positions
from icjax.recording import Session

folder = Path(os.environ.get("ICJAX_GUIDES", tempfile.gettempdir())) / "finger_11"  # shared by three guides
if not (folder / "recording.nc").is_file():
    record(folder, seed=11, trials=4, contacts=3, catch=2, compliance=(0.25, 0.70, 0.45, 1.10))
    capture(read_session(folder / "session.toml")).save(folder / "recording.nc")
session = Session.load(folder / "recording.nc")
if not (folder / "fit_catch_2.nc").is_file():
    fit_record(fit_session(session), session).save(folder / "fit_catch_2.nc")
pilot = FitRecord.load(folder / "fit_catch_2.nc")
joints = pilot.joint_names
print(
    "pilot, largest over smallest value:", ", ".join(f"{j} {w:.2f}" for j, w in zip(joints, pilot.width, strict=True))
)

# %% [markdown]
# ## What the pilot says of the subject
#
# Two things go into a plan: how compliant the joints are (of a refused joint the likeliest value, prior included;
# nothing better is known) and how far repetitions of a movement differ. Without a pilot leave both out; typical values
# are used.

# %%
model = session.trials()[0].model
compliance = np.array(model.compliance)
for name, value in zip(joints, pilot.compliance, strict=True):
    compliance[model.dof_names.index(name)] = value
model = dataclasses.replace(model, compliance=compliance)
variability = Variability(pilot.variability, pilot.noise, pilot.inflation)
print("expected (rad/Nm):", ", ".join(f"{name} {compliance[model.dof_names.index(name)]:.2f}" for name in joints))

# %% [markdown]
# ## Rank postures and directions
#
# A `Probe` is a kind of contact: posture, surface, speed, how deep the movement wants to go, how often.
# `finger_candidates` makes thirteen: four postures, each with the surface flat on the pad, oblique, or under the tip,
# and the exploring finger on a level plate. Unless told otherwise a movement goes on at its speed, which loads the
# joints more than people do; here each is meant to end 5 mm below the surface.

# %%
probes = [dataclasses.replace(probe, depth=0.005) for probe in finger_candidates(model, contacts=12)]
plan = design(model, probes, catch_trials=2, variability=variability)
order = list(plan.ranking())

figure, axis = plt.subplots(figsize=(6.2, 4.6), layout="constrained")
axis.imshow(np.log(plan.widths[order]), cmap="RdYlBu_r", vmin=0.0, vmax=2 * np.log(4.0), aspect="auto", alpha=0.6)
for row, item in enumerate(order):
    for column, width in enumerate(plan.widths[item]):
        weight = "bold" if width > 4.0 else "normal"
        axis.text(
            column, row, f"{width:.2f}" if width < 10 else f"{width:.0f}", ha="center", va="center", fontweight=weight
        )
axis.set_xticks(range(4), joints)
axis.xaxis.tick_top()
axis.set_yticks(range(len(order)), [probes[item].name for item in order])
_ = figure.supxlabel("interval after 12 contacts, largest over smallest value; bold: no number", fontsize=9)

# %% [markdown]
# Probes are sorted by their worst joint. Bold means that the interval would span more than a factor of four: the fit
# would refuse the joint. Look along a row for what a contact tells, and down a column for what a joint needs.
#
# The same as text, what `icjax design` prints: the table, what a refused joint is missing, and the best contacts to
# combine.

# %%
print(design_text(plan, best=2))

# %% [markdown]
# Why a joint is told or not is in three numbers: the torque that the contact puts on it, how far that moves it, and
# how far repetitions differ anyway. The largest of one contact, for the level plate and the best:

# %%
names = [probe.name for probe in probes]
level, best = names.index("exploring, level plate"), order[0]
for item in (level, best):
    print(probes[item].name)
    needed = plan.contacts_needed([item])
    for j, joint in enumerate(joints):
        wanted = f"{needed[j]:.0f} contacts" if np.isfinite(needed[j]) else "more contacts do not help"
        print(
            f"  {joint:5s} {1e3 * plan.torque[item, j]:6.1f} mNm, moves {np.degrees(plan.deflection[item, j]):5.2f} "
            f"degrees, repetitions leave {np.degrees(plan.doubt[item, j]):.2f} open; for a number: {wanted}"
        )

# %% [markdown]
# On the level plate the force passes close to PIP. That is geometry, and no number of contacts that anybody records
# is a cure for it; the text above calls more than 200 none.
#
# ## How many contacts?
#
# Contacts that are alike only add up, so this costs nothing to ask.

# %%
pair = plan.best_set(2, contacts=12)
print("best two together:", "; ".join(probes[item].name for item in pair))
count = np.unique(np.round(np.geomspace(3, 100, 25)))
figure, axes = plt.subplots(1, 3, figsize=(9, 2.9), layout="constrained", sharey=True)
for axis, chosen in zip(axes, ([level], [best], pair), strict=True):
    widths = np.array([plan.expected(chosen, contacts=float(n)).width for n in count])
    for j, (joint, colour) in enumerate(zip(joints, ("#0072B2", "#E69F00", "#009E73", "#7A5195"), strict=True)):
        axis.plot(count, widths[:, j], color=colour, label=joint)
    axis.axhline(4.0, color="k", lw=0.8, ls=":")
    axis.set(
        xscale="log", yscale="log", xlabel="contacts in all", ylim=(1, 30), title="\n+ ".join(names[i] for i in chosen)
    )
    axis.title.set_fontsize(9)
    axis.set_xticks([3, 10, 30, 100])
    axis.set_yticks([1, 2, 4, 10, 30])
    axis.xaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_major_formatter("{x:g}")
axes[0].set_ylabel("largest over smallest value")
_ = axes[2].legend(frameon=False)
for chosen in ([level], [best], pair):
    print(
        f"{' + '.join(names[i] for i in chosen):45s} contacts for a number:",
        ", ".join(f"{j} {n:.0f}" for j, n in zip(joints, plan.contacts_needed(chosen), strict=True)),
    )

# %% [markdown]
# Above the dotted line there is no number. Fewer than three contacts are never fitted.
#
# ## How many catch trials?

# %%
print(f"{'12 contacts':26s}{'catch trials':>13s}" + "".join(f"{joint:>10s}" for joint in joints))
for catch_trials in (0, 1, 2, 8):
    other = design(model, [probes[level], probes[best]], catch_trials, variability=variability)
    for probe, widths in zip(other.probes, other.widths, strict=True):
        print(f"{probe.name:26s}{catch_trials:13d}" + "".join(f"{width:10.4g}" for width in widths))

# %% [markdown]
# The first catch trial buys nearly everything. Without any, a movement that goes on and a joint that gives way look
# alike, and the plan says so before anyone has come ([](catch_trials.py) shows it on a recording). The second helps a
# little, further ones hardly. Another posture does what no number of catch trials does.
#
# ## Does it foretell the pilot?
#
# Planned from what was recorded (posture, speed and sliding at every touch) but for the depth, which nobody can
# measure, against what the fit of the pilot then found:

# %%
touches = []
for trial in session.trials():
    for number, onset in enumerate(trial.events.onset):
        frame = round((onset - trial.time[0]) * trial.rate)
        now, before = (np.asarray(pad_positions(model, trial.q[at]))[0] for at in (frame, frame - 10))
        velocity = (now - before) * trial.rate / 10  # m/s
        touches.append(
            Probe(
                trial.q[frame],
                "fingertip",
                speed=-velocity[2],
                slide=(*velocity[:2], 0.0),
                contacts=1,
                name=f"{trial.name} {number}",
            )
        )
print(f"{'':22s}" + "".join(f"{joint:>8s}" for joint in joints))
for depth in (0.003, 0.005, 0.010):
    again = design(model, [dataclasses.replace(touch, depth=depth) for touch in touches], 2, variability=variability)
    width = again.expected(range(len(touches))).width
    print(f"planned, {1e3 * depth:2.0f} mm deep    " + "".join(f"{w:8.2f}" for w in width))
print(f"{'found':22s}" + "".join(f"{w:8.2f}" for w in pilot.width))

# %% [markdown]
# Wrist and MP come out as planned. PIP and DIP, which these contacts hardly load, depend on how deep the subject meant
# to go, and may fall to either side of the rule: plan for widths of two, not of four. [](designing.md) has more such
# comparisons and what is assumed; above all, that nothing but the named point touches.
#
# ## Your own plan
#
# The same from a file, without Python: `icjax design plan.toml --best 3`.
#
# ```toml
# catch_trials = 2
# [model]
# builtin = "index_finger"
# hand_length = 0.185
# [compliance]
# PIP = 0.4                # from the pilot
# [[probe]]
# name = "bent, flat pad"
# angles = { wrist = 3, MP = 18, PIP = 50, DIP = 33 }
# contact = "fingertip"
# normal = [0.97, 0, -0.24]
# speed = 0.1
# depth = 0.005
# contacts = 12
# ```
