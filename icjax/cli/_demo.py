"""`icjax demo`: the main job from end to end, on a session that a virtual studio records on the spot."""

import json
import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from icjax.interaction import Interaction
    from icjax.laboratory import Bump
    from icjax.synthesis import Scene

TRIAL = "trial00"
SLIPPERY = 0.2

ASIDE = 0.08
"""How far from the stroke the bump lies that the finger should not meet, m."""


@dataclass(frozen=True)
class Demo:
    """Record a virtual session, capture, estimate, transfer to flat, bump and a slippery plate, and report.

    The virtual subject is a dynamic finger (MuJoCo) that shares no code with the estimators or the simulation,
    so the metrics compare with independent truth.
    """

    out: Path = Path("icjax-demo")
    """Folder for the files."""
    seed: int = 0
    """Seed of the virtual session."""
    trials: int = 2
    """Trials to record, each with a catch trial."""
    contacts: int = 3
    """Contacts in each trial, taps and strokes in turn."""

    def run(self) -> None:
        from icjax.cli._estimate import summary_text
        from icjax.cli._helper import helper, import_drawing
        from icjax.cli._main import configure_jax

        start = time.perf_counter()
        with helper(import_drawing) as executor:
            configure_jax()
            interaction, metrics, page = self._main_job(executor)
        print(summary_text(interaction))
        true = {joint: figures["true_compliance"] for joint, figures in metrics["estimate"].items()}
        print("true:        " + ", ".join(f"{joint} {value:.3f}" for joint, value in true.items()))
        for name, figures in metrics["transfer"].items():
            print(
                f"transfer to {name:8s}: normal force NRMSE {figures['normal_force_nrmse']:.0%} against the virtual "
                f"subject on that surface, fingertip path {1e3 * figures['fingertip_rms_m']:.2f} mm RMS"
            )
        print(f"wrote {page} ({time.perf_counter() - start:.0f} s); open it in a browser")

    def _main_job(self, executor: "Executor | None") -> "tuple[Interaction, dict, Path]":
        from icjax.capture import capture, read_session
        from icjax.cli._judge import judge_capture, judge_estimate, judge_transfer
        from icjax.cli._output import Steps
        from icjax.estimation import estimate
        from icjax.files import save_record
        from icjax.laboratory import bump_under, load_truth, record, replay
        from icjax.report import Report
        from icjax.running import Later
        from icjax.synthesis import transfer

        steps = Steps(6)
        report = Report(executor)
        studio = self.out / "studio"
        metrics: dict[str, Any] = {"seed": self.seed, "data": "simulated (virtual capture studio, MuJoCo)"}
        with steps.step("record a virtual session") as progress:
            record(studio, seed=self.seed, trials=self.trials, contacts=self.contacts, progress=progress)
        bump = bump_under(studio, TRIAL)
        replays = {
            "bump": Later(executor, replay, studio, TRIAL, bump=bump),
            "slippery": Later(executor, replay, studio, TRIAL, friction=SLIPPERY),
        }
        with steps.step("markers to joint angles, forces and contact events") as progress:
            session = capture(read_session(studio / "session.toml"), progress=progress)
            saved = [Later(executor, save_record, self.out / "recording.nc", session)]
        with steps.step("compliance at contact and reference trajectory") as progress:
            interactions = estimate(session, progress=progress)
            interaction = next(item for item in interactions if item.name == TRIAL)
            saved.append(Later(executor, save_record, self.out / "interaction.nc", interaction))
        truth = {"flat": load_truth(studio / "truth" / f"{TRIAL}.npz")}
        metrics["capture"] = judge_capture(session, studio / "truth")
        metrics["estimate"] = judge_estimate(interaction, truth["flat"])
        report.measured(session, interactions, metrics)
        scenes = _scenes(bump, float(interaction.friction or 0.0))
        rollouts = {}
        with steps.step("transfer to a flat plate, a bump and a slippery plate") as progress:
            for done, (name, scene) in enumerate(scenes.items()):
                rollouts[name] = transfer(
                    interaction, scene, progress=lambda part, done=done: progress((done + part) / len(scenes))
                )
                rollouts[name].save(self.out / f"rollout_{name}.nc")
                report.transferred(rollouts[name])
        with steps.step("compare with the virtual subject on the same surfaces") as progress:
            truth |= {name: later.result() for name, later in replays.items()}
            metrics["transfer"] = {name: judge_transfer(rollouts[name], truth[name]) for name in scenes}
            progress(1.0)
            metrics["seconds"] = {title: round(value, 2) for title, value in steps.seconds.items()}
            (self.out / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
        with steps.step("report"):
            for later in saved:
                later.result()
            page = report.write(self.out / "report.html", metrics=metrics, seed=self.seed, simulated=True)
        return interaction, metrics, page


def _scenes(bump: "Bump", friction: float) -> "dict[str, Scene]":
    """One plate with a bump that is set aside where the finger should not meet it: one form, one compiled step."""
    from icjax.cli._scenes import plate_scene

    x, y = bump.centre[:2]
    return {
        name: plate_scene(name, friction=mu, bump_centre=(x, y + aside), bump_radii=bump.radii)
        for name, mu, aside in (("flat", friction, ASIDE), ("bump", friction, 0.0), ("slippery", SLIPPERY, ASIDE))
    }
