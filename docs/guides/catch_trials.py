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
# # What catch trials buy
#
# A joint gives way when the finger touches something. It also brakes because the person planned to, and both look
# alike. A catch trial, the same movement with the surface taken away, tells them apart. Here one session is fitted
# with two catch trials for every trial, with one, and with none. It comes from the virtual finger studio: a simulated
# subject (MuJoCo; no code in common with the fit) whose true compliance is known. No person was measured.

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
from icjax.fit import FitRecord, fit_record, fit_session
from icjax.laboratory import load_truth, record
from icjax.recording import Session

truth = {"wrist": 0.25, "MP": 0.70, "PIP": 0.45, "DIP": 1.10}  # rad/Nm
folder = Path(os.environ.get("ICJAX_GUIDES", tempfile.gettempdir())) / "finger_11"  # kept: recording takes a while
if not (folder / "recording.nc").is_file():
    record(folder, seed=11, trials=4, contacts=3, catch=2, compliance=tuple(truth.values()))
    capture(read_session(folder / "session.toml")).save(folder / "recording.nc")
session = Session.load(folder / "recording.nc")
print(len(session.trials()), "trials,", len(session.recordings) - len(session.trials()), "catch trials")

# %% [markdown]
# ## The same contacts, fewer catch trials


# %%
def with_catch(count):
    """The session with `count` catch trials of every trial."""
    kept = [item for trial in session.trials() for item in session.catch_trials(trial.name)[:count]]
    return dataclasses.replace(session, recordings=(*session.trials(), *kept))


def fitted(count, paper=None):
    path = folder / f"fit_catch_{count}.nc"
    if not path.is_file():
        part = with_catch(count)
        fit_record(fit_session(part), part, paper).save(path)
    return FitRecord.load(path)


two = fitted(2)

# %%
paper = two.paper  # the paper's estimate needs no catch trials: it is the same for all
fits = {"two catch trials": two, "one": fitted(1, paper), "none": fitted(0, paper)}

print(f"{'rad/Nm':6s} {'truth':>6s}   " + "".join(f"{name:22s}" for name in (*fits, "the paper's estimate")))
for i, joint in enumerate(truth):
    cells = [
        f"{'refused' if fit.refused[i] else f'{fit.compliance[i]:.2f}':8s}[{fit.lower[i]:.2f}, {fit.upper[i]:.2f}]"
        for fit in fits.values()
    ]
    cells.append(f"{paper.compliance[i]:<8.2f}[{paper.lower[i]:.2f}, {paper.upper[i]:.2f}]")
    print(f"{joint:6s} {truth[joint]:6.2f}   " + "".join(f"{cell:22s}" for cell in cells))

# %% [markdown]
# A joint whose interval (95 %) spans more than a factor of four is *refused*: it has bounds and no number. The rule
# never looks at the truth. Widths below are the largest value of an interval over its smallest.

# %%
for name, fit in fits.items():
    inside = [bool(fit.lower[i] <= truth[joint] <= fit.upper[i]) for i, joint in enumerate(truth)]
    print(
        f"{name:17s} widths {', '.join(f'{joint} {fit.width[i]:.2f}' for i, joint in enumerate(truth))}; "
        f"numbers for {fit.refused.count('')} of 4 joints; truth inside {sum(inside)} of 4 intervals"
    )
inside = [bool(paper.lower[i] <= truth[joint] <= paper.upper[i]) for i, joint in enumerate(truth)]
print(
    f"the paper's estimate: truth inside {sum(inside)} of 4 intervals, "
    f"{int(np.sum(np.asarray(paper.lower) <= 0))} of which begin at zero"
)
print(
    "estimate over truth:",
    ", ".join(f"{joint} {paper.compliance[i] / truth[joint]:.2f}" for i, joint in enumerate(truth)),
)

# %%
figure, axis = plt.subplots(figsize=(7.4, 3.6), layout="constrained")
colours = {"two catch trials": "#3F8FC4", "one": "#9CD0F0", "none": "#E8A37C"}
for i, joint in enumerate(truth):
    for place, (name, fit) in zip((0.27, 0.09, -0.09), fits.items(), strict=True):
        label = name if i == 0 else None
        ends = np.clip([fit.lower[i], fit.upper[i]], 0.04, 8.0)  # the panel's borders where there is none
        axis.plot(ends, [place - i] * 2, color=colours[name], lw=3, label=label)
        if not fit.refused[i]:
            axis.plot(fit.compliance[i], place - i, "o", color=colours[name], ms=7)
    low = max(float(paper.lower[i]), 0.04)
    axis.plot([low, paper.upper[i]], [-0.27 - i] * 2, color="0.6", lw=3, label=None if i else "the paper's estimate")
    axis.plot(paper.compliance[i], -0.27 - i, "s", color="0.4", ms=5)
    axis.plot([truth[joint]] * 2, [-0.4 - i, 0.4 - i], color="k", lw=1.2, label=None if i else "truth")
