"""The command prepare, without the seconds that walks take."""

import json

import pytest

from surefoot.cli.prepare import parse_prepare
from surefoot.config import CommandBox
from surefoot.scenarios import prepare as module
from surefoot.scenarios.starts import load_starts
from tests.fakes.walks import SMALL, fake_walks

__all__ = ["fake_walks"]
OPTIONS = ["--robot", "go2", "--gait", "trot", "--vx", "-0.2", "0.6", "--yaw-rate", "-0.5", "0.5"]


@pytest.fixture
def asked(fake_walks, monkeypatch) -> list:
    """What is prepared, in few states."""
    calls = []
    whole = module.prepare

    def fake(config, perturbation, seed):
        calls.append((config, perturbation, seed))
        return whole(config, perturbation, seed, SMALL)

    monkeypatch.setattr(module, "prepare", fake)
    return calls


def test_a_table_is_printed_and_the_file_named(surefoot, asked, capsys, tmp_path):
    report = tmp_path / "report.json"
    assert surefoot("prepare", *OPTIONS, "--json", report) == 0
    printed = capsys.readouterr().out
    assert "robot, gait:    go2, trot" in printed
    assert "vx -0.2 to 0.6, vy 0 to 0 m/s, yaw rate -0.5 to 0.5 rad/s" in printed
    assert "command gain:   1.25 1.25 1.25" in printed
    assert "30 nominal, 60 train, 20 select, 20 test" in printed
    values = json.loads(report.read_text())
    assert values["commands"] == {"vx": [-0.2, 0.6], "vy": [0, 0], "yaw_rate": [-0.5, 0.5]}
    assert values["starts_hash"] in printed
    assert load_starts(values["file"]).hash == values["starts_hash"]
    assert (values["tried"], values["fell"]) == (3, 0)
    assert surefoot("prepare", *OPTIONS) == 0
    assert "made before:    in" in capsys.readouterr().out


def test_bounds_that_are_given_are_shown(surefoot, asked, capsys):
    given = ["--config.safety.com-height", "0.17", "0.5", "--config.safety.roll-pitch", "12"]
    falls = ["--config.safety.fall-angle", "60", "--config.safety.knee", "-150", "-20"]
    assert surefoot("prepare", *OPTIONS, *given, *falls) == 0
    printed = capsys.readouterr().out
    assert "center of mass: above 0.17 m" in printed
    assert "within 12 deg; beyond 60 deg a fall" in printed
    assert printed.count("-150 to -20") == 4


def test_a_gait_that_stands_has_no_commands(surefoot, asked, capsys):
    assert surefoot("prepare", "--gait", "stand", "--vx", "0", "0.3") == 2
    assert "the gait stand goes nowhere, but the commands are --vx 0 0.3" in capsys.readouterr().err
    assert asked == []
    assert surefoot("prepare", "--gait", "stand") == 0
    assert surefoot("prepare", "--gaits", "trot", "stand") == 0
    boxes = [config.commands for config, _, _ in asked]
    assert boxes == [CommandBox((0.0, 0.0)), CommandBox(), CommandBox()]


def test_a_box_may_be_given_by_either_name(asked):
    parse_prepare(["--vy", "-0.1", "0.1"])()
    parse_prepare(["--config.commands.vy", "-0.1", "0.1"])()
    assert [config.commands for config, _, _ in asked] == [CommandBox(vy=(-0.1, 0.1))] * 2


def test_the_scale_and_the_seed_are_heard_and_the_gait_decides_about_the_rest(asked):
    parse_prepare(["--scale", "1.5", "--seed", "3", "--gait", "walk"])()
    [(config, perturbation, seed)] = asked
    assert (perturbation.base_position, seed) == (pytest.approx(0.15), 3)
    assert (config.gait.period, config.expert.centroidal.nodes) == (1.0, None)


def test_a_file_of_its_own_is_written_and_never_overwritten(surefoot, asked, capsys, tmp_path):
    out = tmp_path / "dog.npz"
    assert surefoot("prepare", *OPTIONS, "--out", out) == 0
    assert load_starts(out).robot == "go2"
    assert load_starts(out).preparation is not None
    before = out.read_bytes()
    assert surefoot("prepare", *OPTIONS, "--out", out) == 2
    assert "a set of starts is never changed: use a new name" in capsys.readouterr().err
    assert out.read_bytes() == before
    assert len(asked) == 1


def test_a_box_that_is_too_large_is_refused_with_the_largest(surefoot, asked, fake_walks, capsys):
    fake_walks.limit = 0.5
    assert surefoot("prepare", "--robot", "go2", "--vx", "0", "1") == 2
    assert "The largest box that works: --vx 0 0.4" in capsys.readouterr().err


@pytest.mark.parametrize("box", [("0.5", "0.1"), ("nan", "1"), ("0", "99")])
def test_a_box_that_is_reversed_or_no_numbers_is_refused(surefoot, asked, capsys, box):
    assert surefoot("prepare", "--vx", *box) == 2
    assert "commands.vx" in capsys.readouterr().err
    assert asked == []


def test_a_seed_that_is_none_is_refused_before_any_walk(surefoot, asked, capsys):
    assert surefoot("prepare", "--seed", -1) == 2
    assert "--seed is -1; use a number from 0 on" in capsys.readouterr().err
    assert asked == []


def test_several_gaits_are_prepared_each_alone(surefoot, asked, capsys, tmp_path):
    options = ["--robot", "go2", "--gaits", "trot", "walk", "--vx", "-0.2", "0.6"]
    report = tmp_path / "report.json"
    assert surefoot("prepare", *options, "--json", report) == 0
    printed = capsys.readouterr().out
    assert "robot, gait:    go2, trot" in printed
    assert "robot, gait:    go2, walk" in printed
    values = json.loads(report.read_text())["gaits"]
    assert [each["gait"] for each in values] == ["trot", "walk"]
    assert [config.other_gaits for config, _, _ in asked] == [(), ()]
    assert surefoot("prepare", *options, "--out", tmp_path / "one.npz") == 2
    message = capsys.readouterr().err
    assert "--out takes one gait" in message and "name one of them with --gait" in message
