"""Options that several commands share: the simulator, gaits, pushes, workers."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.cli.main import parse
from surefoot.cli.options import (
    OnHardware,
    OnPushes,
    OnSimulator,
    OnTerrain,
    OnWorkers,
    check_seconds,
)
from surefoot.cli.train import parse_train
from surefoot.config import Config, SimulationConfig
from surefoot.config.evaluation import shortened
from surefoot.config.gait_table import gait_name
from surefoot.robots.scaling import with_own_values
from surefoot.workers import Workers

PUSH = with_own_values(Config()).push


@pytest.mark.parametrize("seconds", [0.0, -1.0, 0.0005, 3601.0, 1e12, np.inf, np.nan])
def test_a_duration_of_no_tick_or_of_hours_is_refused(seconds):
    with pytest.raises(ValueError, match=r"--seconds .*: use at least 0.001 s, and at most 3600 s"):
        check_seconds(seconds)


def test_the_workers_are_those_asked_for():
    assert OnWorkers(workers=3, backend="ray", ray_address="auto").spread == Workers(
        3, "ray", "auto"
    )


@pytest.mark.parametrize(
    "args",
    [
        ["train", "behavior_cloning"],
        ["evaluate", "run"],
        ["compare", "run"],
        ["play", "run"],
        ["bench", "plan"],
        ["walk"],
        ["gate-warnings", "run"],
        ["prepare"],
        ["doctor"],
    ],
)
def test_each_command_takes_a_simulator(args):
    command = parse([*args, "--sim", "bullet"])
    assert isinstance(command, OnSimulator)
    assert command.simulated(Config()) == Config(simulation=SimulationConfig("bullet"))
    assert replace(command, sim=None).simulated(Config()) == Config()


@pytest.mark.parametrize("args", [["evaluate", "run"], ["play", "run"], ["walk"]])
def test_each_command_takes_a_terrain(args):
    command = parse([*args, "--terrain", "bumps:0.01..0.03,slope:10"])
    assert isinstance(command, OnTerrain)
    expected = SimulationConfig(terrain="bumps:0.01..0.03,slope:10")
    assert command.on_terrain(Config()) == Config(simulation=expected)
    assert replace(command, terrain=None).on_terrain(Config()) == Config()
    with pytest.raises(ValueError, match="there is no terrain 'rocks'; did you mean 'blocks'"):
        replace(command, terrain="rocks:1").on_terrain(Config())


def test_a_hardware_profile_is_put_into_the_configuration():
    config = Config()
    assert OnHardware().with_profile(config) is config
    assert OnHardware(profile="odri").with_profile(config).robot.profile == "odri"
    with pytest.raises(ValueError, match="did you mean 'odri'"):
        OnHardware(profile="ordi").with_profile(config)
    go2 = replace(config, robot=replace(config.robot, model="go2"))
    with pytest.raises(ValueError, match="belongs to the robot solo12, not to go2"):
        OnHardware(profile="odri").with_profile(go2)


def test_several_gaits_are_options_of_any_number():
    train = parse_train(
        [
            "loco_safe_dagger",
            "--gaits",
            "walk",
            "bound",
            "trot",
            "--preset",
            "quick",
            "--vx",
            "0",
            "0.2",
        ]
    )
    assert [gait_name(gait) for gait in train.config.gaits] == ["walk", "bound", "trot"]
    one = parse_train(["loco_safe_dagger", "--gaits", "walk"])
    assert one.config == parse_train(["loco_safe_dagger", "--gait", "walk"]).config
    again = parse_train(["loco_safe_dagger", "--gaits", "bound", "trot", "--gaits", "walk"])
    assert again == one


def test_no_gait_may_be_said_in_words():
    default = parse_train(["loco_safe_dagger"])
    assert parse_train(["loco_safe_dagger", "--gait", "None"]) == default
    assert parse_train(["loco_safe_dagger", "--gaits", "None"]) == default
    alone = parse_train(["loco_safe_dagger", "--gait", "None", "--gaits", "walk"])
    assert alone.config == parse_train(["loco_safe_dagger", "--gait", "walk"]).config


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--gait", "trot", "--gaits", "walk", "trot"], "use one of the two options"),
        (["--gaits", "walk", "trott"], "'trott'"),
        (["--gaits", "walk", "walk"], "name each of them once"),
    ],
)
def test_gaits_that_cannot_be_are_refused(args, words):
    with pytest.raises(ValueError, match=words):
        parse_train(["loco_safe_dagger", *args])


@pytest.mark.parametrize(
    "args",
    [
        ["evaluate"],
        ["compare", "runs/a"],
        ["bench"],
        ["survey"],
        ["terrains"],
        ["gate-warnings", "runs/a"],
        ["study", "smoke"],
        ["demo"],
        ["learn", "--robot", "udp://127.0.0.1:5151"],
        ["train", "dagger"],
    ],
)
def test_workers_that_cannot_be_are_refused_when_the_options_are_read(capsys, args):
    with pytest.raises(SystemExit):
        parse([*args, "--workers", "0"])
    assert "0 workers; use at least 1" in capsys.readouterr().err


def test_without_options_the_pushes_are_those_of_the_run():
    assert OnPushes().shortened(PUSH) == PUSH
    own = replace(PUSH, speeds=3, before=0.5)
    assert OnPushes(push_directions=4).shortened(own) == replace(own, directions=4)


@pytest.mark.parametrize(
    ("resolution", "levels"), [(0.2, 30), (0.4, 15), (0.8, 8), (0.1, 60), (100.0, 1)]
)
def test_coarser_levels_reach_about_as_far(resolution, levels):
    pushes = OnPushes(push_resolution=resolution).shortened(PUSH)
    assert pushes == replace(PUSH, resolution=resolution, levels=levels)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"speeds": 0}, "push.speeds"),
        ({"directions": 361}, "push.directions"),
        ({"resolution": 0.0}, "push.resolution"),
        ({"resolution": -1.0}, "push.resolution"),
        ({"resolution": float("nan")}, "push.resolution"),
    ],
)
def test_numbers_out_of_range_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        shortened(PUSH, **options)


def test_options_need_pushes():
    OnPushes(push_speeds=2).check_pushed(True, "push")
    OnPushes().check_pushed(False, "push")
    with pytest.raises(ValueError, match="--push-speeds, --push-resolution without pushes; push"):
        OnPushes(push_speeds=2, push_resolution=0.5).check_pushed(False, "push")
