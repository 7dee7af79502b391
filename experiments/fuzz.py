"""Damaged files of every format: each read must give data or one clear `FileError`, soon and in little memory.

    python experiments/fuzz.py --count 20000 --seed 1 [--formats c3d trc] [--shared SHARED_DATA] [--out FILE.json]

File i of a format depends on the seed, the format and i alone. Reading happens in a process of its own, so that a
crash of a compiled reader, a hang (over 10 s a file) or a process that wants more than 1 GB is one counted defect with
the number of its file, after which the next file follows. Warnings count as defects, and so does a message that has
several lines or does not begin with the file's name. Prints, a format: files that were read, refused, defects, the
slowest file (s) and by how much the largest process grew (MB). Exit code 1 if there was a defect.
"""

import argparse
import faulthandler
import json
import os
import random
import resource
import subprocess
import sys
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from fuzz_files import FORMATS, damaged, seed_files

HANG = 10.0
"""s a file; good files of these sizes take milliseconds."""

ADDRESSES = 1 << 30
"""Bytes of address space that reading may claim beyond the loaded libraries."""

GROWTH = 64.0
"""MB that the process may grow by; the files have some kB."""


def reader(kind: str, folder: Path) -> tuple[Path, Any]:
    """The path to put damaged files at and the function that reads it."""
    import icjax.files as files

    if kind == "session":
        from icjax.capture import read_session

        (folder / "one.c3d").touch()
        return folder / "session.toml", read_session
    if kind == "scene":
        from icjax.synthesis import read_scene

        return folder / "scene.toml", read_scene
    path = folder / f"damaged.{kind}"
    if kind == "c3d":
        from icjax.capture._plates import plate_wrench

        def read(path):
            motion = files.read_c3d(path)
            for plate in motion.plates:
                if np.isfinite(motion.analog[:, list(plate.channels)]).all():  # capture refuses others first
                    plate_wrench(motion, plate)

        return path, read
    names = {"trc": "read_trc", "mot": "read_sto", "tsv": "read_tsv", "bvh": "read_bvh", "csv": "read_csv"}
    return path, getattr(files, names[kind])


def judged(path: Path, read: Any) -> tuple[str, str]:
    """ "read", "refused" or "defect", and what was said."""
    from icjax.files import FileError

    try:
        read(path)
    except FileError as error:
        text = str(error)
        good = text.startswith(str(path)) and len(text.splitlines()) == 1 and "alloc" not in text
        return ("refused" if good else "defect"), text
    except Exception as error:
        return "defect", f"{type(error).__name__}: {error}"
    return "read", ""


def work(todo: list[tuple[str, int, int]], seed: int, shared: Path | None) -> None:
    """Read the files start ... stop - 1 of every format; one line of JSON before and one after each."""
    from jaxtyping import install_import_hook

    install_import_hook("icjax", "beartype.beartype")  # shapes and types of what comes out
    warnings.simplefilter("error")
    with tempfile.TemporaryDirectory() as name:
        prepared = []
        for kind, start, stop in todo:
            folder = Path(name) / kind
            folder.mkdir()
            path, read = reader(kind, folder)
            seeds = seed_files(kind, folder, shared)
            for data in seeds:
                path.write_bytes(data)
                read(path)  # a good file must be good; also loads what is loaded late
            prepared.append((kind, range(start, stop), path, read, seeds))
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + ADDRESSES, resource.RLIM_INFINITY))
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for kind, indices, path, read, seeds in prepared:
            for index in indices:
                rng = random.Random(f"{seed} {kind} {index}")
                path.write_bytes(damaged(rng.choice(seeds), kind, rng))
                print(json.dumps({"begin": index, "format": kind}), flush=True)
                faulthandler.dump_traceback_later(HANG, exit=True)
                began = time.perf_counter()
                outcome, said = judged(path, read)
                seconds = time.perf_counter() - began
                faulthandler.cancel_dump_traceback_later()
                grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024.0
                if grown > GROWTH:
                    outcome, said = "defect", f"the process grew by {grown:.0f} MB; {said}"
                told = {"end": index, "format": kind, "outcome": outcome, "said": said}
                print(json.dumps(told | {"seconds": seconds, "grown": grown}), flush=True)


def run(formats: list[str], seed: int, count: int, shared: Path | None) -> dict[str, dict[str, Any]]:
    """Figures of every format, `count` files of each, from as many processes as crashes make necessary."""
    figures: dict[str, dict[str, Any]] = {
        kind: {"read": 0, "refused": 0, "defects": [], "slowest_s": 0.0, "grown_mb": 0.0} for kind in formats
    }
    nexts = dict.fromkeys(formats, 0)
    while any(item < count for item in nexts.values()):
        todo = json.dumps([(kind, item, count) for kind, item in nexts.items()])
        command = [sys.executable, __file__, "--work", todo, str(seed), str(shared or "")]
        process = subprocess.run(command, capture_output=True, text=True)
        begun = None
        for line in process.stdout.splitlines():
            told = json.loads(line)
            kind = told["format"]
            if "begin" in told:
                begun = kind, told["begin"]
                continue
            begun = None
            nexts[kind] = told["end"] + 1
            item = figures[kind]
            item["slowest_s"] = max(item["slowest_s"], round(told["seconds"], 3))
            item["grown_mb"] = max(item["grown_mb"], round(told["grown"], 1))
            if told["outcome"] == "defect":
                item["defects"].append({"file": told["end"], "said": told["said"]})
            else:
                item[told["outcome"]] += 1
        if begun is not None:
            kind, index = begun
            said = f"exit {process.returncode}: {process.stderr[-2000:]}"
            figures[kind]["defects"].append({"file": index, "said": said})
            nexts[kind] = index + 1
        elif process.returncode:
            raise RuntimeError(f"the reading process could not begin: {process.stderr[-2000:]}")
    return figures


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=2000, help="files in all, shared out over the formats")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--formats", nargs="+", choices=FORMATS, default=list(FORMATS))
    parser.add_argument("--shared", type=Path, help="other people's data, to be cut down and damaged too")
    parser.add_argument("--out", type=Path, help="JSON file for the figures")
    arguments = parser.parse_args()
    share = arguments.count // len(arguments.formats)
    figures = run(arguments.formats, arguments.seed, share, arguments.shared)
    print(f"{'format':10}{'read':>8}{'refused':>9}{'defects':>9}{'slowest (s)':>13}{'grown (MB)':>12}")
    for kind, item in figures.items():
        numbers = f"{item['read']:8}{item['refused']:9}{len(item['defects']):9}"
        print(f"{kind:10}{numbers}{item['slowest_s']:13.3f}{item['grown_mb']:12.1f}")
        for defect in item["defects"]:
            print(f"  file {defect['file']} of seed {arguments.seed}: {defect['said']}")
    if arguments.out:
        arguments.out.parent.mkdir(parents=True, exist_ok=True)
        arguments.out.write_text(json.dumps({"seed": arguments.seed, "formats": figures}, indent=1) + "\n")
    return 1 if any(item["defects"] for item in figures.values()) else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["--work"]:
        todo, seed, shared = sys.argv[2:]
        os.environ.setdefault("JAX_ENABLE_X64", "1")
        work([tuple(item) for item in json.loads(todo)], int(seed), Path(shared) if shared else None)
    else:
        sys.exit(main())
