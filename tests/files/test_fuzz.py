"""Two thousand damaged files: data or one clear `FileError`, no crash, no hang, no memory.

They are read in another process, so that a crash of a compiled reader fails this test instead of ending the session.
"""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

import pytest

from icjax.files import FileError, read_c3d, read_toml, read_trc, write_c3d, write_trc

ROOT = Path(__file__).resolve().parents[2]
EXPERIMENTS = ROOT / "experiments"
COUNT = 2000
SEED = 20


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_damaged_files_give_data_or_one_clear_error(tmp_path):
    """Eight formats, 250 files each; a defect is printed with the number that makes it again."""
    shared = Path(os.environ.get("ICJAX_SHARED_DATA", ROOT.parent / "shared" / "data"))
    out = tmp_path / "figures.json"
    command = [sys.executable, str(EXPERIMENTS / "fuzz.py"), "--count", str(COUNT), "--seed", str(SEED)]
    command += ["--out", str(out)] + (["--shared", str(shared)] if shared.is_dir() else [])
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT)
    assert out.exists(), done.stderr[-3000:]
    figures = json.loads(out.read_text())["formats"]
    assert sum(item["read"] + item["refused"] for item in figures.values()) == COUNT, done.stdout
    assert done.returncode == 0, done.stdout
    for kind, item in figures.items():  # the mutations neither spoil everything nor nothing
        assert item["read"] >= 5, kind
        assert item["refused"] >= 50, kind


@pytest.fixture
def experiment(monkeypatch):
    """The experiment's modules, as its own command imports them."""
    monkeypatch.syspath_prepend(str(EXPERIMENTS))
    import fuzz
    import fuzz_files

    return fuzz, fuzz_files


def test_what_the_experiment_calls_a_defect(experiment):
    path = Path("some.c3d")

    def fails(error):
        def read(path):
            raise error

        return read

    refusal = FileError(path, "is damaged")
    assert experiment[0].judged(path, lambda path: 1)[0] == "read"
    assert experiment[0].judged(path, fails(refusal)) == ("refused", str(refusal))
    for error in (
        FileError(path, "two\nlines"),
        FileError("other.c3d", "bad"),
        FileError(path, "std::bad_alloc"),
        ValueError("bad"),
        MemoryError(),
        RuntimeWarning("overflow"),
    ):
        assert experiment[0].judged(path, fails(error))[0] == "defect", error


def test_mutations_are_the_same_every_time(experiment):
    files = experiment[1]
    for kind in files.FORMATS:
        many, again = (
            [files.damaged(files.CSV.encode(), kind, random.Random(f"{kind} {index}")) for index in range(50)]
            for _ in range(2)
        )
        assert many == again
        assert len(set(many)) > 40


def example(path: Path) -> bytearray:
    import numpy as np

    made = write_c3d(path, marker_names=("A",), markers=np.zeros((3, 1, 3)), marker_rate=100.0)
    return bytearray(made.read_bytes())


def value(data: bytearray, group: bytes, name: bytes) -> int:
    """Place of the number of dimensions of a parameter."""
    return data.index(name, data.index(group)) + len(name) + 3


def test_text_without_dimensions_never_reaches_ezc3d(tmp_path):
    """Found by damaging files: ezc3d 1.7.2 ends the process on it."""
    data = example(tmp_path / "a.c3d")
    data[value(data, b"POINT", b"LABELS")] = 0
    (tmp_path / "b.c3d").write_bytes(data)
    with pytest.raises(FileError, match=r"b\.c3d: is damaged: text parameter 'LABELS' has no dimensions"):
        read_c3d(tmp_path / "b.c3d")


@pytest.mark.parametrize(("group", "name"), [(b"POINT", b"FRAMES"), (b"ROTATION", b"USED"), (b"ROTATION", b"RATIO")])
def test_integers_without_a_number_never_reach_ezc3d(tmp_path, group, name):
    """Found by damaging files: ezc3d 1.7.2 reads the first number of an empty parameter and ends the process."""
    data = example(tmp_path / "a.c3d")
    place = value(data, group, name)
    data[place : place + 3] = (1, 0, 0)
    (tmp_path / "b.c3d").write_bytes(data)
    with pytest.raises(FileError, match=f"{group.decode()}:{name.decode()} holds no number"):
        read_c3d(tmp_path / "b.c3d")


def test_segment_poses_that_are_not_in_the_file(tmp_path):
    data = example(tmp_path / "a.c3d")
    place = value(data, b"ROTATION", b"USED")
    assert data[place] == 0  # a single number follows
    data[place + 1] = 5
    (tmp_path / "b.c3d").write_bytes(data)
    with pytest.raises(FileError, match=r"5 segment poses \(group ROTATION\) are not in the file"):
        read_c3d(tmp_path / "b.c3d")


@pytest.mark.parametrize("stated", ["inf", "nan", "1e400"])
def test_a_header_count_that_is_no_count(tmp_path, stated):
    import numpy as np

    arrays = {"markers": np.zeros((3, 1, 3)), "time": np.arange(3.0), "rate": 1.0}
    path = write_trc(tmp_path / "a.trc", marker_names=("A",), **arrays)
    path.write_text(path.read_text().replace("\t3\t1\tmm", f"\t{stated}\t1\tmm"))
    with pytest.raises(FileError, match="line 3 states no valid NumFrames"):
        read_trc(path)


def test_a_toml_integer_beyond_the_floats(tmp_path):
    from icjax.files import Table

    path = tmp_path / "a.toml"
    path.write_text(f"mass = 1{'0' * 400}\n")
    with pytest.raises(FileError, match=r"key 'mass' must be a number, not 1000"):
        Table(path, "", read_toml(path)).number("mass")