axis.set(xscale="log", xlim=(0.04, 8), yticks=-np.arange(4), yticklabels=truth, xlabel="compliance (rad/Nm)")
axis.set_xticks([0.05, 0.1, 0.2, 0.5, 1, 2, 5])
axis.xaxis.set_major_formatter("{x:g}")
_ = figure.legend(loc="outside upper center", ncols=5, frameon=False)

# %% [markdown]
# Bars are 95 % intervals; a bar without a dot is a refused joint. What this session shows:
#
# - The first catch trial does nearly all of the work. The second narrows every interval a little, which here is just
#   what DIP needs to get a number; PIP misses one by a hair.
# - Without any, only MP keeps a number, within a factor of two, which one catch trial tells within a quarter. The
#   others get bounds; of the wrist a factor of 6.5, where one catch trial leaves less than a third.
# - PIP and DIP keep wide intervals however many there are. These contacts hardly load them; other contacts would help
#   ([](design_an_experiment.py)).
# - The paper's estimator needs no catch trials. Its numbers are off by the factors printed above: right at PIP, a
#   seventh of the truth at DIP. Its intervals state how its contacts scatter and nothing of that bias; here they are
#   wide enough to hold the truth all the same, MP's just so.
#
# No interval misses here. One session says little about how often they do; `experiments/inverse_problems/coverage.py`
# counts it over many.
#
# ## Why
#
# The fit needs to know where each joint would have gone without the contact. How well it does is in the record
# (`drift_sd`). Below, the bands hold 95 % of the ways in which the movement may go on by itself, given all before the
# contact; the black line is how far the contact really pushed the joint away, known only because the subject is
# simulated. One contact cannot tell a push within the band from a plan.

# %%
windows = fits["none"].windows
torque = np.nanmax(np.abs(windows.torque[:, :, 1]), axis=1)
number = int(np.argsort(torque)[len(torque) // 2])  # the contact with the middle torque about MP
trial, onset = windows.trial[number], windows.onset[number]
known = load_truth(folder / "truth" / f"{trial}.npz")
figure, axes = plt.subplots(1, 4, figsize=(9, 2.7), layout="constrained", sharex=True)
for i, (axis, joint) in enumerate(zip(axes, truth, strict=True)):
    for name in ("none", "one", "two catch trials"):
        rows = fits[name].windows
        kept = rows.time[number] >= onset - 0.04
        spread = 1.96 * np.degrees(rows.drift_sd[number, kept, i])
        time = 1e3 * (rows.time[number, kept] - onset)
        axis.fill_between(time, -spread, spread, color=colours[name], lw=0, label=name)
    pushed = (known.t >= onset - 0.04) & (known.t <= onset + 0.1)
    away = np.degrees(known.theta - known.theta_free)[pushed, i]
    axis.plot(1e3 * (known.t[pushed] - onset), away, color="k", label="pushed away by the contact")
    axis.set(title=joint, xlabel="ms after contact")
axes[0].set_ylabel("degrees")
handles, labels = axes[0].get_legend_handles_labels()
_ = figure.legend(handles, labels, loc="outside upper center", ncols=4, frameon=False)

# %%
print("without contact the joint would be, 0.1 s later, within (degrees, 95 %, median over contacts)")
for name, fit in fits.items():
    last = [np.flatnonzero(np.isfinite(row))[-1] for row in fit.windows.time]
    doubt = 1.96 * np.degrees([fit.windows.drift_sd[n, at] for n, at in enumerate(last)])
    print(f"{name:17s}", ", ".join(f"{joint} {np.median(doubt[:, i]):.2f}" for i, joint in enumerate(truth)))

# %% [markdown]
# Without catch trials MP alone is pushed out of its band, and only for some 50 ms: it is pushed fast, and plans change
# slowly. Twelve contacts average out what differs between them. They do not average out what all have in common: a
# person who brakes at every touch does so every time, harder where the movement is faster, and so where the contact
# pushes harder. That looks exactly like compliance. Without catch trials the fit therefore also leaves open a plan that
# all contacts share, in proportion to velocity and torque, and more contacts do not narrow that. Catch
# trials see it directly.
#
# ## What to do
#
# - Record at least one catch trial for every trial, better two; beyond that, other contacts tell more
#   ([](design_an_experiment.py)).
# - The subject must not know that the surface is gone: mix catch trials among the others.
# - Without any: the fit still runs and says that they are missing. Report bounds, not numbers.
