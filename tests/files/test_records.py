"""The three hinge records survive the way to a file and back, bit by bit; a failure leaves nothing behind."""

import dataclasses

import equinox as eqx
import h5netcdf
import jax
import numpy as np
import pytest

from icjax.files import FileError, load_record, record_kind, save_record
from icjax.interaction import CompliancePerEvent, Interaction, JointCompliance
from icjax.model import load_model
from icjax.recording import ContactEvents, Recording, SensorChannels, Session
from icjax.rollout import Rollout

MODEL = load_model(
    """<mujoco><worldbody><body name="arm"><freejoint name="root"/><geom size=".1" mass="1"/>
    <site name="s" pos=".1 0 0"/><body name="finger"><joint name="hinge" axis="0 1 0"/>
    <geom size=".1" mass=".1"/></body></body></worldbody></mujoco>"""
)
TIME, NQ, NV = 11, MODEL.nq, MODEL.nv
RNG = np.random.default_rng(0)


def numbers(*shape):
    return RNG.normal(size=shape)


def events():
    return ContactEvents(onset=numbers(2), release=np.array([1.0, np.nan]), contact=np.array([0, 0]))


def recording(name="trial00", role="trial", catch_of=None, markers=3):
    marker_names = tuple(f"m{index}" for index in range(markers))
    measured = numbers(TIME, markers, 3)
    measured[2:4] = np.nan
    return Recording(
        name=name,
        role=role,
        catch_of=catch_of,
        model=MODEL,
        time=np.linspace(0, 1, TIME),
        q=numbers(TIME, NQ),
        q_covariance=numbers(TIME, NV, NV),
        q_offset_sd=numbers(NV),
        valid=np.arange(TIME) % 2 == 0,
        contact_names=("plate",),
        contact_bodies=("finger",),
        contact_force=numbers(TIME, 1, 3),
        contact_point=numbers(TIME, 1, 3),
        contact_moment=numbers(TIME, 1, 3),
        touching=np.zeros((TIME, 1), dtype=bool),
        events=events(),
        marker_names=marker_names,
        markers=measured,
        marker_residual=numbers(TIME, markers),
        channels=SensorChannels(sensor_names=("s1", "s2"), time=numbers(30), wrench=numbers(30, 2, 6)),
        friction=0.9 if role == "trial" else None,
        provenance='{"file": "größe.c3d"}',
    )


def interaction():
    per_event = CompliancePerEvent(
        recording=("a", "b"),
        joint_names=("hinge",),
        onset=numbers(2),
        compliance=numbers(2, 1),
        standard_error=numbers(2, 1),
        status=np.array([[0], [1]]),
        r_squared=numbers(2, 1, 3),
        torque_change=numbers(2, 1),
        angle_before=numbers(2, 1, 2),
        angle_after=numbers(2, 1, 2),
        torque_after=numbers(2, 1, 2),
        window=numbers(2),
    )
    summary = JointCompliance(
        joint_names=("hinge",),
        compliance=numbers(1),
        lower=np.array([-np.inf]),
        upper=np.array([np.inf]),
        accepted=np.array([1]),
        negative=np.array([1]),
        events=np.array([2]),
    )
    return Interaction(
        name="trial00",
        model=MODEL,
        time=numbers(TIME),
        compliance=numbers(TIME, NV),
        compliance_sd=numbers(TIME, NV),
        reference=numbers(TIME, NQ),
        reference_sd=numbers(TIME, NV),
        q=numbers(TIME, NQ),
        torque=numbers(TIME, NV),
        contact_names=("plate",),
        contact_force=numbers(TIME, 1, 3),
        contact_point=np.full((TIME, 1, 3), np.nan),
        per_event=per_event,
        summary=summary,
        friction=None,
        provenance="{}",
    )


def rollout(slots=2):
    return Rollout(
        name="bump",
        model=MODEL,
        scene="{}",
        time=numbers(TIME),
        q=numbers(TIME, NQ),
        reference=numbers(TIME, NQ),
        torque=numbers(TIME, NV),
        slot_names=tuple(f"slot{index}" for index in range(slots)),
        contact_force=numbers(TIME, slots, 3),
        contact_point=numbers(TIME, slots, 3),
        contact_normal=numbers(TIME, slots, 3),
        gap=numbers(TIME, slots),
        slip_state=np.ones((TIME, slots), dtype=int),
        equilibrium_error=numbers(TIME, NV),
        residual=numbers(TIME),
        status=np.zeros(TIME, dtype=int),
        margin=numbers(TIME),
    )


def session():
    catch = recording("catch00", "catch", "trial00", markers=4)
    return Session(name="day 1", subject="A", recordings=(recording(), catch))


def assert_identical(got, put):
    """Same tree, same static parts, same numbers, same dtypes; NaN equals NaN."""
    left, right = jax.tree_util.tree_flatten(got), jax.tree_util.tree_flatten(put)
    assert left[1] == right[1]
    for a, b in zip(left[0], right[0], strict=True):
        a, b = np.asarray(a), np.asarray(b)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("make", [recording, session, interaction, rollout], ids=lambda make: make.__name__)
