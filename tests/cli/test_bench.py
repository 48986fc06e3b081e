"""The command bench: which measurement runs with which configuration, and what comes out."""

import json
from dataclasses import replace

import pytest

from surefoot.bench import end_to_end, engine, loop, plan, train
from surefoot.bench.end_to_end import BoundedTime, EndToEndSpeed, EvaluationSpeed
from surefoot.bench.engine import EngineSpeed
from surefoot.bench.loop import LoopTimes
from surefoot.bench.plan import PlanTimes, StageTimes, Times
from surefoot.bench.train import TrainSpeed
from surefoot.config import Config, simulated
from surefoot.config.presets import preset
from surefoot.runs.versions import versions
from surefoot.scenarios import prepare as preparation
from surefoot.scenarios.prepare import completed
from surefoot.study import expert_cells, expert_survey
from surefoot.workers import Workers
from tests.fakes.walks import SMALL, fake_walks

__all__ = ["fake_walks"]

TIMES = Times(2.0, 3.0, StageTimes(0.1, 0.2, 0.3, 0.4))
NODES = (20, 10)
PLAN = PlanTimes(5, NODES, TIMES, 9.0, TIMES, 8.0, NODES, TIMES, 7.0, TIMES, 6.0)
ENGINE = EngineSpeed(20, 6e4, 7.5e4, 1.25, 1.9, 0.8, 0.9)
TRAIN = TrainSpeed(256, 4.0, 6.0, 10.0, "float32", 1.0, 0.4, 3.0, 1.25)
LOOP = LoopTimes(5000, 200.0, 300.0, 190.0, 250.0, 120.0, 50.0, 90.0)
EVALUATION = EvaluationSpeed(100, 2, 5.0, 4.0, 1.25)
STAGE = BoundedTime(4.0, 2.0)
END_TO_END = EndToEndSpeed("dagger", 2, 13.0, STAGE, STAGE, STAGE, 1.0, 2.0, 7.5e4, 3.0, 99)
RECORDS = {
    "plan": PLAN,
    "engine": ENGINE,
    "train": TRAIN,
    "loop": LOOP,
    "evaluation": EVALUATION,
    "end_to_end": END_TO_END,
}


@pytest.fixture
def calls(monkeypatch) -> list[tuple]:
    """The arguments of each measurement, none of which is made."""
    made = []

    def replace_function(module, name: str) -> None:
        def measure(*args):
            made.append((name, *args))
            return RECORDS[name]

        monkeypatch.setattr(module, f"bench_{name}", measure)

    replace_function(plan, "plan")
    replace_function(engine, "engine")
    replace_function(train, "train")
    replace_function(loop, "loop")
    replace_function(end_to_end, "evaluation")
    replace_function(end_to_end, "end_to_end")
    return made


def test_without_a_name_everything_is_measured(surefoot, calls, capsys, tmp_path):
    file = tmp_path / "bench.json"
    args = ("--sim", "bullet", "--workers", 3, "--preset", "default", "--json", file)
    assert surefoot("bench", *args) == 0
    config = simulated(completed(Config()), "bullet")
    run = simulated(completed(preset("loco_safe_dagger", "default")), "bullet")
    assert calls == [
        ("plan", config),
        ("engine", config),
        ("train", config),
        ("loop", config),
        ("evaluation", config, Workers(3)),
        ("end_to_end", run, Workers(3)),
    ]
    figures = json.loads(file.read_text())
    assert list(figures) == ["versions", *RECORDS]
    assert figures["versions"] == versions("bullet")
    assert figures["plan"]["half_warm_plan_ms"]["stages"]["inverse_dynamics"] == 0.4
    assert figures["engine"]["floor_robot_ms_per_s"] == 7.5e4
    assert figures["end_to_end"]["collect"] == {"seconds": 4.0, "floor_seconds": 2.0}
    assert "floor" not in capsys.readouterr().out


