"""How long `fit_session` takes, compilation included, and how much memory: a finger's session and a whole hand's.

    python experiments/benchmarks/session_fit.py [--cache DIR]

The finger's: 98 s of trials at 500 Hz of the virtual laboratory, 4 joints, 48 contacts, one catch trial a trial. The
hand's: `virtual_sessions/grasp5`, 25 s, 24 compliant degrees of freedom, no catch trials. Each is captured, then
fitted in a process of its own without a compilation cache. Writes session_fit.json.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
RESULT = ROOT / "experiments" / "results" / "session_fit.json"
LABORATORY = {"seed": 31, "trials": 8, "contacts": 6, "catch": 1}

FIT = """
import json, resource, sys, time
begin = time.perf_counter()
import jax
jax.config.update("jax_enable_x64", True)
from icjax.fit import fit_session
from icjax.recording import Session
session = Session.load(sys.argv[1])
loaded = time.perf_counter()
fit = fit_session(session)
print(json.dumps({
    "trials": len(session.trials()),
    "seconds of trials": round(sum(float(item.time[-1] - item.time[0]) for item in session.trials()), 1),
    "joints": len(fit.joints),
    "contacts": len(fit.made.windows),
    "numbers": fit.made.problem.parameters.size,
    "refused": sum(bool(joint.refused) for joint in fit.joints),
    "steps": fit.solution.stats["steps"],
    "solve s": round(fit.solution.stats["seconds"], 1),
    "import and load s": round(loaded - begin, 1),
    "fit s": round(time.perf_counter() - loaded, 1),
    "memory MB": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024),
}))
"""


def captured(folder: Path) -> dict[str, Path]:
    """Both sessions as files, captured where they are not there yet."""
    import jax

    jax.config.update("jax_enable_x64", True)
    from icjax.capture import capture, read_session
    from icjax.laboratory import record

    paths = {"finger": folder / "finger.nc", "hand": folder / "grasp5.nc"}
    if not paths["finger"].exists():
        capture(read_session(record(folder / "studio", **LABORATORY).session)).save(paths["finger"])
    if not paths["hand"].exists():
        os.environ.setdefault("ICJAX_SHARED_DATA", str(ROOT.parent / "shared" / "data"))
        capture(read_session(ROOT / "experiments" / "sessions" / "virtual_grasp5.toml")).save(paths["hand"])
    return paths


def main() -> None:
    """Capture, fit each in a fresh process, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cache", type=Path, help="folder that keeps the captured sessions")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = options.cache or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        result = {}
        for name, path in captured(folder).items():
            done = subprocess.run([sys.executable, "-c", FIT, str(path)], capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(f"{name}: {done.stderr.strip().splitlines()[-1]}")
            result[name] = json.loads(done.stdout.splitlines()[-1])
            print(name, result[name], flush=True)
    RESULT.write_text(json.dumps(result, indent=1) + "\n")
    print(f"wrote {RESULT}")


if __name__ == "__main__":
    main()
