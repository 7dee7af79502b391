"""`icjax transfer`: an interaction to another surface or friction."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

LARGEST_BUMP = 0.2
"""m; a larger one was meant in mm. A scene file takes any."""

LONGEST_STEP = 0.02
"""s; ten times the usual step."""


PolicyName = Literal["none", "tighten", "adjust"]


@dataclass(frozen=True)
class Transfer:
    """Simulate the interaction on another surface; write a rollout.

    Give a scene file (surfaces and free objects), or a flat surface with or without a bump under the measured contacts.
    """

    interaction: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="INTERACTION.NC")]
    """Interaction written by `icjax estimate`."""
    out: Path | None = None
    """Rollout file; rollout_<surface>.nc beside the interaction if not given."""
    scene: Path | None = None
    """Scene file (TOML) instead of the options below."""
    surface: Literal["flat", "bump"] = "flat"
    """Surface to touch."""
    friction: float | None = None
    """Coefficient of friction; that of the recording if not given."""
    plate_height: float | None = None
    """Height of the flat surface in the recording's world, m; that of the measured contact points if not given."""
    bump_height: float = 0.003
    """Height of the bump, m."""
    bump_length: float = 0.024
    """Length of the bump along the world's x axis, m."""
    bump_position: tuple[float, float] | None = None
    """Centre of the bump, world x and y, m; the middle of the measured contact points if not given."""
    step: float = 0.002
    """Time step, s, at most 0.02."""
    policy: PolicyName = "none"
    """What the hand changes on the way: tighten 100 ms after an object slipped, or adjust before it slips."""

    def run(self) -> None:
        import numpy as np

        from icjax.cli._output import Steps
        from icjax.interaction import Interaction
        from icjax.synthesis import MOST_FAILED, check_rollout, transfer

        interaction = Interaction.load(self.interaction)
        if self.scene:
            self._refuse_surface_options()
            scene = read_fitting_scene(self.scene, interaction)
        else:
            self._refuse_bump_options()
            scene = self._scene(interaction)
        if scene.step > LONGEST_STEP:
            raise ValueError(f"step {scene.step:g} s is longer than {LONGEST_STEP} s; a contact would be stepped over")
        with Steps(1).step(f"transfer of {interaction.name} to {scene.name}") as progress:
            rollout = transfer(interaction, scene, progress=progress, policy=policy_of(self.policy))
        failed = float(np.mean(np.asarray(rollout.status) != 0))
        if failed > MOST_FAILED:
            raise ValueError(f"{failed:.0%} of the steps to {scene.name} could not be solved; nothing was written")
        path = self.out or self.interaction.parent / f"rollout_{scene.name}.nc"
        rollout.save(path)
        print(rollout_text(rollout))
        if scene.name == "flat" and self.friction is None and self.plate_height is None:
            print(f"  normal force NRMSE against the measured force: {_deviation(interaction, rollout):.0%}")
        for line in check_rollout(rollout):
            if line.startswith(("suspicious: ", "error: ")):
                print(line)
        print(f"wrote {path}")

    def _scene(self, interaction):
        from icjax.cli._scenes import BUMP_HALF_WIDTH, middle_of_contacts, plate_scene

        if not interaction.model.pad_names:
            raise ValueError(
                f"model {interaction.model.name!r} has no contact pads, so nothing of it can touch a surface"
            )
        friction = self.friction if self.friction is not None else interaction.friction
        if friction is None:
            raise ValueError("--friction is needed: the recording does not state the friction of its surface")
        centre, height = self.bump_position, self.plate_height
        if height is None or (self.surface == "bump" and centre is None):
            x, y, z = middle_of_contacts(interaction)
            height = z if height is None else height
            centre = centre or (x, y)
        return plate_scene(
            self.surface,
            friction=friction,
            height=height,
            bump_centre=centre if self.surface == "bump" else None,
            bump_radii=(self.bump_length / 2, BUMP_HALF_WIDTH, self.bump_height),
            step=self.step,
        )

    def _refuse_bump_options(self) -> None:
        for field in dataclasses.fields(self):
            given = field.name.startswith("bump_") and getattr(self, field.name) != field.default
            if given and self.surface != "bump":
                raise ValueError(f"--{field.name.replace('_', '-')} needs --surface bump")
        for name in ("bump_height", "bump_length"):
            if not 0 < getattr(self, name) <= LARGEST_BUMP:
                option = name.replace("_", "-")
                raise ValueError(
                    f"--{option} is {getattr(self, name):g} m; it must be above 0 and at most {LARGEST_BUMP} m"
                )

    def _refuse_surface_options(self) -> None:
        for field in dataclasses.fields(self):
            given = getattr(self, field.name) != field.default
            if given and field.name not in ("interaction", "out", "scene", "policy"):
                raise ValueError(f"--{field.name.replace('_', '-')} cannot be given with --scene, which states it")


def policy_of(name: PolicyName):
    """With its default numbers; None for none."""
    from icjax.synthesis import GripTightening, ImminentSlip

    return {"none": None, "tighten": GripTightening(), "adjust": ImminentSlip()}[name]


def read_fitting_scene(path: Path, interaction):
    """A scene file, which must suit the pads of the interaction's model."""
    from icjax.files import FileError
    from icjax.synthesis import read_scene, slot_names

    scene = read_scene(path)
    try:
        slot_names(interaction.model, scene)
    except ValueError as error:
        raise FileError(path, str(error)) from error
    return scene


def _deviation(interaction, rollout) -> float:
    """RMS of simulated less measured vertical force over the RMS of the measured one: the surface is the same."""
    import numpy as np

    measured = np.nan_to_num(np.asarray(interaction.contact_force)).sum(axis=1)[:, 2]
    measured = np.interp(np.asarray(rollout.time), np.asarray(interaction.time), measured)
    error = np.asarray(rollout.contact_force).sum(axis=1)[:, 2] - measured
    return float(np.sqrt(np.mean(error**2) / max(np.mean(measured**2), np.finfo(float).tiny)))


def rollout_text(rollout) -> str:
    """What happened to the hand, in two lines, and a line an object."""
    import numpy as np

    from icjax.synthesis import why_unsolved

    pads = [pad for (pad, _), mine in zip(rollout.slot_bodies(), rollout.on_hand(), strict=True) if mine]
    force = np.linalg.norm(np.asarray(rollout.contact_force)[:, np.array(rollout.on_hand())], axis=-1)
    touching = np.mean(force.sum(axis=1) > 0)
    text = f"  {len(rollout.time)} steps, in contact {touching:.0%}"
    if touching:
        text += f", largest force {force.max():.2f} N ({pads[np.argmax(force.max(axis=0))]})"
    failed = np.flatnonzero(np.asarray(rollout.status))
    if failed.size:
        first = float(rollout.time[failed[0]])
        text += f"\n  {failed.size} steps failed, the first at {first:.3f} s. {why_unsolved(rollout)}"
    return text + "".join(f"\n  {_object_text(rollout, name)}" for name in rollout.object_names)


def _object_text(rollout, name: str) -> str:
    import numpy as np

    from icjax.view import object_course

    course = object_course(rollout, name)
    tilt = (
        f"turned {np.degrees(course.turned[-1]):.0f}" if course.ball else f"tilted {np.degrees(course.tilt.max()):.0f}"
    )
    return (
        f"{name}: moved {1e3 * course.moved[-1]:.1f} mm, lifted {1e3 * course.lifted.max():.1f} mm and {tilt} degrees "
        f"at most, touched by the hand {np.mean(course.pushed > 0):.0%}"
    )
