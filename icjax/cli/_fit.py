"""`icjax fit`: a session to compliance, damping and masses that explain the response to contact."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

if TYPE_CHECKING:
    from icjax.fit import FitOptions
    from icjax.recording import Session

OPTIONS = (
    "after", "before", "settle", "typical_compliance", "compliance_sd", "compliance_by", "compliance_change",
    "inertia_sd", "shift_sd", "widest",
)  # fmt: skip
"""Of `FitOptions`, those that are options here."""


@dataclass(frozen=True)
class Fit:
    """Fit compliance to the first 100 ms of every contact of a session against its catch trials; write DIR/fit_NAME.nc
    (fit_NAME_by_trial.nc where compliance may change).

    Catch trials are the same movement with the surface taken away; without them intervals are several times as wide. A
    joint that the contacts hardly loaded is refused: it gets bounds and a reason, no number. The paper's estimate of
    the same session is printed beside it. Ctrl-C keeps the steps taken, for --resume.
    """

    session: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORDING.NC|SESSION.TOML")]
    """Session written by `icjax capture`, or a session file, which is captured first."""
    out: Path | None = None
    """Folder for the result, replaced there; the recording's own folder if not given, icjax-out for a session file."""
    after: float = 0.1
    """What is compared after the onset, s (reflexes act after about 0.1 s)."""
    before: float = 0.25
    """What is compared before the onset, s; it holds the catch trials against the trial."""
    settle: float = 0.15
    """How long a finger still rings after a release, s."""
    typical_compliance: float = 0.5
    """Where the prior of a joint's compliance is centred if the model states none, rad/Nm."""
    compliance_sd: float = 1.5
    """Standard deviation of that prior, of the logarithm of the compliance."""
    compliance_by: Literal["session", "trial", "contact"] = "session"
    """Where compliance may change; each trial's or contact's is then drawn to what all have in common."""
    compliance_change: float = 0.3
    """How far: standard deviation of the logarithm about what all have in common. 0.3 is about a third; where subjects
    were told to stiffen, 1."""
    inertia_sd: float = 0.5
    """Relative standard deviation of the segments' masses about those of the model."""
    shift_sd: float = 0.015
    """How much earlier or later a repetition of the movement may begin, s."""
    widest: float = 4.0
    """A joint is refused where the ends of its interval differ by more than this factor."""
    without_catch_trials: bool = False
    """Fit as if there were no catch trials, to see what they buy; the result is DIR/fit_NAME_no_catch_trials.nc."""
    profile: bool = False
    """Find intervals by profile likelihood too: where they differ from the others, those are not to be trusted. Of one
    compliance through the session only."""
    resume: bool = False
    """Go on from where an interrupted fit with the same options ended."""

    def run(self) -> None:
        import dataclasses

        from icjax.cli._output import Steps
        from icjax.estimation import estimates
        from icjax.fit import FitOptions, fit_record, fit_session, fit_text

        if self.profile and self.compliance_by != "session":
            raise ValueError(f"--profile is of one compliance a joint: not with --compliance-by {self.compliance_by}")
        options = FitOptions(**{name: getattr(self, name) for name in OPTIONS})
        session, folder = self._session()
        changes = "" if self.compliance_by == "session" else f"_by_{self.compliance_by}"
        if self.without_catch_trials:
            session = dataclasses.replace(session, recordings=session.trials())
            changes += "_no_catch_trials"
        path = folder / f"fit_{file_name(session.name)}{changes}.nc"
        checkpoint = path.with_suffix(f".{_key(session, options)}.checkpoint")
        self._prepare(checkpoint)
        steps = Steps(3)
        # Before the fit, which would be lost if it were interrupted here.
        with steps.step("the paper's estimate of the same session") as progress:
            paper = next(estimates(session, None, progress, (session.trials()[0].name,))).summary
        try:
            with steps.step("fit to the response after contact") as progress:
                fit = fit_session(
                    session,
                    options,
                    lambda now: progress(_done(now), _told(now)),
                    checkpoint=checkpoint,
                    keep_checkpoint=True,
                )
            with steps.step("reference trajectory with its band"):
                record = fit_record(fit, session, paper)
                record.save(path)
            if self.profile:
                try:
                    record = fit_record(fit, session, paper, profiles=True)
                    record.save(path)
                except ValueError as error:  # the fit itself is kept
                    print(f"icjax: no intervals by profile likelihood: {error}", file=sys.stderr)
        except KeyboardInterrupt:
            if checkpoint.is_file():
                print("icjax: the steps taken are kept; --resume goes on from there", file=sys.stderr)
            raise
        print(fit_text(record))
        if record.result == "solved":
            checkpoint.unlink(missing_ok=True)
        elif checkpoint.is_file():
            print("--resume goes on from where it ended")
        print(f"wrote {path}")

    def _session(self) -> "tuple[Session, Path]":
        """The captured session and the folder of the result."""
        from icjax.capture import check_recording
        from icjax.cli._capture import Capture
        from icjax.recording import Session

        if self.out is not None and self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file, not a folder")
        if self.session.suffix == ".toml":
            folder = self.out or Path("icjax-out")
            Capture(self.session, folder).run()
            return Session.load(folder / "recording.nc"), folder
        session = Session.load(self.session)
        errors = [line for line in check_recording(session) if line.startswith("error: ")]
        if errors:
            raise ValueError(f"{self.session} is unusable: {errors[0].removeprefix('error: ')}")
        return session, self.out or self.session.parent

    def _prepare(self, checkpoint: Path) -> None:
        if not self.resume:
            checkpoint.unlink(missing_ok=True)
        elif checkpoint.is_file():
            print(f"goes on from {checkpoint}, in which steps are counted anew", file=sys.stderr)
        else:
            print(f"note: {checkpoint} does not exist: the fit begins anew", file=sys.stderr)


def file_name(name: str) -> str:
    """A session's name as part of a file's."""
    return "".join(letter if letter.isalnum() or letter in "-_." else "_" for letter in name) or "session"


def _key(session: "Session", options: "FitOptions") -> str:
    """Of the angles and options, so that a checkpoint is not resumed with others."""
    import dataclasses
    import hashlib
    import json

    import numpy as np

    digest = hashlib.sha256(json.dumps(dataclasses.asdict(options)).encode())
    for recording in session.recordings:
        digest.update(recording.name.encode())
        digest.update(np.ascontiguousarray(recording.q).tobytes())
    return digest.hexdigest()[:8]


def _done(now) -> float:
    """How many steps it takes is not known beforehand; a dozen are usual."""
    return 1.0 - 0.85**now.step


def _told(now) -> str:
    told = f"step {now.step}, cost {now.cost:.6g}, {now.seconds:.0f} s"
    return told if now.remaining != now.remaining else f"{told}, at most {now.remaining:.0f} s more"  # NaN at the first
