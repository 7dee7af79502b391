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
# # Fit your own recording
#
# From the files of a session to the compliance of every joint, with intervals. You need markers on the segments, a
# force sensor under what is touched, both on one clock, and catch trials: the same movements with the surface taken
# away ([](catch_trials.py) shows what happens without).
#
# Here the files come from the virtual finger studio, so that the page can run and the truth is known: a simulated
# subject (MuJoCo; no code in common with the fit) explores a plate. No person was measured. With your own data, leave
# `record` out and let `folder` be where your files are.

# %%
import os
import tempfile
import textwrap
from pathlib import Path

import jax

jax.config.update("jax_enable_x64", True)  # a fit needs double precision

import matplotlib.pyplot as plt
import numpy as np

from icjax import view
from icjax.capture import capture, check, read_session
from icjax.fit import FitOptions, FitRecord, check_fit, fit_record, fit_session, fit_text
from icjax.laboratory import record
from icjax.recording import Session

truth = {"wrist": 0.25, "MP": 0.70, "PIP": 0.45, "DIP": 1.10}  # rad/Nm
folder = Path(os.environ.get("ICJAX_GUIDES", tempfile.gettempdir())) / "finger_11"  # kept: recording takes a while
if not (folder / "session.toml").is_file():
    record(folder, seed=11, trials=4, contacts=3, catch=2, compliance=tuple(truth.values()))
print(*sorted(path.name for path in folder.iterdir() if path.suffix in (".c3d", ".toml")))

# %% [markdown]
# ## Describe the session
#
# One TOML file says what is in the data files. This is the studio's, without the markers and all trials but the first.
# [](session_file.md) lists every key, for OpenSim, Qualisys and CSV files and for joint angles instead of markers,
# too.

# %%
text = (folder / "session.toml").read_text()
model, source = text.index("[model]"), text.index("[filter]")
second = text.index("[[trial]]", text.index("catch00_2"))
print(text[model : text.index("FA2")] + "...\n\n" + text[source:second].rstrip())

# %% [markdown]
# ## Look before computing
#
# `check` reads the files and says what it understood; on the command line that is `icjax check session.toml`. Read
# every line that begins with "suspicious" or "error".

# %%
spec = read_session(folder / "session.toml")
lines = check(spec)
print(*lines[:5], *[line for line in lines if "'trial00'" in line], sep="\n")
print(sum(line.startswith(("suspicious", "error")) for line in lines), "lines begin with suspicious or error")

# %% [markdown]
# ## Capture
#
# Markers become joint angles, channels become contact forces, touches become events (`icjax capture session.toml`). It
# takes a second or so for every trial. The result is one file; do this once.

# %%
if not (folder / "recording.nc").is_file():
    capture(spec).save(folder / "recording.nc")
session = Session.load(folder / "recording.nc")
for item in session.recordings[:3]:
    print(
        f"{item.name:10s} {item.role:6s} {len(item.time)} frames, {item.valid.mean():.1%} with a pose, "
        f"contacts at {np.round(item.events.onset, 2)} s"
    )

# %% [markdown]
# ## The trial and its catch trials
#
# Before fitting, look whether the catch trials are what they should be: the trial's movement until the touch, then
# their own way.

# %%
trial = session.trials()[0]
figure, axes = plt.subplots(2, 1, figsize=(7.4, 3.8), layout="constrained", sharex=True)
for axis, joint in zip(axes, ("wrist", "MP"), strict=True):
    column = trial.model.coordinate_slices[trial.model.joint(joint)].start
    for catch in session.catch_trials(trial.name):
        axis.plot(catch.time, np.degrees(catch.q[:, column]), color="0.6", lw=1, label="catch trial")
    axis.plot(trial.time, np.degrees(trial.q[:, column]), color="#0072B2", label="trial")
    for onset, release in zip(trial.events.onset, trial.events.release, strict=True):
        axis.axvspan(onset, release, color="#DCE6EE", lw=0, zorder=0)
    axis.set(ylabel=f"{joint} (degrees)")
axes[1].set(xlabel="time (s); shaded: contact")
handles, labels = axes[0].get_legend_handles_labels()
_ = figure.legend(handles[1:], labels[1:], loc="outside upper right", ncols=2, frameon=False)

