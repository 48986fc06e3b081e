"""Which policy a folder or a file means; one that does not fit its configuration is refused."""

import hashlib
import json
import logging
import re
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import pytest

import surefoot.cli.main as cli
from surefoot.config import CommandBox, Config, Gait, PolicyConfig, RobotConfig
from surefoot.config.gait_table import GAITS, gait_name, gait_names
from surefoot.config.json_io import to_json
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import GaitTiming, ObservationSpec, gait_timings
from surefoot.learning.policy import Policy, PolicySpec, load, save
from surefoot.methods.behavior_cloning import behavior_cloning
from surefoot.mpc.gaits import numbers_of
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import own_values, with_own_values
from surefoot.runs.layout import RunError
from surefoot.runs.policies import find_policy, safety_bounds
from surefoot.runs.run import Run, create, open_run
from surefoot.scenarios import prepare as prepare_module
from surefoot.scenarios.starts import starts_of
from surefoot.workers import Workers
from tests.fakes.learning import spec_of
from tests.fakes.small_runs import CLONING
from tests.fakes.walks import SMALL, fake_walks

__all__ = ["fake_walks"]
FORWARD = [[0.0, 0.0, 0.0], [0.3, 0.0, 0.0]]
"""The commands that Solo12's trot is trained on."""


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("finished") / "run", CLONING)
    behavior_cloning(run, Workers(1))
    return run


@pytest.fixture
def copy(finished, tmp_path) -> Run:
    """A finished run whose files a test may change."""
    shutil.copytree(finished.folder, tmp_path / "run")
    return open_run(tmp_path / "run")


def test_a_folder_means_its_best_policy_and_a_file_itself(finished):
    best = finished.best_policy_path
    assert find_policy(finished.folder) == (best, finished.config)
    assert find_policy(best) == (best.resolve(), finished.config)
    assert finished.config == with_own_values(CLONING)


def test_what_is_not_there_or_not_finished_is_an_error(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such run folder or policy file"):
        find_policy(tmp_path / "nothing")
    with pytest.raises(RunError, match="holds no run"):
        find_policy(tmp_path)
    with pytest.raises(RunError, match="the run is not finished"):
        find_policy(create(tmp_path / "run", CLONING).folder)


def test_of_a_run_a_study_keeps_the_best_policy_alone(copy):
    kept = copy.folder / "policy.safetensors"
    kept.write_bytes(copy.best_policy_path.read_bytes())
    shutil.rmtree(copy.folder / "policies")
    assert find_policy(copy.folder) == (kept, copy.config)
    assert find_policy(kept) == (kept, copy.config)


def rewrite(run: Run, **changes) -> None:
    path = run.folder / "config.json"
    values = json.loads(path.read_text())
    values["config"] = to_json(replace(run.config, **changes))
    path.write_text(json.dumps(values))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gait": Gait(period=0.4)}, r"a gait period \[ms\] 500, .*config.json has 400"),
        ({"policy": PolicyConfig((16, 16), kp=3.0)}, r"kp \[N m/rad\] 2.0, .*config.json has 3.0"),
        ({"policy": PolicyConfig((16, 16), kd=0.2)}, r"kd \[N m s/rad\] 0.1, .*has 0.2"),
        ({"policy": PolicyConfig((16, 16), phase="fraction")}, "a phase given as circle.*fraction"),
    ],
)
@pytest.mark.parametrize("command", ["evaluate", "play"])
def test_a_policy_of_another_period_gain_or_phase_is_refused(
    monkeypatch, capsys, copy, changes, message, command
):
    policy = copy.best_policy_path
    rewrite(copy, **changes)
    for target in (copy.folder, policy):
        monkeypatch.setattr(sys, "argv", ["surefoot", command, str(target)])
        assert cli.main() == 2
        error = " ".join(capsys.readouterr().err.split())
        assert re.search(message, error) and "in the folder of the run" in error, error


def test_a_policy_that_lies_in_no_run_brings_its_gains(finished, tmp_path, caplog):
    trained = load(finished.best_policy_path)
    config = PolicyConfig(trained.network.hidden, kp=2.5, kd=0.07, phase="fraction")
    policy = Policy(trained.network, spec_of(config), trained.command_range, "solo12")
    path = tmp_path / "elsewhere" / "policy.safetensors"
    save(policy, path)
    with caplog.at_level(logging.INFO, logger="surefoot"):
        assert find_policy(path) == (path, replace(with_own_values(Config()), policy=config))
    assert "lies in no run" in caplog.text
    assert "kp 2.5 N m/rad, kd 0.07 N m s/rad, phase as a fr" in caplog.text


