"""`icjax demo`: the main job from end to end, on a session that a virtual studio records on the spot."""

import json
import time
from dataclasses import dataclass
from pathlib import Path

TRIAL = "trial00"
SLIPPERY = 0.2


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
        from icjax.capture import capture, read_session
        from icjax.cli._estimate import summary_text
        from icjax.cli._judge import judge_capture, judge_estimate, judge_transfer
        from icjax.cli._output import Steps
        from icjax.cli._scenes import plate_scene
        from icjax.estimation import estimate
        from icjax.laboratory import bump_under, load_truth, record, replay
        from icjax.report import write_report
        from icjax.synthesis import transfer

        start = time.perf_counter()
        steps = Steps(6)
        studio = self.out / "studio"
        with steps.step("record a virtual session") as progress:
            record(studio, seed=self.seed, trials=self.trials, contacts=self.contacts, progress=progress)
        with steps.step("markers to joint angles, forces and contact events") as progress:
            session = capture(read_session(studio / "session.toml"), progress=progress)
            session.save(self.out / "recording.nc")
        with steps.step("compliance at contact and reference trajectory") as progress:
            interaction = next(item for item in estimate(session, progress=progress) if item.name == TRIAL)
            interaction.save(self.out / "interaction.nc")
        bump = bump_under(studio, TRIAL)
        recorded = float(interaction.friction or 0.0)
        scenes = {
            "flat": plate_scene("flat", friction=recorded),
            "bump": plate_scene("bump", friction=recorded, bump_centre=bump.centre[:2], bump_radii=bump.radii),
            "slippery": plate_scene("slippery", friction=SLIPPERY),
        }
        rollouts = {}
        with steps.step("transfer to a flat plate, a bump and a slippery plate") as progress:
            for done, (name, scene) in enumerate(scenes.items()):
                rollouts[name] = transfer(
                    interaction, scene, progress=lambda part, done=done: progress((done + part) / len(scenes))
                )
                rollouts[name].save(self.out / f"rollout_{name}.nc")
        with steps.step("compare with the virtual subject on the same surfaces") as progress:
            truth = {
                "flat": load_truth(studio / "truth" / f"{TRIAL}.npz"),
                "bump": replay(studio, TRIAL, bump=bump),
                "slippery": replay(studio, TRIAL, friction=SLIPPERY),
            }
            metrics = {
                "seed": self.seed,
                "data": "simulated (virtual capture studio, MuJoCo)",
                "capture": judge_capture(session, studio / "truth"),
                "estimate": judge_estimate(interaction, truth["flat"]),
                "transfer": {name: judge_transfer(rollouts[name], truth[name]) for name in scenes},
            }
            progress(1.0)
            metrics["seconds"] = {title: round(value, 2) for title, value in steps.seconds.items()}
            (self.out / "metrics.json").write_text(json.dumps(metrics, indent=1) + "\n")
        with steps.step("report"):
            page = write_report(
                self.out / "report.html",
                session=session,
                interactions=(interaction,),
                rollouts=tuple(rollouts.values()),
                metrics=metrics,
                seed=self.seed,
                simulated=True,
            )
        print(summary_text(interaction))
        true = {joint: figures["true_compliance"] for joint, figures in metrics["estimate"].items()}
        print("true:        " + ", ".join(f"{joint} {value:.3f}" for joint, value in true.items()))
        for name, figures in metrics["transfer"].items():
            print(
                f"transfer to {name:8s}: normal force NRMSE {figures['normal_force_nrmse']:.0%} against the virtual "
                f"subject on that surface, fingertip path {1e3 * figures['fingertip_rms_m']:.2f} mm RMS"
            )
        print(f"wrote {page} ({time.perf_counter() - start:.0f} s); open it in a browser")
