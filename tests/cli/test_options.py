"""What several commands share: the simulator, workers, films, figures."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.cli.main import parse
from surefoot.cli.options import OnSimulator, OnWorkers, film_episode, show_record
from surefoot.config import Config, SimulationConfig
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
        ["make-starts", "new.npz"],
        ["doctor"],
    ],
)
def test_each_command_takes_a_simulator(args):
    command = parse([*args, "--sim", "bullet"])
    assert isinstance(command, OnSimulator)
    assert command.simulated(Config()) == Config(simulation=SimulationConfig("bullet"))
    assert replace(command, sim=None).simulated(Config()) == Config()


def test_films_that_cannot_be_made_are_no_error(capsys, monkeypatch, tmp_path):
    def fail(*_: object) -> Path:
        raise RenderingUnavailable("no EGL")

    robot = solo12()
    recording = Recording(robot, SimulationConfig(), np.tile(robot.nominal, (10, 1)))
    out = tmp_path / "folder" / "film.mp4"
    monkeypatch.setattr("surefoot.viz.film.contact_sheet", fail)
    film_episode(recording, out, "title")
    assert capsys.readouterr().err == "no video: no EGL\n"
    monkeypatch.setattr("surefoot.viz.film.contact_sheet", lambda recording, path: path)
    monkeypatch.setattr("surefoot.viz.film.film", lambda recording, path, title: path)
    film_episode(recording, out, "title")
    assert capsys.readouterr().out == f"frames: {out.with_suffix('.png')}\nvideo:  {out}\n"
