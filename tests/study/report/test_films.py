"""Films of a study: whose policy is filmed, and what the page says of it."""

import re
from base64 import b64decode
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from surefoot.config import Config, RobotConfig
from surefoot.learning.policy_header import PolicyFileError
from surefoot.study.report import films
from surefoot.study.report.films import (
    Filmed,
    best_cells,
    film_policy,
    film_section,
    study_films,
)
from surefoot.study.results import read_results
from surefoot.viz.renderer import RenderingUnavailable


@pytest.fixture(scope="module")
def results(study_folder):
    return read_results(study_folder)


def successes_of(cell) -> int:
    test = cell.best_test("test")
    return test.robustness.successes


def test_the_run_that_succeeds_most_often_is_filmed(results):
    for technique, cell in best_cells(results):
        others = results.of(technique.name, "all")
        assert successes_of(cell) == max(successes_of(other) for other in others)


def test_every_technique_and_the_expert_are_pushed_alike(monkeypatch, results, capsys):
    filmed = []

    def film_policy(title, config, policy, run):
        filmed.append((title, policy is None))
        return Filmed(title, "stays up", 1.5, b"film")

    monkeypatch.setattr(films, "film_policy", film_policy)
    text = study_films(results)
    assert "films:" in capsys.readouterr().err
    assert filmed == [
        ("BC", False),
        ("LocoDAGGER 0.5", False),
        ("LocoDAGGER 0.8", False),
        ('<b>"Safe" & sound</b> $x$', False),
        ("expert", True),
    ]
    assert "<b>" not in text
    assert "a push of 1.5 N s to the left" in text
    contents = re.findall(r"base64,([^\"]*)", text)
    assert [b64decode(content) for content in contents] == [b"film"] * 5


@pytest.mark.parametrize(("robot", "impulse"), [("solo12", 1.5), ("go2", 9.65)])
def test_a_film_shows_the_ground_and_a_push_that_fits_the_robot(
    monkeypatch, tmp_path, robot, impulse
):
    asked = []
    ground = ("the ground of one robot",)
    q = np.zeros((1, 9, 19))

    def played(job):
        asked.append(job.episodes.disturbance.pushes.impulse)
        return SimpleNamespace(length=[9], failed=[False], q=q, ground=ground), None

    def film(recording, path, title, **_):
        asked.append(recording.ground)
        path.write_bytes(b"film")
        return path

    monkeypatch.setattr(films, "play_out", played)
    monkeypatch.setattr(films, "film", film)
    config = Config(robot=RobotConfig(model=robot))
    filmed = film_policy("BC", config, tmp_path / "policy.safetensors", "seed-0")
    assert filmed.impulse == pytest.approx(impulse, abs=0.01)
    np.testing.assert_allclose(asked[0], [[[0.0, filmed.impulse, 0.0]]])
    assert asked[1] is ground
    assert f"a push of {filmed.impulse:.3g} N s" in film_section([filmed])


def test_the_expert_that_is_filmed_is_the_one_that_was_measured(monkeypatch):
    asked = []

    class Asked(Exception):
        """The film is not made."""

    def played(job):
        asked.append(job.config)
        raise Asked

    def completed(config):
        return replace(config, expert=replace(config.expert, command_gain=(1.1, 1.0, 1.2)))

    monkeypatch.setattr(films, "play_out", played)
    monkeypatch.setattr(films, "completed", completed)
    config = Config(robot=RobotConfig(model="go2"))
    with pytest.raises(Asked):
        film_policy("expert", config, None, "seed-0")
    assert asked[0].expert.command_gain == (1.1, 1.0, 1.2)


def test_without_a_policy_there_are_no_films(results):
    cells = tuple(replace(cell, policy=None) for cell in results.cells)
    assert study_films(replace(results, cells=cells)) == ""
    assert film_section([]) == ""


def test_a_report_needs_no_simulator_that_is_not_installed(monkeypatch, results, caplog):
    def missing(*_):
        raise ImportError("the simulator 'bullet' needs PyBullet")

    monkeypatch.setattr(films, "film_policy", missing)
    assert not study_films(results)
    assert "the report has no films: the simulator 'bullet' needs PyBullet" in caplog.text


def test_a_damaged_policy_leaves_the_other_films(monkeypatch, results, caplog):
    def film_policy(title, config, policy, run):
        if title == "BC":
            raise PolicyFileError("cut short")
        return Filmed(title, "stays up", 1.5, b"film")

    monkeypatch.setattr(films, "film_policy", film_policy)
    assert study_films(results).count("<video") == 4
    assert "the report has no film of BC: cut short" in caplog.text


def test_where_nothing_can_be_drawn_the_report_has_no_films(monkeypatch, results, caplog):
    def film_policy(*arguments):
        raise RenderingUnavailable("no OpenGL")

    monkeypatch.setattr(films, "film_policy", film_policy)
    assert study_films(results) == ""
    assert "no OpenGL" in caplog.text
