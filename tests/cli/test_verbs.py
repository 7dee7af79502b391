"""The command line as a person uses it: what is printed, what is written, what is refused."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from icjax.cli import main
from icjax.cli._main import VERBS
from icjax.interaction import Interaction
from icjax.recording import Session
from icjax.rollout import Rollout

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def demo(tmp_path_factory):
    """One small run of the main job, shared by the tests that look at what it wrote."""
    folder = tmp_path_factory.mktemp("demo")
    assert main(["demo", "--out", str(folder), "--trials", "1", "--contacts", "2", "--seed", "4"]) == 0
    return folder


def complains(capsys, arguments, *words):
    """The verb fails with exit code 2 and one line that holds the words."""
    assert main([str(item) for item in arguments]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    told = [line for line in lines if line.startswith("icjax: ")]
    assert len(told) == 1, lines
    assert told[0] == lines[-1]
    for word in words:
        assert word in told[0]


def test_help_imports_nothing_heavy():
    """`--help` answers at once because no verb's imports have run."""
    code = (
        "import sys, io, contextlib\n"
        "from icjax.cli import main\n"
        "with contextlib.suppress(SystemExit), contextlib.redirect_stdout(io.StringIO()):\n"
        "    main(['--help'])\n"
        "heavy = {'jax', 'numpy', 'scipy', 'mujoco', 'xarray', 'matplotlib', 'viser', 'h5netcdf'} & set(sys.modules)\n"
        "print(','.join(sorted(heavy)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.strip() == ""


def test_help_names_every_verb(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    text = capsys.readouterr().out
    for verb in VERBS:
        assert verb in text


@pytest.mark.slow
def test_demo_writes_what_it_promises(demo):
    session = Session.load(demo / "recording.nc")
    assert [item.role for item in session.recordings] == ["trial", "catch"]
    interaction = Interaction.load(demo / "interaction.nc")
    assert interaction.name == "trial00"
    for name in ("flat", "bump", "slippery"):
        assert int((Rollout.load(demo / f"rollout_{name}.nc").status != 0).sum()) == 0
    metrics = json.loads((demo / "metrics.json").read_text(), parse_constant=pytest.fail)
    assert metrics["capture"]["contacts"] == {"true": 2, "found": 2}
    assert "simulated" in metrics["data"]
    page = (demo / "report.html").read_text()
    assert "imulated" in page
    assert not [path for path in demo.iterdir() if path.name.startswith(".")]


@pytest.mark.slow
def test_verbs_follow_each_other(demo, tmp_path, capsys):
    """What the demo does in one go, verb by verb, from its session file."""
    session = demo / "studio" / "session.toml"
    assert main(["check", str(session)]) == 0
    told = capsys.readouterr().out
    assert "500" in told
    assert "trial00" in told
    assert main(["capture", str(session), "--out", str(tmp_path)]) == 0
    assert main(["estimate", str(tmp_path / "recording.nc"), "--all", "--explain"]) == 0
    told = capsys.readouterr().out
    assert "rad/Nm" in told
    lines = [line for line in told.splitlines() if line.startswith("trial00 ")]
    assert len(lines) == 2 * 4  # contacts times joints
    assert all(any(word in line for word in ("accepted: ", "negative: ", "not excited: ")) for line in lines)
    assert "stable over windows and degrees, of 2 events: wrist " in told
    scene = tmp_path / "slope.toml"
    scene.write_text(
        'name = "slope"\nfriction = 0.4\n[[surface]]\nname = "slope"\nshape = "plane"\n'
        "point = [0.0, 0.0, 0.0]\nnormal = [0.05, 0.0, 1.0]\n"
    )
    interaction = str(tmp_path / "interaction.nc")
    assert main(["transfer", interaction, "--scene", str(scene)]) == 0
    assert main(["transfer", interaction, "--surface", "bump"]) == 0
    assert json.loads(Rollout.load(tmp_path / "rollout_slope.nc").scene)["surfaces"][0]["friction"] == 0.4
    capsys.readouterr()
    push = ROOT / "experiments" / "scenes" / "push.toml"
    assert main(["transfer", interaction, "--scene", str(push)]) == 0
    told = re.search(
        r"^  box: moved (\S+) mm, lifted .* degrees at most, touched by the hand (\d+)%$", capsys.readouterr().out, re.M
    )
    assert told, "what became of the box is told"
    assert float(told[1]) > 5.0
    assert int(told[2]) > 2
    strange = tmp_path / "strange.toml"
    strange.write_text(push.read_text().replace('["box", "table"]', '["thumb", "table"]'))
    complains(capsys, ["transfer", interaction, "--scene", strange], "strange.toml: ", "'thumb'")
    assert main(["report", str(tmp_path)]) == 0
    assert (tmp_path / "report.html").stat().st_size > 100_000


def test_missing_files_are_named(tmp_path, capsys):
    complains(capsys, ["check", tmp_path / "none.toml"], "none.toml", "does not exist")
    complains(capsys, ["capture", tmp_path / "none.toml"], "none.toml", "does not exist")
    complains(capsys, ["estimate", tmp_path / "none.nc"], "none.nc", "does not exist")
    complains(capsys, ["transfer", tmp_path / "none.nc"], "none.nc", "does not exist")
    complains(capsys, ["report", tmp_path / "none"], "none", "not a folder")
    complains(capsys, ["report", tmp_path], str(tmp_path), "holds no recording.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_file_of_another_kind_is_refused(tmp_path, capsys):
    stray = tmp_path / "recording.nc"
    stray.write_text("not a netCDF file")
    complains(capsys, ["estimate", stray], "recording.nc")
    assert list(tmp_path.iterdir()) == [stray]


@pytest.mark.slow
def test_wrong_options_are_refused(demo, tmp_path, capsys):
    recording, interaction = demo / "recording.nc", demo / "interaction.nc"
    complains(capsys, ["estimate", recording, "--trial", "trial07", "--out", tmp_path], "trial07", "trial00")
    complains(capsys, ["estimate", recording, "--window", "-0.1", "--out", tmp_path], "-0.1")
    complains(capsys, ["estimate", interaction, "--out", tmp_path], "interaction.nc", "Interaction")
    complains(capsys, ["transfer", interaction, "--friction", "-1", "--out", tmp_path / "r.nc"], "friction", "-1")
    complains(capsys, ["transfer", interaction, "--step", "0", "--out", tmp_path / "r.nc"], "step", "0")
    assert list(tmp_path.iterdir()) == []
