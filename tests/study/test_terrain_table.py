"""Controllers on several grounds: what is measured, what is kept, and the table."""

from dataclasses import replace

import numpy as np
import pytest

import surefoot.study.terrain_table as module
from surefoot.config import (
    Config,
    EvaluationConfig,
    ExpertConfig,
    OtherGait,
    RobotConfig,
    SafetyConfig,
)
from surefoot.config.gait_table import GAITS
from surefoot.config.json_io import from_json, to_json
from surefoot.config.profiles import ODRI
from surefoot.config.study import EXPERT
from surefoot.files import write_json
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.study.terrain_table import (
    TerrainCell,
    TerrainTable,
    Walker,
    key_of_cell,
    lag,
    measure_terrains,
    on,
    terrain_page,
)
from surefoot.workers import Workers
from tests.fakes.results import robustness
from tests.fakes.rollouts import summary_of

CONFIG = Config(evaluation=EvaluationConfig(duration=0.3, episodes=2))
GROUNDS = ("flat", "slope:10")


@pytest.fixture
def measured(monkeypatch) -> list:
    """What was evaluated: ground and policy."""
    calls = []

    def evaluate(config, policy, split, workers):
        calls.append((config.simulation.terrain, policy, split, config.evaluation.episodes))
        command = np.array([[0.2, 0.0, 0.0], [0.0, 0.0, 0.0]])
        velocity = np.array([[0.15, 0.01, 0.0], [0.1, 0.0, 0.0]])
        outcomes = [Outcome.SUCCESS] * 2
        summary = summary_of(outcomes, command=command, mean_velocity=velocity)
        return robustness(2, 2, covered=1), summary

    monkeypatch.setattr(module, "evaluate", evaluate)
    return calls


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / "mixed.safetensors"
    path.write_bytes(b"weights")
    return path


def test_every_controller_is_measured_on_every_ground(measured, policy):
    walkers = [Walker(EXPERT), Walker("mixed", policy)]
    kept = []
    table = measure_terrains(CONFIG, walkers, GROUNDS, Workers(1), keep=kept.append)
    assert measured == [(text, path, "test", 2) for text in GROUNDS for path in (None, policy)]
    assert [len(each.cells) for each in kept] == [1, 2, 3, 4]
    assert kept[-1] == table
    assert from_json(TerrainTable, to_json(table)) == table
    page = terrain_page(table)
    assert "| ground | expert | mixed |" in page
    assert "| `slope:10` | 2 up, 1 covered; 0.050, 0.050 | 2 up, 1 covered; 0.050, 0.050 |" in page
    assert page.startswith("2 `test` initial states on each ground")
    assert "| `slope:10` | 2 up, 1 covered; 0.050, 0.050 | - |" in terrain_page(kept[2])


def test_what_was_measured_is_kept_unless_it_depends_on_something_else(measured, policy):
    walkers = [Walker(EXPERT), Walker("mixed", policy)]
    table = measure_terrains(CONFIG, walkers, GROUNDS, Workers(1))
    measured.clear()
    renamed = [Walker(EXPERT), Walker("other", policy)]
    again = measure_terrains(CONFIG, renamed, (*GROUNDS, "stairs:0.03"), Workers(1), table)
    assert [(text, path) for text, path, *_ in measured] == [
        ("stairs:0.03", None),
        ("stairs:0.03", policy),
    ]
    assert {cell.label for cell in again.cells} == {EXPERT, "other"}
    measured.clear()
    policy.write_bytes(b"other weights")
    measure_terrains(CONFIG, walkers, GROUNDS, Workers(1), table)
    assert [path for _, path, *_ in measured] == [policy, policy]
    measured.clear()
    longer = replace(CONFIG, evaluation=EvaluationConfig(duration=0.4, episodes=2))
    measure_terrains(longer, walkers[:1], GROUNDS, Workers(1), table)
    assert len(measured) == 2


def test_cells_that_are_not_asked_for_or_not_reached_are_kept(measured, policy):
    walkers = [Walker(EXPERT), Walker("mixed", policy)]
    known = measure_terrains(CONFIG, walkers, GROUNDS, Workers(1))
    kept = []
    again = measure_terrains(CONFIG, walkers[1:], GROUNDS[1:], Workers(1), known, kept.append)
    assert again.cells == known.cells[-1:]
    [every] = kept
    assert set(every.cells) == set(known.cells)
    assert every.cells[0] == again.cells[0]
    # A kill after the first measurement, before the known cells are passed again.
    kept.clear()
    terrains = ("stairs:0.03", *GROUNDS)
    measure_terrains(CONFIG, walkers, terrains, Workers(1), known, kept.append)
    assert [len(each.cells) for each in kept] == [5, 6, 6, 6, 6, 6]
    assert set(known.cells) <= set(kept[0].cells)


