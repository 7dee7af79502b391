"""Why the estimate of section 3.3 of Kry and Pai (2006) is biased: its causes removed one after the other.

    python experiments/kry_pai_2006/bias.py

Three sessions of simulated subjects whose truth is known (MuJoCo, independent of icjax; no person was measured). The
estimator is the one of icjax throughout; what it is given changes. With e = theta - theta_free, the deviation from
the same run without contact, the subject obeys  M e'' + B e' + K e = tau  (up to gravity and Coriolis terms):

1. *as captured*: joint angles from markers, torque from the measured force;
2. *perfect data*: true angles, torque and onsets. What is left is the method's;
3. *true reference*: e instead of theta, so nothing has to be extrapolated. Removes the planned deceleration;
4. *without inertia*: tau - M e'' instead of tau, M from the simulated hand;
5. *without damping*: tau - M e'' - B e', which is K e within 3 %. What is left is that the estimator fits angle and
   torque differently: the angle with its value at contact free and shared by both windows, the torque through zero.
   Two polynomials of low degree then miss a curved course differently, although one is a multiple of the other;
6. *one fit for both*: the same numbers, but the angle before contact extrapolated and taken off, and the rest fitted
   through zero exactly as the torque is. Nothing but gravity and Coriolis is left.

The last fit is also tried on what the program has: *as captured, one fit for both*.

Writes bias.json and bias.png: median over the events of estimate / truth - 1, by joint, window and degree.
"""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import equinox as eqx
import jax
import mujoco
import numpy as np
import tyro
from virtual_sessions import JOINTS, RESULTS, SIMULATED, shared_data, trials_of, true_compliance, truth_of, write

from icjax.estimation import EstimationOptions, compliance_at_contact, joint_torque
from icjax.recording import Recording

STAGES = ("as captured", "perfect data", "true reference", "without inertia", "without damping", "one fit for both")
CAPTURED = "as captured, one fit for both"
REST = "rest of the equation of motion over torque, RMS in the first 100 ms"
COLOURS = ("#8A8F98", "#0072B2", "#E69F00", "#D55E00", "#CC79A7", "#009E73")


@dataclasses.dataclass(frozen=True)
class Config:
    """Sessions and choices of the estimator."""

    sessions: tuple[str, ...] = ("explore", "scratch", "explore_cruise")
    windows: tuple[float, ...] = (0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.11, 0.12)
    degrees: tuple[int, ...] = (1, 2)
    drawn: tuple[str, ...] = ("explore", "scratch")
    cache: Path | None = None
    """Folder that keeps the captured sessions."""
    out: Path = RESULTS


def main(config: Config) -> dict:
    """Capture, take the causes away, estimate, draw."""
    jax.config.update("jax_enable_x64", True)
    result = {"data": SIMULATED, "measure": "median over events of estimate / truth - 1", "stages": list(STAGES)}
    curves = {}
    for name in config.sessions:
        trials = trials_of(name, config.cache)
        stages, balance = stages_of(name, trials)
        truth = true_compliance(name)
        errors = {stage: errors_of(*stages[stage], truth, config) for stage in STAGES[:-1]}
        errors[STAGES[-1]] = errors_of(*stages["without damping"], truth, config, one_fit)
        errors[CAPTURED] = errors_of(*stages["as captured"], truth, config, one_fit)
        curves[name] = {stage: errors[stage]["median"] for stage in STAGES}
        result[name] = {
            "true compliance rad/Nm": dict(zip(JOINTS, truth, strict=True)),
            "events": sum(len(np.asarray(item.events.onset)) for item in stages["perfect data"][0]),
            "windows s": list(config.windows),
            "degrees": list(config.degrees),
            REST: dict(zip(JOINTS, balance, strict=True)),
            "error by stage, joint, [window][degree]": {
                stage: {joint: errors[stage]["median"][j] for j, joint in enumerate(JOINTS)} for stage in errors
            },
            "quarters of the events at 100 ms, quadratic": {
                stage: {joint: errors[stage]["quarters"][j] for j, joint in enumerate(JOINTS)} for stage in errors
            },
        }
    write(config.out / "bias.json", result)
    draw(config.out / "bias.png", curves, config)
    return result


