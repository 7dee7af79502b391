"""`icjax design`: which contacts to record, before anyone is recorded."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from icjax.fit import Design as Plan


@dataclass(frozen=True)
class Design:
    """Rank contacts by how wide each joint's 95 % interval would be; say what each joint is missing.

    An interval's width is the ratio of its ends. Joints above a factor of 4 get no number from a fit.
    """

    plan: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="PLAN.TOML")] = None
    """Model, instruments and candidate contacts; its keys are explained in the guide "Designing a session"."""
    model: Literal["index_finger"] | None = None
    """In place of a file: a shipped model with candidates of ours."""
    catch_trials: int | None = None
    """Catch trials of every trial, 0 for none, in place of the file's (2 if it says nothing)."""
    contacts: int | None = None
    """Contacts of every probe, in place of the file's."""
    best: int = 3
    """How many contacts to combine: chosen one after the other (greedy), then exchanged one for another while that
    narrows the widest joint, which may miss the best set."""
    out: Path | None = None
    """File for the figures, JSON; nothing is written if not given."""

    def run(self) -> None:
        from icjax.cli._output import Steps
        from icjax.fit import design_figures, design_text

        if (self.plan is None) == (self.model is None):
            raise ValueError("give either PLAN.TOML or --model index_finger")
        if self.best < 1:
            raise ValueError(f"--best {self.best}: must be at least 1")
        with Steps(1).step("expected intervals"):
            plan = self._plan()
        print(design_text(plan, self.best))
        if self.out is not None:
            self.out.parent.mkdir(parents=True, exist_ok=True)
            self.out.write_text(json.dumps(design_figures(plan, self.best), indent=1) + "\n")
            print(f"wrote {self.out}")

    def _plan(self) -> "Plan":
        import dataclasses

        from icjax.fit import Planned, design, finger_candidates, read_design
        from icjax.model import index_finger

        if self.plan is not None:
            planned = read_design(self.plan)
        else:
            model = index_finger()
            planned = Planned(model, finger_candidates(model))
        probes = planned.probes
        if self.contacts is not None:
            probes = tuple(dataclasses.replace(probe, contacts=self.contacts) for probe in probes)
        catch_trials = planned.catch_trials if self.catch_trials is None else self.catch_trials
        return design(planned.model, probes, catch_trials, noise=planned.noise)