@pytest.mark.parametrize(
    "changed",
    [
        {"safety": SafetyConfig(body_contact=0.1)},
        {"safety": SafetyConfig(stepping_from=None)},
        {"robot": RobotConfig(profile=ODRI.name)},
    ],
)
def test_a_cell_depends_on_falls_steps_and_the_profile(changed):
    config = on(CONFIG, "slope:10")
    walker = Walker(EXPERT)
    assert key_of_cell(replace(config, **changed), walker) != key_of_cell(config, walker)


def test_a_cell_depends_on_what_is_in_a_file_of_a_profile(tmp_path):
    path = tmp_path / "mine.json"
    keys = set()
    for damping in (0.2, 0.3):
        write_json(path, replace(ODRI, name="mine", damping=damping))
        config = replace(on(CONFIG, "flat"), robot=RobotConfig(profile=str(path)))
        keys.add(key_of_cell(config, Walker(EXPERT)))
    assert len(keys) == 2


@pytest.mark.parametrize("room", ["rollouts", "evaluation", "mpc"])
def test_a_cell_depends_on_the_code_that_measures_it(room, monkeypatch):
    before = key_of_cell(on(CONFIG, "flat"), Walker(EXPERT))
    monkeypatch.setattr(module, "code_hash", lambda rooms: "other" if room in rooms else "same")
    assert key_of_cell(on(CONFIG, "flat"), Walker(EXPERT)) != before
    assert room in module.MEASURING


def test_policies_of_several_gaits_are_measured_from_the_states_of_each(measured, tmp_path):
    path = tmp_path / "bound.npz"
    save_starts(replace(load_starts(), gait=GAITS["bound"]), path)
    other = OtherGait(GAITS["bound"], ExpertConfig(command_gain=(1.0, 1.0, 1.0)), str(path))
    several = replace(CONFIG, other_gaits=(other,))
    table = measure_terrains(several, [Walker(EXPERT)], ("flat",), Workers(1))
    assert len(table.cells) == 1
    assert table.cells[0].key != key_of_cell(on(CONFIG, "flat"), Walker(EXPERT))
    measured.clear()
    lost = replace(several, other_gaits=(replace(other, start_set=None),))
    with pytest.raises(ValueError, match="there are no initial states"):
        measure_terrains(lost, [Walker(EXPERT)], ("flat",), Workers(1))
    assert measured == []


def test_names_that_are_the_same_and_grounds_that_are_none_are_refused(measured, policy):
    twice = [Walker("mixed"), Walker("mixed", policy)]
    with pytest.raises(ValueError, match="mixed, mixed: name each of them once"):
        measure_terrains(CONFIG, twice, GROUNDS, Workers(1))
    with pytest.raises(ValueError, match="flat, flat: name each of them once"):
        measure_terrains(CONFIG, twice[:1], ("flat", "flat"), Workers(1))
    with pytest.raises(ValueError, match="size -1; use 0 to 45 deg"):
        measure_terrains(CONFIG, twice[:1], ("flat", "slope:-1"), Workers(1))
    assert measured == []


def test_the_lag_is_that_of_successes_along_their_commands():
    command = np.array([[0.2, 0, 0], [0, -0.1, 0], [0.3, 0, 0], [0, 0, 0], [0.3, 0, 0]])
    velocity = np.array([[0.18, 0.5, 0], [0.5, -0.06, 0], [0.0, 0, 0], [-0.2, 0, 0], [0.0, 0, 0]])
    outcome = [Outcome.SUCCESS, Outcome.SUCCESS, Outcome.FELL, Outcome.SUCCESS, Outcome.STALLED]
    summary = summary_of(outcome, command=command, mean_velocity=velocity)
    assert lag(summary) == pytest.approx((0.03, 0.04), abs=1e-12)


def test_where_nobody_survives_there_is_no_lag_rather_than_one_of_0():
    assert lag(summary_of([Outcome.FELL])) is None
    cell = TerrainCell("k", "slope:10", "flat", robustness(0, 2, covered=0), None)
    table = TerrainTable((cell,))
    assert "| `slope:10` | 0 up, 0 covered; - |" in terrain_page(table)
    assert from_json(TerrainTable, to_json(table)) == table


def test_the_expert_walks_on_a_ground_for_real():
    config = replace(CONFIG, evaluation=EvaluationConfig(duration=0.1, episodes=1))
    table = measure_terrains(config, [Walker(EXPERT)], ("slope:10",), Workers(1))
    assert table.cells[0].robustness.episodes == 1
