"""Entry point: parse, set up JAX, run the verb, turn an error of the user's into one line and exit code 2."""

import gc
import os
import sys
import warnings

import tyro

from icjax import __version__
from icjax.cli._calibrate import Calibrate
from icjax.cli._capture import Capture
from icjax.cli._check import Check
from icjax.cli._demo import Demo
from icjax.cli._design import Design
from icjax.cli._estimate import Estimate
from icjax.cli._export import Export
from icjax.cli._fit import Fit
from icjax.cli._perturbation import Perturbation
from icjax.cli._report import Report
from icjax.cli._transfer import Transfer
from icjax.cli._view import View

VERBS = {
    "demo": Demo,
    "check": Check,
    "calibrate": Calibrate,
    "design": Design,
    "capture": Capture,
    "estimate": Estimate,
    "fit": Fit,
    "perturbation": Perturbation,
    "transfer": Transfer,
    "view": View,
    "report": Report,
    "export": Export,
}

DESCRIPTION = """Interaction capture: from a recording of motion and contact force to joint compliance and
reference trajectory, transferred to other surfaces by frictional contact simulation.

A first run: icjax demo --out icjax-demo

Your files, one after the other:

icjax check session.toml

icjax capture session.toml --out DIR

icjax estimate DIR/recording.nc

icjax fit DIR/recording.nc

icjax transfer DIR/interaction.nc

icjax view DIR/interaction.nc --scene scene.toml

icjax report DIR

Other programs: icjax export DIR/recording.nc --out DIR/opensim"""


def main(arguments: list[str] | None = None) -> int:
    """Run one verb. Returns 0, or 2 after one clear line about bad input.

    Set ICJAX_DEBUG=1 to see the full traceback instead of the line.
    """
    arguments = sys.argv[1:] if arguments is None else arguments
    if arguments == ["--version"]:
        print(f"icjax {__version__}")
        return 0
    warnings.showwarning = _note
    try:
        verb = tyro.extras.subcommand_cli_from_dict(
            VERBS, prog="icjax", description=DESCRIPTION, args=arguments or ["--help"]
        )
        if not isinstance(verb, Demo):  # which starts a second process before the seconds that importing JAX takes
            configure_jax()
        verb.run()
    except (ValueError, OSError, ImportError, MemoryError) as error:
        if os.environ.get("ICJAX_DEBUG"):
            raise
        print(f"icjax: {_one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("icjax: interrupted; files already written are complete", file=sys.stderr)
        return 130
    return 0


def configure_jax() -> None:
    """float64, one thread, kept compilations, few collections: the command line's choices, never the library's."""
    # XLA passes the many small operations of a step from thread to thread, which costs more than it saves: a third of
    # the time of a rollout. Read when JAX starts.
    for name in ("NPROC", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):  # matrices are small
        os.environ.setdefault(name, "1")
    # A third of the compile time for programs that run for a second or two; read when JAX starts.
    if "xla_backend_optimization_level" not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_backend_optimization_level=1".strip()
    # Importing and tracing make many small objects that live long; the standard thresholds have the collector visit all
    # of them again and again, a tenth of a run.
    gc.set_threshold(50_000, 50, 1000)
    import jax

    jax.config.update("jax_enable_x64", True)
    from icjax.compiling import cache_folder

    cache = os.environ.get("JAX_COMPILATION_CACHE_DIR", str(cache_folder()))
    jax.config.update("jax_compilation_cache_dir", cache)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)


def _note(message, category, filename, lineno, file=None, line=None) -> None:
    """A warning as a line for people: what it says, and not which line of which file says it."""
    print(f"note: {_one_line(message)}", file=sys.stderr)


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
