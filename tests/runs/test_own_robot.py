"""A run's copy of its robot's description, which serves where the original is gone or edited."""

import shutil
from dataclasses import replace

import pytest

from surefoot.config import CommandBox, Config, RobotConfig
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import GO2
from surefoot.files import write_json
from surefoot.robots.description import find_urdf
from surefoot.robots.identity import content_hash
from surefoot.robots.load import load_robot
from surefoot.runs.first_stage import without_files
from surefoot.runs.layout import RunError
from surefoot.runs.run import config_for, create, open_run
from surefoot.scenarios import prepare as module
from surefoot.scenarios.starts import starts_of
from surefoot.study.comparable import check_comparable
from tests.fakes.learning import FLOAT32
from tests.fakes.runs import collected_record
from tests.fakes.walks import SMALL, fake_walks

__all__ = ["fake_walks"]


@pytest.fixture
def asked(fake_walks, monkeypatch, tmp_path) -> Config:
    """A run of a robot whose description lies in a folder of the user's."""
    whole = module.prepare
    monkeypatch.setattr(module, "prepare", lambda config: whole(config, sizes=SMALL))
    (tmp_path / "mine").mkdir()
    urdf = tmp_path / "mine" / "mine.urdf"
    shutil.copy(find_urdf(GO2), urdf)
    robot = RobotConfig("mine", spec=replace(GO2, name="mine", urdf=str(urdf)))
    return Config(robot=robot, commands=CommandBox(vx=(-0.2, 0.6)), training=FLOAT32)


@pytest.fixture
def begun(asked, tmp_path):
    run = create(tmp_path / "run", asked)
    run.append_metrics(collected_record(0))
    return run


def test_the_original_is_used_while_it_is_there_and_the_same(asked, begun):
    assert open_run(begun.folder).config.robot.spec == asked.robot.spec


def test_a_run_goes_on_where_the_description_has_moved(asked, begun, tmp_path):
    before = load_robot(begun.config.robot)
    hash_before = starts_of(begun.config).hash
    shutil.rmtree(tmp_path / "cache")
    (tmp_path / "mine").rename(tmp_path / "other")
    moved = begun.folder.rename(tmp_path / "moved")
    own = open_run(moved).config
    assert load_robot(own.robot).urdf == moved / "robot.urdf"
    assert (load_robot(own.robot).nominal == before.nominal).all()
    assert starts_of(own).hash == hash_before
    assert create(moved, asked, resume=True).config == own  # asked for as it was
    there = replace(asked.robot.spec, urdf=str(tmp_path / "other" / "mine.urdf"))
    again = replace(asked, robot=replace(asked.robot, spec=there))
    assert create(moved, again, resume=True).config == own


def test_a_run_that_was_asked_for_by_a_file_goes_on_by_it(asked, tmp_path):
    file = tmp_path / "mine" / "mine.json"
    write_json(file, to_json(replace(asked.robot.spec, urdf="mine.urdf")))
    by_file = replace(asked, robot=RobotConfig(str(file)))
    run = create(tmp_path / "run", by_file)
    run.append_metrics(collected_record(0))
    assert create(run.folder, by_file, resume=True).config == run.config
    (tmp_path / "mine" / "mine.urdf").unlink()
    own = create(run.folder, by_file, resume=True).config
    assert own == open_run(run.folder).config
    assert load_robot(own.robot).urdf == run.folder / "robot.urdf"


def test_two_runs_of_one_robot_are_alike_whatever_copies_they_use(asked, tmp_path):
    runs = [create(tmp_path / name, asked) for name in ("a", "b")]
    shutil.rmtree(tmp_path / "mine")
    one, other = (open_run(run.folder).config for run in runs)
    assert one.robot != other.robot
    assert without_files(one).robot == without_files(other).robot
    check_comparable(open_run(runs[0].folder), open_run(runs[1].folder))


def test_an_edited_description_does_not_change_the_run(asked, begun):
    before = content_hash(begun.config.robot)
    urdf = load_robot(asked.robot).urdf
    urdf.write_text(urdf.read_text().replace("0.089", "0.09"))
    assert content_hash(asked.robot) != before
    assert content_hash(open_run(begun.folder).config.robot) == before
    with pytest.raises(RunError, match="holds a run with another configuration"):
        create(begun.folder, asked, resume=True)


def test_a_run_of_another_robot_or_with_other_commands_is_told_apart_before_any_work(asked, begun):
    """Not by its initial states, of which nobody may have said anything."""
    text = r"run holds a run of the robot mine, not of solo12\. Resume it with --robot and .*--run$"
    with pytest.raises(RunError, match=text):
        config_for(begun.folder, Config(training=FLOAT32), resume=True)
    other = replace(asked, commands=CommandBox(vx=(-0.2, 0.4)))
    with pytest.raises(RunError, match=r"another configuration: commands\.vx "):
        config_for(begun.folder, other)


def test_a_run_that_kept_nothing_is_not_resumed_as_another_one(asked, tmp_path):
    folder = tmp_path / "run"
    create(folder, asked)
    files = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(RunError, match=r"run of the robot mine, .* without --resume it begins"):
        create(folder, Config(training=FLOAT32), resume=True)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == files
    # Asked for anew, it begins anew: nothing is lost.
    assert create(folder, Config(training=FLOAT32)).config.robot.model == "solo12"
    assert not (folder / "robot.urdf").exists()
