"""A run's own initial states: copied when it begins, its own from then on, compared on resume."""

import json
import shutil
from dataclasses import replace

import pytest

from surefoot.config import CommandBox, Config, ExpertConfig, OtherGait, RobotConfig
from surefoot.config.gait_table import GAITS, gait_name
from surefoot.config.single_gaits import each_gait
from surefoot.mpc.gaits import with_gait, with_gaits
from surefoot.runs.first_stage import first_stage
from surefoot.runs.layout import RunError
from surefoot.runs.run import config_for, create, open_run
from surefoot.scenarios import prepare as module
from surefoot.scenarios.gaits import all_starts_of
from surefoot.scenarios.starts import load_starts, starts_of
from tests.fakes.learning import FLOAT32
from tests.fakes.runs import collected_record
from tests.fakes.walks import SMALL, fake_walks

__all__ = ["fake_walks"]
GO2 = Config(
    robot=RobotConfig("go2"), commands=CommandBox(vx=(-0.2, 0.6)), training=FLOAT32, seed=5
)


@pytest.fixture
def small_sets(fake_walks, monkeypatch) -> None:
    whole = module.prepare
    monkeypatch.setattr(module, "prepare", lambda config: whole(config, sizes=SMALL))


@pytest.fixture
def begun(small_sets, tmp_path):
    """A run of a robot without a packaged set, that has collected."""
    run = create(tmp_path / "run", GO2)
    run.append_metrics(collected_record(0))
    return run


def test_a_run_keeps_a_copy_and_all_that_was_measured(begun):
    values = json.loads((begun.folder / "config.json").read_text())
    assert values["config"]["start_set"] == "starts.npz"
    stored = starts_of(begun.config)
    assert values["starts_hash"] == stored.hash
    assert stored.preparation is not None
    assert begun.config.expert.command_gain == stored.preparation.command_gain
    assert begun.config.safety.joints == stored.preparation.safety.joints
    assert open_run(begun.folder).config == begun.config


def test_a_run_is_resumed_and_moved_without_what_is_kept_elsewhere(begun, tmp_path, monkeypatch):
    shutil.rmtree(tmp_path / "cache")
    monkeypatch.setattr(module, "prepare", None)  # not to be called
    assert config_for(begun.folder, GO2) == begun.config
    assert create(begun.folder, GO2, resume=True).config == begun.config
    hash = starts_of(begun.config).hash
    moved = begun.folder.rename(tmp_path / "moved")
    assert starts_of(open_run(moved).config).hash == hash
    assert starts_of(create(moved, GO2, resume=True).config).hash == hash


def test_a_resumed_run_may_be_asked_for_with_the_same_states_in_another_file(begun, tmp_path):
    copy = tmp_path / "copy.npz"
    shutil.copy(begun.folder / "starts.npz", copy)
    again = create(begun.folder, replace(GO2, start_set=str(copy)), resume=True)
    assert again.config == begun.config


def test_other_initial_states_are_refused_on_resume(begun):
    other = module.prepare(replace(GO2, commands=CommandBox(vx=(-0.2, 0.5))))
    (begun.folder / "starts.npz").write_bytes(other.path.read_bytes())
    with pytest.raises(RunError, match="was begun with other initial states"):
        create(begun.folder, GO2, resume=True)
    (begun.folder / "starts.npz").unlink()
    with pytest.raises(RunError, match=r"the initial states of .* cannot be read"):
        create(begun.folder, GO2, resume=True)
    asked = replace(GO2, start_set=str(other.path))
    with pytest.raises(RunError, match="holds a run with another configuration"):
        create(begun.folder, asked, resume=True)


def test_a_run_that_has_not_begun_begins_anew_with_the_new_states(small_sets, tmp_path):
    first = create(tmp_path / "run", GO2)
    box = CommandBox(vx=(-0.2, 0.5))
    second = create(tmp_path / "run", replace(GO2, commands=box))
    stored = load_starts(second.folder / "starts.npz")
    assert stored.preparation is not None
    assert stored.preparation.commands == box
    assert first.config.start_set == second.config.start_set


def test_two_runs_with_their_own_copies_begin_alike(small_sets, tmp_path):
    runs = [create(tmp_path / name, GO2) for name in ("a", "b")]
    one, other = (first_stage(run.config, "data") for run in runs)
    assert runs[0].config.start_set != runs[1].config.start_set
    assert one == other


def test_a_packaged_set_is_not_copied(tmp_path):
    run = create(tmp_path / "run", Config(training=FLOAT32))
    assert not (run.folder / "starts.npz").exists()
    assert run.config.start_set == "solo12-trot-v1"


