"""`icjax fit`: a session to compliance, damping and masses that explain the response to contact."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from icjax.fit import FitOptions, FitRecord
    from icjax.recording import Session

OPTIONS = ("after", "before", "settle", "typical_compliance", "compliance_sd", "inertia_sd", "shift_sd", "widest")
"""Of `FitOptions`, those that are options here."""


@dataclass(frozen=True)
class Fit:
    """Fit compliance to the first 100 ms of every contact of a session against its catch trials; write DIR/fit_NAME.nc.

    Catch trials are the same movement with the surface taken away; without them intervals are several times as wide. A
    joint that the contacts hardly loaded is refused: it gets bounds and a reason, no number. The paper's estimate of
    the same session is printed beside it. Ctrl-C keeps the steps taken, for --resume.
    """

    session: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="RECORDING.NC|SESSION.TOML")]
    """Session written by `icjax capture`, or a session file, which is captured first."""
    out: Path | None = None
    """Folder for the result; the recording's own folder if not given, icjax-out for a session file."""
    after: float = 0.1
    """What is compared after the onset, s (reflexes act after about 0.1 s)."""
    before: float = 0.25
    """What is compared before the onset, s; it holds the catch trials against the trial."""
    settle: float = 0.15
    """How long a finger still rings after a release, s."""
    typical_compliance: float = 0.5
    """Where the prior of a joint's compliance is centred if the model states none, rad/Nm."""
    compliance_sd: float = 1.0
    """Standard deviation of that prior, of the logarithm of the compliance."""
    inertia_sd: float = 0.5
    """Relative standard deviation of the segments' masses about those of the model."""
    shift_sd: float = 0.015
    """How much earlier or later a repetition of the movement may begin, s."""
    widest: float = 4.0
    """A joint is refused where the ends of its interval differ by more than this factor."""
    resume: bool = False
    """Go on from where an interrupted fit with the same options ended."""

    def run(self) -> None:
        from icjax.cli._output import Steps
        from icjax.estimation import estimates
        from icjax.fit import FitOptions, fit_record, fit_session

        options = FitOptions(**{name: getattr(self, name) for name in OPTIONS})
        session, folder = self._session()
        path = folder / f"fit_{file_name(session.name)}.nc"
        checkpoint = path.with_suffix(f".{_key(session, options)}.checkpoint")
        self._prepare(checkpoint)
        steps = Steps(3)
        with steps.step("fit to the response after contact") as progress:
            try:
                fit = fit_session(session, options, lambda now: progress(_done(now), _told(now)), checkpoint=checkpoint)
            except KeyboardInterrupt:
                if checkpoint.is_file():
                    print("icjax: the steps taken are kept; --resume goes on from there", file=sys.stderr)
                raise
        with steps.step("the paper's estimate of the same session") as progress:
            paper = next(estimates(session, None, progress, (session.trials()[0].name,))).summary
        with steps.step("reference trajectory with its band"):
            record = fit_record(fit, session, paper)
            record.save(path)
        print(fit_text(record))
        if checkpoint.is_file():
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
        elif not checkpoint.is_file():
            print(f"note: {checkpoint} does not exist: the fit begins anew", file=sys.stderr)


def fit_text(record: "FitRecord") -> str:
    """Compliance of each joint beside the paper's, as a table of text, then refusals, warnings and what it rests on."""
    import numpy as np

    from icjax.fit import far_from_prior

    units = sorted(set(record.units.values()), reverse=True)
    name = max(12, *(len(joint) for joint in record.joint_names))
    lines = [
        f"{'joint':{name}s} {'fit ' + ', '.join(units):>14s}  {'95 % interval':>18s} {'learned':>8s}"
        f"   {'the paper':>14s}  {'95 % interval':>18s}"
    ]
    paper = record.paper
    for index, joint in enumerate(record.joint_names):
        refused = record.refused[index]
        told = "refused" if refused else f"{record.compliance[index]:.3g}"
        cells = ("", "")
        if joint in paper.joint_names:
            row = paper.joint_names.index(joint)
            value, lower, upper = (float(x[row]) for x in (paper.compliance, paper.lower, paper.upper))
            cells = (f"{value:.3g}" if np.isfinite(value) else "not estimated", interval(lower, upper))
        lines.append(
            f"{joint:{name}s} {told:>14s}  {interval(float(record.lower[index]), float(record.upper[index])):>18s} "
            f"{record.learned[index]:>8.0%}   {cells[0]:>14s}  {cells[1]:>18s}"
        )
    lines += [
        f"{joint} refused: {reason}" for joint, reason in zip(record.joint_names, record.refused, strict=True) if reason
    ]
    lines.append(
        f"{len(record.windows.trial)} contacts of {len(record.trials)} trials against {record.catch_trials or 'no'} "
        f"catch trials; chi2 {record.chi2:.2f} (1 where noise and repetitions are as assumed)"
    )
    lines += [f"warning: {text}" for text in (*record.warnings, *far_from_prior(record))]
    return "\n".join(lines)


def interval(lower: float, upper: float) -> str:
    """A 95 % interval as text, an upper bound where it begins at zero."""
    if not upper < float("inf"):
        return "unbounded"
    return f"[{lower:.3g}, {upper:.3g}]" if lower > 0 else f"< {upper:.3g}"


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
    return f"step {now.step}, cost {now.cost:.6g}, {now.seconds:.0f} s, at most {now.remaining:.0f} s more"