def test_a_record_comes_back_identical(tmp_path, make):
    record = make()
    path = tmp_path / "folder" / "record.nc"
    record.save(path)
    assert record_kind(path) == type(record).__name__
    assert_identical(type(record).load(path), record)
    assert [file.name for file in path.parent.iterdir()] == ["record.nc"]


def test_empty_dimensions_come_back(tmp_path):
    record = recording(markers=0)
    record.save(tmp_path / "a.nc")
    assert_identical(Recording.load(tmp_path / "a.nc"), record)


def test_a_recording_is_a_session_of_one(tmp_path):
    recording().save(tmp_path / "a.nc")
    loaded = Session.load(tmp_path / "a.nc")
    assert len(loaded.recordings) == 1
    assert loaded.trials()[0].name == "trial00"


def test_catch_trials_are_found_by_the_trial_they_repeat():
    assert [item.name for item in session().catch_trials("trial00")] == ["catch00"]
    assert session().catch_trials("trial01") == ()
    shared = recording("catch01", "catch", ("trial00", "trial01"))
    both = dataclasses.replace(session(), recordings=(*session().recordings, shared))
    assert [item.name for item in both.catch_trials("trial00")] == ["catch00", "catch01"]
    assert [item.name for item in both.catch_trials("trial01")] == ["catch01"]
    assert recording().repeats == ()


def test_traced_records_are_saved_from_jax_arrays(tmp_path):
    record = jax.tree_util.tree_map(jax.numpy.asarray, interaction())
    record.save(tmp_path / "a.nc")
    assert_identical(Interaction.load(tmp_path / "a.nc"), record)


def test_single_precision_is_kept(tmp_path):
    record = eqx.tree_at(lambda item: item.gap, rollout(), np.float32([[0.1, 0.2]] * TIME))
    record.save(tmp_path / "a.nc")
    assert Rollout.load(tmp_path / "a.nc").gap.dtype == np.float32


def test_arrays_carry_units_and_names_for_other_programs(tmp_path):
    recording().save(tmp_path / "a.nc")
    with h5netcdf.File(tmp_path / "a.nc") as file:
        assert file.variables["contact_force"].attrs["units"] == "N"
        assert file.variables["contact_force"].dimensions == ("time", "contact", "axis")
        assert [str(name) for name in file.variables["marker_names"][...]] == ["m0", "m1", "m2"] or [
            name.decode() for name in file.variables["marker_names"][...]
        ] == ["m0", "m1", "m2"]


def test_the_wrong_kind_is_named(tmp_path):
    rollout().save(tmp_path / "a.nc")
    with pytest.raises(FileError, match=r"a\.nc: holds the record Rollout, not Interaction"):
        Interaction.load(tmp_path / "a.nc")


def test_missing_and_foreign_files(tmp_path):
    with pytest.raises(FileError, match=r"none\.nc: does not exist"):
        load_record(tmp_path / "none.nc", Rollout)
    with pytest.raises(FileError, match=r"none\.nc: does not exist"):
        Session.load(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("hello")
    with pytest.raises(FileError, match=r"text\.nc"):
        load_record(tmp_path / "text.nc", Rollout)
    with pytest.raises(FileError, match=r"text\.nc"):
        record_kind(tmp_path / "text.nc")
    with h5netcdf.File(tmp_path / "other.nc", "w") as file:
        file.attrs["format"] = "something else"
    with pytest.raises(FileError, match="is not an icjax record"):
        load_record(tmp_path / "other.nc", Rollout)


@pytest.mark.parametrize("part", [0.9, 0.5, 0.1])
def test_a_truncated_record_is_refused(tmp_path, part):
    rollout().save(tmp_path / "a.nc")
    data = (tmp_path / "a.nc").read_bytes()
    (tmp_path / "b.nc").write_bytes(data[: int(part * len(data))])
    with pytest.raises(FileError, match=r"b\.nc: is damaged"):
        Rollout.load(tmp_path / "b.nc")


def test_a_missing_variable_is_named(tmp_path):
    path = tmp_path / "a.nc"
    rollout().save(path)
    import h5py

    with h5py.File(path, "a") as file:
        del file["margin"]
    with pytest.raises(FileError, match=r"a\.nc: .*margin"):
        Rollout.load(path)


def test_a_failed_save_keeps_the_old_file_and_leaves_no_other(tmp_path, monkeypatch):
    path = tmp_path / "a.nc"
    rollout().save(path)
    before = path.read_bytes()
    wrong = eqx.tree_at(lambda item: item.margin, rollout(), numbers(TIME + 1))
    with pytest.raises(ValueError, match="margin has 12 entries along time, expected 11"):
        save_record(path, wrong)

    def full(*_):
        raise OSError("no space left on device")

    monkeypatch.setattr("os.replace", full)
    with pytest.raises(FileError, match=r"a\.nc: cannot be written: no space left"):
        save_record(path, rollout())
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc"]


def test_a_file_from_before_a_field_with_a_default_is_read(tmp_path):
    recording().save(tmp_path / "old.nc")
    with h5netcdf.File(tmp_path / "old.nc", "a") as file:
        del file.attrs["contact_kinds"]
    loaded = Recording.load(tmp_path / "old.nc")
    assert loaded.contact_kinds == ()
    assert loaded.normal_only == ()
