"""The command make-starts, without the minutes that a set takes."""

from dataclasses import replace

import numpy as np
import pytest
import tyro

from surefoot.cli import make_starts
from surefoot.cli.make_starts import MakeStarts, parse_make_starts
from surefoot.config import CommandBox, Config, PerturbationConfig
from surefoot.mpc.gaits import GAITS
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios import make
from surefoot.scenarios.starts import StartSet, load_starts


def command(*args) -> MakeStarts:
    kind = tyro.conf.AvoidSubcommands[MakeStarts]
    return tyro.cli(kind, args=[str(arg) for arg in args])


@pytest.fixture
def asked(monkeypatch) -> list:
    """What was asked of the function that makes sets."""
    calls = []

    def fake(name, config, perturbation, seed) -> StartSet:
        calls.append((name, config, perturbation, seed))
        stored = load_starts()
        return StartSet(name, stored.grid, stored.shape)

    monkeypatch.setattr(make, "make_starts", fake)
    return calls


def test_a_set_is_made_and_written(asked, tmp_path, capsys):
    out = tmp_path / "wide.npz"
    assert command(out, "--scale", "1.5")() == 0
    ((name, config, perturbation, seed),) = asked
    assert (name, config, seed) == ("wide", with_own_values(Config()), make.SEED)
    assert perturbation.joint_position == pytest.approx(0.3)
    assert perturbation.max_penetration == PerturbationConfig().max_penetration
    back = load_starts(out)
    assert back.hash == load_starts().hash
    assert back.name == "wide"
    printed = capsys.readouterr().out
    count = sum(int(np.prod(shape)) for shape in back.shape.values())
    assert f"{out}: {count} initial states, hash {back.hash}" in printed


def test_seed_and_simulator_are_handed_on(asked, tmp_path):
    command(tmp_path / "a.npz", "--seed", "5", "--sim", "bullet")()
    ((_, config, _, seed),) = asked
    assert (config.simulation.backend, seed) == ("bullet", 5)


def test_an_existing_set_is_refused_before_any_work(asked, tmp_path):
    out = tmp_path / "a.npz"
    out.write_bytes(b"precious")
    with pytest.raises(FileExistsError, match="never changed: use a new name"):
        command(out)()
    assert asked == []
    assert out.read_bytes() == b"precious"


@pytest.fixture
def measured(monkeypatch) -> None:
    """Gains without the seconds that they take."""

    def fake(config: Config) -> Config:
        return replace(config, expert=replace(config.expert, command_gain=(1.1, 1.2, 1.3)))

    monkeypatch.setattr(make_starts, "with_measured_gains", fake)


def test_a_set_of_another_gait_is_made_with_its_rules_and_gains(asked, measured, tmp_path, capsys):
    args = [str(tmp_path / "walk.npz"), "--gait", "walk", "--config.expert.centroidal.nodes", "15"]
    assert parse_make_starts(args)() == 0
    ((_, config, _, _),) = asked
    assert config.gait.timing == GAITS["walk"].timing
    assert config.expert.command_gain == (1.1, 1.2, 1.3)
    assert config.expert.turn_compensation == 0.3
    # What is given comes before what belongs to the gait.
    assert (config.expert.centroidal.nodes, config.expert.kinematic.nodes) == (15, None)
    assert "measured: --config.expert.command-gain 1.1 1.2 1.3" in capsys.readouterr().out


def test_gains_that_were_given_are_not_measured(monkeypatch):
    monkeypatch.setattr("surefoot.scenarios.calibration.calibrated", None)  # not to be called
    expert = replace(Config().expert, command_gain=(1.2, 1.2, 1.2))
    config = Config(expert=expert)
    assert make_starts.with_measured_gains(config) is config


def test_a_box_of_commands_gets_rules_that_do_not_drift(asked, measured, tmp_path):
    args = [str(tmp_path / "box.npz"), "--config.commands.vy", "-0.1", "0.1"]
    assert parse_make_starts(args)() == 0
    ((_, config, _, _),) = asked
    assert config.commands == CommandBox(vy=(-0.1, 0.1))
    assert config.expert.turn_compensation == 0.3


def test_a_set_of_another_robot_is_made_with_rules_that_do_not_drift(asked, measured, tmp_path):
    args = [str(tmp_path / "dog.npz"), "--robot", "go2"]
    assert parse_make_starts(args)() == 0
    ((_, config, _, _),) = asked
    assert config.robot.model == "go2"
    assert config.expert.turn_compensation == 0.3
    assert config.expert.command_gain == (1.1, 1.2, 1.3)


def test_the_trot_is_made_as_ever_by_its_name_too(asked, tmp_path):
    assert parse_make_starts([str(tmp_path / "trot.npz"), "--gait", "trot"])() == 0
    ((_, config, _, _),) = asked
    assert config == with_own_values(Config())


def test_without_a_file_it_is_asked_for(capsys):
    with pytest.raises(SystemExit):
        parse_make_starts(["--gait", "walk"])
    assert "OUT" in capsys.readouterr().err.upper()
