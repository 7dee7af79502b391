"""`icjax view`: what it serves, and what it refuses."""

import pytest
from view.example_objects import make_object_rollout
from view.example_records import make_interaction, make_recording

from icjax.cli import main
from icjax.files import save_record
from icjax.synthesis import GripTightening, ImminentSlip
from icjax.view import LivePage


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view")
    make_object_rollout().save(folder / "rollout.nc")
    recording = make_recording()
    make_interaction(recording).save(folder / "interaction.nc")
    save_record(folder / "model.nc", recording.model)
    (folder / "scene.toml").write_text(
        'friction = 0.5\n[[surface]]\nname = "fingertip"\nshape = "plane"\npoint = [0, 0, 0]\nnormal = [0, 0, 1]\n'
    )
    return folder


def test_a_page_is_served_until_ctrl_c(folder, capsys, monkeypatch):
    served = []

    def interrupted(page):
        served.append(page)
        raise KeyboardInterrupt

    monkeypatch.setattr(LivePage, "wait", interrupted)
    assert main(["view", str(folder / "interaction.nc"), "--port", "8765", "--no-browser"]) == 0
    told = capsys.readouterr().out
    assert "http://127.0.0.1:8" in told
    assert "measured only" in told
    assert served[0].explorer is None
    assert not served[0]._thread.is_alive()


def test_what_cannot_be_viewed_is_refused(folder, capsys):
    for arguments, words in (
        (["none.nc"], "does not exist"),
        (["model.nc"], "holds a Model; view takes an interaction or a rollout"),
        (["rollout.nc", "--scene", "scene.toml"], "--scene cannot be given with the rollout"),
        (["interaction.nc", "--scene", "scene.toml"], "'fingertip' is the name of a pad"),
        (["interaction.nc", "--port", "70000"], "--port is 70000"),
        (["interaction.nc", "--policy", "tighten"], "--policy needs --scene"),
    ):
        paths = [str(folder / item) if item.endswith(("nc", "toml")) else item for item in arguments]
        assert main(["view", *paths, "--no-browser"]) == 2
        line = capsys.readouterr().err.strip().splitlines()[-1]
        assert words in line


@pytest.mark.parametrize(
    ("name", "kind"), [("none", type(None)), ("tighten", GripTightening), ("adjust", ImminentSlip)]
)
@pytest.mark.parametrize("verb", ["view", "transfer"])
def test_the_policy_that_is_asked_for_is_the_one_that_acts(folder, monkeypatch, verb, name, kind):
    seen = []

    def asked(*_, policy, **__):
        seen.append(policy)
        raise ValueError("enough")

    monkeypatch.setattr({"view": "icjax.view.explore", "transfer": "icjax.synthesis.transfer"}[verb], asked)
    scene = folder / "ground.toml"
    scene.write_text((folder / "scene.toml").read_text().replace("fingertip", "ground"))
    browser = ["--no-browser"] if verb == "view" else []
    arguments = [verb, str(folder / "interaction.nc"), "--scene", str(scene), "--policy", name, *browser]
    assert main(arguments) == 2
    assert [type(policy) for policy in seen] == [kind]