def test_a_run_of_several_gaits_keeps_the_states_of_each_and_is_resumed(small_sets, tmp_path):
    asked = with_gaits(GO2, ["trot", "walk"])
    begun = create(tmp_path / "run", asked)
    begun.append_metrics(collected_record(0))
    values = json.loads((begun.folder / "config.json").read_text())["config"]
    assert values["start_set"] == "starts.npz"
    assert [other["start_set"] for other in values["other_gaits"]] == ["starts-1.npz"]
    stored = all_starts_of(begun.config)
    assert [gait_name(each.gait) for each in stored.sets] == ["trot", "walk"]
    for one, made in zip(each_gait(begun.config), stored.sets, strict=True):
        assert made.preparation is not None
        assert one.expert.command_gain == made.preparation.command_gain
    assert create(begun.folder, asked, resume=True).config == begun.config
    moved = begun.folder.rename(tmp_path / "moved")
    assert all_starts_of(open_run(moved).config).hash == stored.hash
    with pytest.raises(RunError, match="another configuration"):
        create(moved, GO2, resume=True)
    with pytest.raises(RunError, match="another configuration"):
        create(moved, with_gaits(GO2, ["trot", "bound"]), resume=True)
    (moved / "starts-1.npz").unlink()
    with pytest.raises(RunError, match=r"the initial states of .* cannot be read"):
        create(moved, asked, resume=True)


def test_the_states_of_one_gait_among_several_are_those_of_it_alone(small_sets):
    alone = module.completed(with_gait(GO2, "walk"))
    among = module.completed(with_gaits(GO2, ["trot", "walk"]))
    assert among.other_gaits[0].start_set == alone.start_set
    assert among.other_gaits[0].expert == alone.expert
    trot = module.completed(GO2)
    assert (among.expert, among.start_set) == (trot.expert, trot.start_set)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        (OtherGait(replace(GAITS["walk"], period=0.333)), r"gait number 1 has a period of 0.333 s"),
        (
            OtherGait(GAITS["walk"], ExpertConfig(kp=12.0)),
            r"gait number 1 has expert\.kp 12.0, and the first one \d",
        ),
    ],
)
def test_gaits_that_a_robot_cannot_change_between_begin_no_run(
    small_sets, tmp_path, other, message
):
    with pytest.raises(ValueError, match=message):
        create(tmp_path / "run", replace(GO2, other_gaits=(other,)))


def test_the_stiffness_of_the_first_gait_is_that_of_all(small_sets, tmp_path):
    other = OtherGait(GAITS["walk"], ExpertConfig(via_until=0.7))
    stiff = replace(GO2, expert=replace(GO2.expert, kp=31.0), other_gaits=(other,))
    run = create(tmp_path / "run", stiff)
    assert [one.expert.kp for one in each_gait(run.config)] == [31.0, 31.0]


@pytest.mark.parametrize("copied", [False, True])
def test_more_gaits_than_a_run_has_are_another_configuration(begun, copied, tmp_path):
    asked = with_gaits(GO2, ["trot", "walk"])
    if copied:  # states that are neither packaged nor the run's own
        copy = tmp_path / "copy.npz"
        shutil.copy(begun.folder / "starts.npz", copy)
        asked = replace(asked, start_set=str(copy))
    with pytest.raises(RunError, match="holds a run with another configuration"):
        create(begun.folder, asked, resume=True)


def test_a_run_of_several_gaits_is_resumed_with_the_same_states_in_other_files(
    small_sets, tmp_path
):
    asked = with_gaits(GO2, ["trot", "walk"])
    begun = create(tmp_path / "run", asked)
    begun.append_metrics(collected_record(0))
    first = tmp_path / "first.npz"
    second = tmp_path / "second.npz"
    shutil.copy(begun.folder / "starts.npz", first)
    shutil.copy(begun.folder / "starts-1.npz", second)
    other = replace(asked.other_gaits[0], start_set=str(second))
    copied = replace(asked, start_set=str(first), other_gaits=(other,))
    assert create(begun.folder, copied, resume=True).config == begun.config
    # Of one set alone the copy is asked for, of the other one nothing is said.
    half = replace(asked, other_gaits=(other,))
    assert create(begun.folder, half, resume=True).config == begun.config


def test_of_several_sets_the_one_that_is_damaged_is_named(small_sets, tmp_path):
    asked = with_gaits(GO2, ["trot", "walk"])
    begun = create(tmp_path / "run", asked)
    begun.append_metrics(collected_record(0))
    own = begun.folder / "starts-1.npz"
    kept = own.read_bytes()
    own.write_bytes(b"")
    with pytest.raises(RunError, match=r"cannot be read.*Restore \S*starts-1\.npz from a copy"):
        create(begun.folder, asked, resume=True)
    changed = module.prepare(replace(with_gait(GO2, "walk"), commands=CommandBox(vx=(-0.2, 0.5))))
    own.write_bytes(changed.path.read_bytes())
    with pytest.raises(RunError, match=r"than those of \S*starts\.npz, \S*starts-1\.npz"):
        create(begun.folder, asked, resume=True)
    own.write_bytes(kept)
    assert create(begun.folder, asked, resume=True).config == begun.config