def stages_of(name: str, trials: tuple[Recording, ...]) -> tuple[dict, np.ndarray]:
    """Recordings and torques of every stage, and how well the equation of motion closes (a joint each)."""
    hand = Hand(shared_data() / "virtual_sessions" / name / "simulated_subject_TRUTH.xml")
    stages = {stage: ([], []) for stage in STAGES[:-1]}
    rest, load = np.zeros(4), np.zeros(4)
    for recording in trials:
        truth = truth_of(name, recording.name)
        step = float(truth["t"][1] - truth["t"][0])
        deviation = truth["theta"] - truth["theta_free"]
        rate = np.gradient(deviation, step, axis=0)
        change = second_derivative(deviation, step)
        inertia = np.einsum("tij,tj->ti", hand.mass_matrices(truth["theta"]), change)
        spring = truth["tau"] - inertia
        free = spring - truth["B"] * rate
        onsets, releases = true_contacts(truth)
        for stage, angle, torque in (
            ("perfect data", truth["theta"], truth["tau"]),
            ("true reference", deviation, truth["tau"]),
            ("without inertia", deviation, spring),
            ("without damping", deviation, free),
        ):
            made, full = with_truth(recording, truth["t"], angle, torque, onsets, releases)
            stages[stage][0].append(made)
            stages[stage][1].append(full)
        stages["as captured"][0].append(recording)
        stages["as captured"][1].append(np.asarray(joint_torque(recording)))
        for onset in onsets:
            after = (truth["t"] > onset) & (truth["t"] <= onset + 0.1)
            rest += np.sum((free - deviation / truth["C"])[after] ** 2, axis=0)
            load += np.sum(truth["tau"][after] ** 2, axis=0)
    return {stage: (tuple(made), tuple(full)) for stage, (made, full) in stages.items()}, np.sqrt(rest / load)


class Hand:
    """Mass matrix of the simulated hand in its four joints, the forearm held."""

    def __init__(self, path: Path):
        self.model = mujoco.MjModel.from_xml_path(str(path))
        self.data = mujoco.MjData(self.model)
        ids = [mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_JOINT, joint) for joint in JOINTS]
        self.coordinates = [int(self.model.jnt_qposadr[i]) for i in ids]
        self.dofs = [int(self.model.jnt_dofadr[i]) for i in ids]

    def mass_matrices(self, theta: np.ndarray) -> np.ndarray:
        """`[time, 4, 4]`, kg m2."""
        full = np.zeros((self.model.nv, self.model.nv))
        result = np.zeros((len(theta), 4, 4))
        for row, angles in enumerate(theta):
            self.data.qpos[self.coordinates] = angles
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_crb(self.model, self.data)
            mujoco.mj_fullM(self.model, self.data, full)
            result[row] = full[np.ix_(self.dofs, self.dofs)]
        return result


def second_derivative(values: np.ndarray, step: float) -> np.ndarray:
    """Central difference; zero at the ends, where nothing touches."""
    result = np.zeros_like(values)
    result[1:-1] = (values[2:] - 2.0 * values[1:-1] + values[:-2]) / step**2
    return result


def true_contacts(truth: dict[str, np.ndarray], chatter: float = 0.025) -> tuple[np.ndarray, np.ndarray]:
    """First and last samples with a contact force; contacts closer than `chatter` (s) are one."""
    touching = np.linalg.norm(truth["f_contact"], axis=1) > 0
    edges = np.diff(np.concatenate([[0], touching.astype(int), [0]]))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    apart = (starts[1:] - stops[:-1]) * 0.002 >= chatter
    first, last = np.concatenate([[True], apart]), np.concatenate([apart, [True]])
    # The force was zero one sample before its first sample: the polynomials start there.
    return truth["t"][starts[first] - 1], truth["t"][np.minimum(stops[last], len(touching) - 1)]


def with_truth(
    recording: Recording,
    time: np.ndarray,
    angle: np.ndarray,
    torque: np.ndarray,
    onsets: np.ndarray,
    releases: np.ndarray,
) -> tuple[Recording, np.ndarray]:
    """The recording with other angles and events, without noise, and torques of all degrees of freedom."""
    model, count = recording.model, len(recording.time)
    at = np.asarray(recording.time)
    q, full = np.array(recording.q), np.zeros((count, model.nv))
    for j, joint in enumerate(JOINTS):
        q[:, model.coordinate_slices[model.joint(joint)].start] = np.interp(at, time, angle[:, j])
        full[:, model.dof_names.index(joint)] = np.interp(at, time, torque[:, j])
    events = eqx.tree_at(
        lambda item: (item.onset, item.release, item.contact),
        recording.events,
        (onsets, releases, np.zeros(len(onsets), np.int32)),
    )
    made = eqx.tree_at(
        lambda item: (item.q, item.q_covariance, item.valid, item.events),
        recording,
        (q, np.zeros_like(recording.q_covariance), np.ones(count, bool), events),
    )
    return made, full


