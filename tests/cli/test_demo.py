"""The demo is train, evaluate and play in this order; it goes on, and stops where one fails."""

from pathlib import Path

import pytest

import surefoot.cli.demo as demo
from surefoot.cli.demo import Demo
from surefoot.cli.main import parse
from surefoot.cli.train import parse_train


@pytest.fixture
def steps(monkeypatch):
    """The steps that are done, as they are asked for, and the exit status of each."""
    done: list[tuple] = []
    status = {"train": 0, "evaluate": 0, "play": 0}

    def step(name):
        def begin(args):
            done.append((name, args))
            return lambda: status[name]

        return begin

    monkeypatch.setattr(demo, "parse_train", step("train"))
    monkeypatch.setattr(demo, "parse_evaluate", step("evaluate"))
    monkeypatch.setattr(demo, "Play", step("play"))
    return done, status


def test_it_trains_measures_and_films(steps, capsys):
    done, _ = steps
    assert Demo(run=Path("a"), workers=2)() == 0
    assert [name for name, _ in done] == ["train", "evaluate", "play"]
    train = done[0][1]
    assert done[1][1][0] == "a" and done[2][1] == Path("a")
    command = parse_train(train)
    assert (command.method, command.preset, command.run) == ("loco_safe_dagger", "quick", Path("a"))
    assert command.workers == 2 and not command.resume  # nothing is there to resume yet
    printed = capsys.readouterr().out
    assert "surefoot play a --vx 0.3" in printed


def test_the_suggestions_are_commands(steps, capsys, tmp_path):
    Demo(run=tmp_path)()
    lines = capsys.readouterr().out.splitlines()
    suggested = [
        line.split("surefoot ")[1].split("  ")[0] for line in lines if "  surefoot " in line
    ]
    assert len(suggested) == 3
    for command in suggested:
        parse(command.split())


@pytest.mark.parametrize(("failing", "names"), [("train", 1), ("evaluate", 2), ("play", 3)])
def test_it_stops_where_a_step_fails(steps, failing, names):
    done, status = steps
    status[failing] = 1
    assert Demo(run=Path("a"))() == 1
    assert len(done) == names


@pytest.mark.parametrize(
    ("robot", "folder"),
    [(None, "demo"), ("solo12", "demo"), ("go2", "demo-go2"), ("own/b1.toml", "demo-b1")],
)
def test_each_robot_has_a_folder_of_its_own(steps, robot, folder, capsys):
    done, _ = steps
    Demo(robot=robot)()
    named = "" if robot is None else f" --robot {robot}"
    assert f"surefoot train loco_safe_dagger{named}  (" in capsys.readouterr().out
    assert done[2][1] == Path("runs") / folder
    assert (robot in done[0][1]) == (robot is not None)