def test_another_robot_is_prepared_and_measured(surefoot, fake_walks, monkeypatch, tmp_path):
    whole = preparation.prepare
    monkeypatch.setattr(preparation, "prepare", lambda config: whole(config, sizes=SMALL))
    measured = []

    def bench_plan(config):
        measured.append(config)
        return replace(PLAN, plans=len(plan.cold_plans(config, 2)))

    monkeypatch.setattr(plan, "bench_plan", bench_plan)
    file = tmp_path / "bench.json"
    assert surefoot("bench", "plan", "--robot", "go2", "--sim", "bullet", "--json", file) == 0
    assert json.loads(file.read_text())["plan"]["plans"] == 2
    [config] = measured
    assert (config.robot.model, config.simulation.backend) == ("go2", "bullet")
    assert config.expert.command_gain == pytest.approx((1.25, 1.25, 1.25))


@pytest.mark.parametrize("name", RECORDS)
def test_a_name_measures_only_that(surefoot, calls, tmp_path, name):
    file = tmp_path / "bench.json"
    assert surefoot("bench", name, "--json", file) == 0
    assert [call[0] for call in calls] == [name]
    assert list(json.loads(file.read_text())) == ["versions", name]


def test_numbers_are_printed_with_their_names_in_words(surefoot, calls, capsys):
    assert surefoot("bench", "engine") == 0
    assert capsys.readouterr().out.splitlines() == [
        "engine      batch                                 20",
        "engine      robot ms per s                     6e+04",
        "engine      lower bound robot ms per s       7.5e+04",
        "engine      ratio                               1.25",
        "engine      two processes                        1.9",
        "engine      plan share                           0.8",
        "engine      lower bound plan share               0.9",
    ]


def test_the_survey_of_the_expert_is_asked_with_the_options(
    surefoot, monkeypatch, capsys, tmp_path
):
    asked = []
    monkeypatch.setattr(expert_survey, "survey_expert", lambda *args: asked.append(args) or "cells")
    monkeypatch.setattr(expert_cells, "survey_table", lambda cells: f"table of {cells}")
    file = tmp_path / "expert.json"
    args = ("--episodes", 7, "--workers", 1, "--sim", "mujoco", "--json", file)
    assert surefoot("bench", "expert", *args) == 0
    assert asked == [(Config(), "mujoco", 7, Workers(1), file)]
    assert capsys.readouterr().out == "table of cells\n"


def test_the_survey_of_the_expert_is_of_solo12(surefoot, capsys):
    assert surefoot("bench", "expert", "--robot", "go2") == 2
    assert "bench expert measures Solo12's expert: leave --robot out" in capsys.readouterr().err


def test_what_is_measured_is_written_before_the_next_measurement(
    surefoot, calls, monkeypatch, tmp_path
):
    def fail(*args):
        raise RuntimeError("interrupted")

    monkeypatch.setattr(train, "bench_train", fail)
    file = tmp_path / "bench.json"
    assert surefoot("bench", "--json", file) == 2
    assert list(json.loads(file.read_text())) == ["versions", "plan", "engine"]


def test_a_configuration_that_end_to_end_would_ignore_is_refused(surefoot, calls, capsys):
    assert surefoot("bench", "end_to_end", "--config.seed", 7) == 2
    assert "--config does not change end_to_end" in capsys.readouterr().err
    assert not calls


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("plan", "--preset", "default"), "--preset is for end_to_end, not for plan"),
        (("expert", "--preset", "default"), "--preset is for end_to_end, not for expert"),
        (("--episodes", 3), "--episodes is for expert, not for all"),
    ],
)
def test_an_option_of_another_measurement_is_refused(surefoot, calls, capsys, args, message):
    assert surefoot("bench", *args) == 2
    assert message in capsys.readouterr().err
    assert not calls


def test_a_preset_is_looked_up_before_anything_is_measured(surefoot, calls, capsys):
    assert surefoot("bench", "--preset", "quik") == 2
    assert "did you mean 'quick'" in capsys.readouterr().err
    assert not calls