def file_of(tmp_path, robot: str, *gaits: GaitTiming, commands=FORWARD, bounds=None) -> Path:
    """A policy file outside of any run."""
    config = PolicyConfig((16, 16), kp=2.5, kd=0.07)
    spec = PolicySpec(ObservationSpec("circle", gaits), 2.5, 0.07)
    network = PolicyNetwork(config, inputs=spec.observation.input_size)
    path = tmp_path / "elsewhere" / "policy.safetensors"
    save(Policy(network, spec, commands, robot, bounds=bounds), path)
    return path


def test_a_policy_that_lies_in_no_run_brings_its_robot_gait_and_commands(tmp_path):
    (walk,) = gait_timings([GAITS["walk"]])
    commands = [[-0.5, -0.2, 0.0], [0.5, 0.2, 0.0]]
    path, config = find_policy(file_of(tmp_path, "go2", walk, commands=commands))
    assert load(path).robot == config.robot.model == "go2"
    assert config.gait.timing == GAITS["walk"].timing
    assert config.commands == CommandBox((-0.5, 0.5), (-0.2, 0.2), (0.0, 0.0))
    # What is the robot's own is that of this one, and the horizon follows its gait.
    model = load_robot(config.robot)
    assert config.expert.kp == own_values(model).kp != with_own_values(Config()).expert.kp
    assert config.expert.centroidal.nodes is None
    assert config.policy.kp == 2.5


def test_a_policy_that_lies_in_no_run_brings_its_safety_bounds(tmp_path):
    robot = RobotConfig("go2")
    own = with_own_values(Config(robot=robot))
    joints = tuple((low - 7.0, high + 0.3) for low, high in own.safety.joints)
    wide = replace(own.safety, com_height=(0.2, 1.5), roll_pitch=33.3, joints=joints)
    trot = gait_timings([GAITS["trot"]])
    for safety in (own.safety, wide):
        bounds = safety_bounds(replace(own, safety=safety))
        _, config = find_policy(file_of(tmp_path, "go2", *trot, bounds=bounds))
        assert config.safety == safety


def test_what_lies_in_no_run_is_prepared_once(tmp_path, fake_walks, monkeypatch):
    whole = prepare_module.prepare
    monkeypatch.setattr(prepare_module, "prepare", lambda config: whole(config, sizes=SMALL))
    commands = [[-0.2, -0.1, 0.0], [0.6, 0.1, 0.0]]
    _, config = find_policy(
        file_of(tmp_path, "go2", *gait_timings([GAITS["trot"]]), commands=commands)
    )
    by_hand = prepare_module.prepare(
        Config(robot=RobotConfig("go2"), commands=CommandBox((-0.2, 0.6), (-0.1, 0.1)))
    )
    asked = len(fake_walks.asked)
    config = prepare_module.completed(config)
    assert len(fake_walks.asked) == asked
    assert starts_of(config).hash == by_hand.starts.hash
    assert config.expert.command_gain == by_hand.made.command_gain


def test_a_policy_of_a_gait_without_a_name_brings_its_timing(tmp_path):
    _, config = find_policy(file_of(tmp_path, "solo12", GaitTiming("custom", 400)))
    assert (config.gait.period, gait_name(config.gait)) == (0.4, "custom")


def test_gaits_without_a_name_are_told_apart(tmp_path):
    gaits = [Gait(period=0.4), GAITS["walk"], Gait(period=0.6), Gait(period=0.8)]
    names = gait_names(gaits)
    assert names == ("custom", "walk", "custom-2", "custom-3")
    _, config = find_policy(file_of(tmp_path, "solo12", *gait_timings(gaits)))
    assert numbers_of(config, names) == [0, 1, 2, 3]


def test_a_policy_of_several_gaits_brings_all_of_them(tmp_path):
    timings = gait_timings([GAITS[name] for name in ("walk", "trot", "pace")])
    path, config = find_policy(file_of(tmp_path, "solo12", *timings))
    assert config.gaits[0].timing == GAITS["walk"].timing
    assert [gait_name(gait) for gait in config.gaits] == ["walk", "trot", "pace"]
    assert load(path).spec.observation.gaits == tuple(timings)
    # What the timing does not say is that of the gait of this name.
    assert config.gaits[2].step_height == GAITS["pace"].step_height


def test_a_policy_that_no_run_explains_is_refused(tmp_path):
    path = file_of(tmp_path, "b1", *gait_timings([GAITS["trot"]]))
    with pytest.raises(ValueError, match="'b1', whose description the package does not have"):
        find_policy(path)


def test_a_policy_that_a_study_has_kept_is_the_one_that_was_measured():
    kept = sorted((Path(__file__).parents[2] / "results").rglob("seed-*/policy.safetensors"))
    assert kept
    for path in kept:
        assert find_policy(path.parent)[0] == path
        measured = json.loads((path.parent / "tests" / "test.json").read_text())
        hashes = [policy["sha256"] for policy in measured["policies"]]
        assert hashlib.sha256(path.read_bytes()).hexdigest() in hashes