def program(trials: tuple, torques: tuple, options: EstimationOptions) -> np.ndarray:
    """Estimates of icjax `[event, joint]`."""
    return np.asarray(compliance_at_contact(trials, options, torques).compliance)


def one_fit(trials: tuple, torques: tuple, options: EstimationOptions) -> np.ndarray:
    """The same events `[event, joint]`, where the program has an estimate: one linear operation on angle and torque.

    The polynomial before contact is extrapolated and taken off; what is left, and the torque, are fitted through
    zero at contact. Both being the same least squares, `angle = C torque` gives C whatever the course.
    """
    result = program(trials, torques, options)
    row = 0
    for recording, torque in zip(trials, torques, strict=True):
        for onset in np.asarray(recording.events.onset):
            s = np.asarray(recording.time) - float(onset)
            before, after = (s <= 0) & (s >= -options.window_before), (s > 0) & (s <= options.window_after)
            for j, joint in enumerate(JOINTS):
                if not np.isfinite(result[row, j]):
                    continue
                model = recording.model
                angle = np.asarray(recording.q)[:, model.coordinate_slices[model.joint(joint)].start]
                tau = torque[:, model.dof_names.index(joint)]
                known = np.isfinite(angle) & np.isfinite(tau)
                past = np.polynomial.Polynomial.fit(s[before & known], angle[before & known], options.degree)
                used = after & known
                powers = s[used, None] ** np.arange(1, options.degree + 1)
                both = np.stack([angle[used] - past(s[used]), tau[used]], axis=1)
                slopes = np.linalg.lstsq(powers, both, rcond=None)[0][0]
                result[row, j] = slopes[0] / slopes[1]
            row += 1
    return result


def errors_of(trials: tuple, torques: tuple, truth: np.ndarray, config: Config, estimator: Callable = program) -> dict:
    """Median relative error `[joint, window, degree]` and the quarters `[joint, 2]` at 100 ms, quadratic."""
    table = np.full((4, len(config.windows), len(config.degrees)), np.nan)
    quarters = np.full((4, 2), np.nan)
    for w, window in enumerate(config.windows):
        for d, degree in enumerate(config.degrees):
            options = EstimationOptions(window_before=window, window_after=window, degree=degree, joints=JOINTS)
            error = estimator(trials, torques, options) / truth - 1.0
            known = np.isfinite(error).sum(axis=0) >= 0.5 * len(error)
            table[known, w, d] = np.nanmedian(error[:, known], axis=0)
            if (round(window, 3), degree) == (0.1, 2):
                quarters[known] = np.nanquantile(error[:, known], [0.25, 0.75], axis=0).T
    return {"median": table, "quarters": quarters}


def draw(path: Path, curves: dict, config: Config) -> None:
    """A row a session and degree, a column a joint, a line a stage."""
    from icjax.view._style import new_figure, style

    with style():
        rows = [(name, d) for name in config.drawn for d in range(len(config.degrees))]
        figure = new_figure(11.0, 1.0 + 1.75 * len(rows))
        axes = figure.subplots(len(rows), 4, sharex=True, sharey=True, squeeze=False)
        for (name, d), line in zip(rows, axes, strict=True):
            for j, axis in enumerate(line):
                axis.axhline(0.0, color="#1F2430", lw=0.8)
                for stage, colour in zip(STAGES, COLOURS, strict=True):
                    width = 2.0 if stage == STAGES[-1] else 1.3
                    axis.plot(
                        1e3 * np.asarray(config.windows), 100 * curves[name][stage][j, :, d], color=colour, lw=width,
                        label=stage,
                    )  # fmt: skip
                axis.set_yscale("symlog", linthresh=50)
                axis.set_ylim(-1000, 1000)
                axis.set_yticks([-500, -100, -50, 0, 50, 100, 500], ["−500", "−100", "−50", "0", "50", "100", "500"])
                if (name, d) == rows[0]:
                    axis.set_title(JOINTS[j])
            line[0].set_ylabel(f"{name}\n{('linear', 'quadratic')[config.degrees[d] - 1]}\nerror (%)")
        for axis in axes[-1]:
            axis.set_xlabel("window before and after (ms)")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=6)
        figure.supxlabel(f"Median over events. Data {SIMULATED}.", fontsize=7.5, color="#5B616B")
        figure.savefig(path, dpi=110)


if __name__ == "__main__":
    found = main(tyro.cli(Config))
    for name in [key for key in found if isinstance(found[key], dict)]:
        print(name, found[name][REST])
