"""What is shown of one robot: its report is printed and written, and its film is made or missed."""

import json
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from surefoot.cli.episodes import film_episode, show_record
from surefoot.config import SimulationConfig
from surefoot.files import WriteError
from surefoot.robots.solo12 import solo12
from surefoot.viz.film import Recording
from surefoot.viz.renderer import RenderingUnavailable


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
