"""Put the page together and write it."""

import os
import platform
import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from importlib import metadata
from pathlib import Path
from typing import Any

from icjax.files import FileError
from icjax.fit import FitRecord
from icjax.interaction import Interaction
from icjax.recording import Recording, Session
from icjax.report._estimates import compliance, contact
from icjax.report._fits import fits as fit_section
from icjax.report._objects import objects
from icjax.report._page import note, page, paragraph, text, tiles
from icjax.report._sections import forces, motion, provenance, rollout_table, scene, shown_first, view_page
from icjax.report._summary import cautions, is_simulated, key_figures, lead
from icjax.rollout import Rollout
from icjax.running import Later
from icjax.view import scene_name

PACKAGES = ("icjax", "jax", "equinox", "numpy", "scipy", "mujoco-core", "viser", "matplotlib")


def write_report(
    path: str | os.PathLike,
    *,
    session: Session | Recording | None = None,
    interactions: Sequence[Interaction] = (),
    rollouts: Sequence[Rollout] = (),
    fits: Sequence[FitRecord] = (),
    metrics: Mapping[str, Any] | None = None,
    versions: Mapping[str, str] | None = None,
    seed: int | None = None,
    simulated: bool | None = None,
    title: str | None = None,
) -> Path:
    """Write one HTML page that shows what was recorded, estimated and transferred.

    The page opens from disk without a network and holds everything itself: a 3-D view with a time bar, the
    compliance table with intervals and counts, its sensitivity to windows and degree, joint angle and torque at
    contact (Figure 3), measured and reference angles, forces before and after transfer (Figure 4), what became of
    objects, diagnostics of every rollout, warnings, and where the numbers come from. What is not given is said to be
    absent.

    **Arguments**

    - `path`: the file to write (folders are made); complete or not at all.
    - `session`: a recording or several; `interactions`: estimates, the first one is shown in full.
    - `rollouts`: the transfers, in the order to show them. `fits`: of whole sessions, each shown beside the paper's
      estimate.
    - `metrics`: numbers to list, nested as you like; a `true_compliance` of a joint under `estimate` (a virtual
      subject) also gets a column in the table of compliance; `versions`: by default those of the installed packages.
    - `seed`: of the demonstration, if one was used.
    - `simulated`: whether the *recording* came from a simulation; by default what its provenance or
      the metrics say, else unknown.
    - `title`: by default made from the names.

    **Returns**: the path.

    **Errors**: `ImportError` naming the extra ``viz`` where matplotlib or viser is absent; `FileError` where the
    file cannot be written.
    """
    report = Report()
    report.measured(session, interactions, metrics, fits)
    for rollout in rollouts:
        report.transferred(rollout)
    return report.write(path, metrics=metrics, versions=versions, seed=seed, simulated=simulated, title=title)


class Report:
    """The page of `write_report`, its pictures drawn as soon as what they show is known.

    **Arguments**: `executor` of another process that draws them while the caller goes on; by default they are drawn at
    once.
    """

    def __init__(self, executor: Executor | None = None):
        self._executor = executor
        self._recordings: tuple[Recording, ...] = ()
        self._interactions: tuple[Interaction, ...] = ()
        self._rollouts: tuple[Rollout, ...] = ()
        self._fits: tuple[FitRecord, ...] = ()
        self._name: str | None = None
        self._views: list[tuple[str, Later]] = []
        self._sections: list[Later] = []

    def measured(
        self,
        session: Session | Recording | None = None,
        interactions: Sequence[Interaction] = (),
        metrics: Mapping[str, Any] | None = None,
        fits: Sequence[FitRecord] = (),
    ) -> None:
        """Take what was recorded, estimated and fitted; arguments as for `write_report`. To be called once."""
        self._recordings = (session,) if isinstance(session, Recording) else (session.recordings if session else ())
        self._interactions = tuple(interactions)
        self._fits = tuple(fits)
        self._name = session.name if session is not None else None
        first = shown_first(self._recordings, self._interactions)
        estimated = [
            self._drawn(compliance, self._interactions, metrics, self._recordings),
            self._drawn(contact, self._interactions),
        ]
        self._sections = [
            *(estimated if interactions or not fits else []),  # a fit holds the estimate too
            self._drawn(fit_section, self._fits, metrics),
            self._drawn(motion, self._recordings, self._interactions, bool(fits)),
        ]
        if first is not None:
            self._views.append((first[0], self._drawn(view_page, first[1])))

    def transferred(self, rollout: Rollout) -> None:
        """Take a transfer; they are shown in the order in which they come."""
        self._rollouts += (rollout,)
        self._views.append((scene_name(rollout), self._drawn(view_page, rollout)))

    def write(
        self,
        path: str | os.PathLike,
        *,
        metrics: Mapping[str, Any] | None = None,
        versions: Mapping[str, str] | None = None,
        seed: int | None = None,
        simulated: bool | None = None,
        title: str | None = None,
    ) -> Path:
        """Draw the rest and write the page; arguments, result and errors as for `write_report`."""
        recordings, interactions, rollouts, fits = self._recordings, self._interactions, self._rollouts, self._fits
        simulated = is_simulated((*recordings, *interactions, *fits), metrics) if simulated is None else simulated
        name = self._name or next((item.name for item in (*interactions, *rollouts, *fits)), "nothing")
        if not self._sections:
            self.measured()
        estimated_only = bool(fits) and not rollouts  # nobody asked for a transfer
        transferred = [] if estimated_only else [self._drawn(forces, interactions, rollouts)]
        transferred.append(self._drawn(objects, rollouts))
        frame, script = scene([(name, drawn.result()) for name, drawn in self._views], rollouts)
        found = [drawn.result() for drawn in (*self._sections, *transferred)]
        alone = bool(fits) and not (recordings or interactions or rollouts)
        sections = [
            *([] if alone else [frame]),
            *(section for section in found if section is not None),
            *([] if estimated_only else [rollout_table(rollouts)]),
            provenance(recordings, (*interactions, *fits), rollouts, metrics, versions or installed_versions(), seed),
        ]
        header = f'<p class="lead">{text(lead(recordings, interactions, rollouts, simulated, fits))}</p>'
        header += tiles(key_figures(recordings, interactions, rollouts, fits))
        header += note(cautions(interactions, rollouts, simulated, fits))
        footer = paragraph(
            "Written by icjax. Forces act on the subject. Equation and figure numbers are those of Kry and Pai, "
            "Interaction capture and synthesis, ACM Transactions on Graphics 25(3), 2006."
        )
        title = title or f"Interaction capture: {name}"
        return _write(Path(path), page(title, name, header, sections, footer, script))

    def _drawn(self, draw: Callable[..., Any], *records: Any) -> Later:
        return Later(self._executor, draw, *records)


def installed_versions() -> dict[str, str]:
    """Versions of Python and of the packages that made the numbers; absent ones are left out."""
    found = {"Python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


def _write(path: Path, content: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error}") from error
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except OSError as error:
        raise FileError(path, f"cannot be written: {error}") from error
    finally:
        Path(temporary).unlink(missing_ok=True)
    return path