# %% [markdown]
# They start a little earlier or later, and drift; the fit lays each over its trial by the movement before every
# contact.
#
# ## Fit
#
# Half a minute (`icjax fit recording.nc`, which also tells how far it is). `fit_record` puts the paper's estimate
# beside it and keeps everything in one file.

# %%
path = folder / "fit_catch_2.nc"
if not path.is_file():
    fit_record(fit_session(session), session).save(path)
fit = FitRecord.load(path)
print(fit_text(fit))

# %% [markdown]
# How to read it:
#
# - **fit** and its interval: the interval is what counts. It holds what the data leave open and what was assumed of
#   masses, damping, offsets and the sensor.
# - **learned**: the share of the doubt before the session that the data removed. Far below 100 % the prior speaks.
# - **refused**: the interval spans more than a factor of four. There is no number, only these bounds, or one.
# - **the paper**: two slopes divided at one instant. Its interval states the scatter of its contacts and not its bias.
# - **chi2**: near one, noise and repetitions are as assumed; far above, the model misses something and intervals are
#   too narrow.
# - Lines that begin with **warning**: a fit that did not converge, contacts without catch trials, a mass or an offset
#   far from what is plausible (then the model is wrong, not the subject).
#
# The truth, which you will not have:

# %%
for name, true, low, high in zip(fit.joint_names, truth.values(), fit.lower, fit.upper, strict=True):
    print(f"{name:6s} {true:.2f} rad/Nm is {'inside' if low <= true <= high else 'outside'} [{low:.3g}, {high:.3g}]")
view.plot_fit_compliance(fit, truth)

# %% [markdown]
# `check_fit` (`icjax check fit.nc`) looks at a stored fit: does it agree with itself, and is anything unlikely in it?

# %%
print(*check_fit(fit), sep="\n")

# %% [markdown]
# ## Does it explain what happened?
#
# How far each contact pushed each joint from where it was going: dots as measured, line as the fit predicts it, band
# what 95 % of movements would leave open. In every row the contacts with the strongest, the middle and the weakest
# torque (above each picture: trial, time, torque).

# %%
view.plot_fit_response(fit)

# %% [markdown]
# Wrist and MP: the band leaves zero behind, so even one contact tells that the joint gave way, and how far. PIP and
# DIP: zero stays within the band; what is known of them comes from all contacts together, and is little. Two of the
# wrist's contacts end just past the band, one on either side. Dots that leave it on the same side in many contacts
# would say that the model is wrong.
#
# ## Where the joints would have gone
#
# The reference trajectory: the measured angle less the fitted push, with its 95 % band. `fit.windows.reference` and
# `reference_sd` hold it for every contact (`contact_free` computes it).

# %%
view.plot_fit_reference(fit, ["wrist", "MP"])

# %% [markdown]
# Compliance and reference trade off: a softer joint with a reference farther away fits nearly as well. How nearly:

# %%
for name, trade in zip(fit.joint_names, np.nanmedian(fit.windows.correlation, axis=0), strict=True):
    print(f"{name:6s} correlation of log C with the reference {trade:+.2f} (median over contacts)")

# %% [markdown]
# ## A refused joint
#
# Whoever needs numbers to a factor of two asks for them. The reason says what the contacts did to the joint and what is
# missing:

# %%
for joint in fit_session(session, FitOptions(widest=2.0)).joints:
    if joint.refused:
        print(textwrap.fill(f"{joint.name}: {joint.refused}", 110))

# %% [markdown]
# In this order:
#
# 1. Without catch trials: record them.
# 2. Contacts that load the joint: forces that pass far from its axis, another posture, a faster touch.
#    [](design_an_experiment.py) ranks them before anybody comes.
# 3. More of the same contacts, if the number asked for is one that a subject can bear.
# 4. Report the bounds. A `widest` above four gives a number, not knowledge.
#
# ## Your own files
#
# ```python
# session = capture(read_session("monday/session.toml"))
# session.save("monday/recording.nc")
# fit = fit_record(fit_session(session), session)
# fit.save("monday/fit.nc")
# print(fit_text(fit))
# ```
#
# or the same without Python, and all figures of this page in one HTML file:
#
#     icjax check monday/session.toml
#     icjax fit monday/session.toml --out monday/run
#     icjax report monday/run
#
# [](first_session.md) begins with the shortest session file that works, [](fitting.md) explains the options of the
# fit.
