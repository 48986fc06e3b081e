"""What several commands share: the simulator, workers, films, figures."""

import json
import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.cli.main import parse
from surefoot.cli.options import (
    OnHardware,
    OnSimulator,
    OnTerrain,
    OnWorkers,
    check_seconds,
    film_episode,
    show_record,
)
from surefoot.cli.train import parse_train
from surefoot.config import Config, SimulationConfig
from surefoot.config.gait_table import gait_name
from surefoot.files import WriteError
from surefoot.robots.solo12 import solo12
from surefoot.viz.film import Recording
from surefoot.viz.renderer import RenderingUnavailable
from surefoot.workers import Workers


@dataclass(frozen=True)
class Report:
    share: float
    pushes: tuple[float, ...]
    file: Path


def test_a_record_is_printed_and_written(capsys, tmp_path):
    record = Report(np.nan, (0.5, 1.0), Path("a"))
    file = tmp_path / "figures.json"
    show_record(record, file)
    assert capsys.readouterr().out.splitlines() == [
        "share                  null",
        "pushes                 [0.5, 1.0]",
        'file                   "a"',
    ]
    assert json.loads(file.read_text()) == {"share": None, "pushes": [0.5, 1.0], "file": "a"}


def test_a_record_is_written_before_it_is_printed(monkeypatch, tmp_path):
    class Full:
        def write(self, text: str) -> int:
            raise OSError("disk full")

        def flush(self) -> None:
            pass

    file = tmp_path / "figures.json"
    monkeypatch.setattr("sys.stdout", Full())
    with pytest.raises(OSError, match="disk full"):
        show_record(Report(0.5, (), Path("a")), file)
    assert json.loads(file.read_text())["share"] == 0.5


def test_a_record_that_cannot_be_written_is_printed(capsys, tmp_path):
    with pytest.raises(WriteError):
        show_record(Report(0.5, (), Path("a")), tmp_path)
    assert "0.5" in capsys.readouterr().out


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


def test_a_film_that_cannot_be_made_is_said(capsys, monkeypatch, tmp_path):
    def fail(*_: object) -> Path:
        raise RenderingUnavailable("no EGL")

    robot = solo12()
    recording = Recording(robot, SimulationConfig(), np.tile(robot.nominal, (10, 1)))
    out = tmp_path / "folder" / "film.mp4"
    monkeypatch.setattr("surefoot.viz.film.contact_sheet", fail)
    assert not film_episode(recording, out, "title")
    assert capsys.readouterr().err == "no video: no EGL\n"
    monkeypatch.setattr("surefoot.viz.film.contact_sheet", lambda recording, path: path)
    monkeypatch.setattr("surefoot.viz.film.film", lambda recording, path, title: path)
    assert film_episode(recording, out, "title")
    assert capsys.readouterr().out == f"frames: {out.with_suffix('.png')}\nvideo:  {out}\n"


def test_nothing_is_written_beside_a_stream(monkeypatch, tmp_path):
    robot = solo12()
    recording = Recording(robot, SimulationConfig(), np.tile(robot.nominal, (10, 1)))
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    films = []
    monkeypatch.setattr("surefoot.viz.film.film", lambda recording, path, title: films.append(path))
    film_episode(recording, pipe, "title")
    assert films == [pipe]
    assert list(tmp_path.iterdir()) == [pipe]


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
