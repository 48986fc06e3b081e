"""Every episode of every method's run, played again alone: the same bits as what was collected."""

import json
import re
import shutil
import sys
from dataclasses import fields, replace

import numpy as np
import pytest

import surefoot.cli.main as cli
import surefoot.cli.play as play_command
from surefoot import methods
from surefoot.config import (
    Backend,
    SimulationConfig,
)
from surefoot.config.array_io import load_arrays
from surefoot.learning.frames import PART, whole_episode
from surefoot.rollouts.jobs import disturbance_of, play_out, summarize_job
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.layout import RunError
from surefoot.runs.run import Run, create, open_run
from surefoot.runs.stages import collect_data
from surefoot.types import MotionPlan
from surefoot.viz.replay import recorded_episode, report_episode
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.robots import needs_pybullet
from tests.fakes.small_runs import METHODS, config_of


@pytest.fixture(scope="module")
def run_of(tmp_path_factory):
    runs = {}

    def make(method: str, backend: Backend = "mujoco") -> Run:
        if (method, backend) not in runs:
            config = config_of(method)
            config = replace(config, simulation=SimulationConfig(backend))
            run = create(tmp_path_factory.mktemp(method) / "run", config)
            methods.METHODS[method].train(run, Workers(1), None)
            runs[method, backend] = open_run(run.folder)
        return runs[method, backend]

    return make


def summary_of(run: Run):
    return join_summaries(
        [load_arrays(run.summary_path(name), Summary) for name in run.dataset.shards]
    )


UNKNOWN_ALONE = ("kept", "kept_tilted", "kept_near_bounds", "strict")
"""Fields of a summary that need the frames kept, or are defined for successes only."""


@pytest.mark.parametrize(
    ("method", "backend"),
    [
        *first_often(1, ((method, "mujoco") for method in METHODS)),
        pytest.param("loco_dagger", "bullet", marks=[needs_pybullet, pytest.mark.thorough]),
    ],
)
def test_every_episode_repeats_bit_for_bit(run_of, method, backend):
    run = run_of(method, backend)
    frames = run.dataset.load()
    summary = summary_of(run)
    assert set(whole_episode(summary.episode) // 100_000) == set(
        range(1 if method == "behavior_cloning" else 3)
    )
    replayed = summary.episode >= 100_000
    replayed[::7] = True  # of the pre-training; all of the others
    for episode in summary.episode[replayed].tolist():
        job = recorded_episode(run.folder, episode)
        assert job.episode.tolist() == [episode]
        rollouts, expert = play_out(job)
        own = frames[frames.episode == episode]
        rows = own.tick - rollouts.starts.tick[0]
        for name in ("q", "v", "com", "feet", "contacts"):
            seen = getattr(rollouts.seen, name)[0, rows]
            np.testing.assert_array_equal(seen, getattr(own, name), strict=True)
        np.testing.assert_array_equal(rollouts.expert_torque[0, rows], own.torque)
        np.testing.assert_array_equal(rollouts.expert_drove[0, rows], own.expert_drove)
        alone = summarize_job(job, rollouts, expert, own)
        stored = summary[summary.episode == episode]
        for field in fields(stored):
            if field.name not in UNKNOWN_ALONE:
                np.testing.assert_array_equal(
                    getattr(alone, field.name), getattr(stored, field.name), field.name
                )


@pytest.mark.thorough  # with the test above, of all methods
def test_what_is_replayed_covers_what_can_happen(run_of):
    """Otherwise the test above shows less than it says."""
    rescued = summary_of(run_of("loco_safe_dagger"))
    assert rescued.takeovers.any() and (rescued.outcome == Outcome.FELL).any()
    asked = summary_of(run_of("loco_dagger"))
    assert asked.query.any() and asked.kept[asked.query].any()
    for i, kinds in ((0, ["classifier"]), (1, ["classifier", "history"])):
        assert all(run_of("loco_safe_dagger").gate_path(kind, i).exists() for kind in kinds)
    assert run_of("safe_dagger").gate_path("classifier", 1).exists()
    assert summary_of(run_of("dagger")).kept.all()
    assert len(list(run_of("behavior_cloning").policy_path(0).parent.iterdir())) == 2


def play(monkeypatch, *args: object) -> tuple[int, list]:
    films = []
    monkeypatch.setattr(play_command, "film_episode", lambda *film: not films.append(film))
    monkeypatch.setattr(sys, "argv", ["surefoot", "play", *map(str, args)])
    return cli.main(), films


@pytest.mark.parametrize("index", [1, 2 * PART + 1])
def test_play_by_index_and_by_id(monkeypatch, run_of, tmp_path, index):
    folder = run_of("loco_dagger").folder
    file = tmp_path / "figures.json"
    played = []
    for name in (["--iteration", 2, "--episode", index], ["--episode", 200_000 + index]):
        status, [film] = play(monkeypatch, folder, *name, "--json", file)
        recording, out, _ = film
        assert out == folder / f"episode_{200_000 + index}.mp4"
        shown = (recording.q.tobytes(), recording.expert_drove.tobytes(), recording.pushes)
        played.append((status, *shown, json.loads(file.read_text())))
    assert played[0] == played[1]
    figures = played[0][-1]
    assert figures["episode"] == 200_000 + index
    stored = summary_of(run_of("loco_dagger"))
    stored = stored[stored.episode == 200_000 + index]
    assert figures["outcome"] == Outcome(int(stored.outcome[0])).name
    assert figures["takeovers"] == stored.takeovers[0]
    assert figures["expert_share"] == stored.expert_ticks[0] / stored.proper_ticks[0]
    assert figures["seconds"] == stored.ticks[0] / 1000
    assert figures["drove_last"] == ("expert" if stored.expert_drove_last[0] else "policy")
    pushes = played[0][3]
    assert figures["pushes"] == [tick / 1000 for tick in pushes]
    assert not pushes if index >= PART else 0 < len(pushes) <= 2


def test_the_pushes_shown_are_those_that_were_felt(run_of):
    run = run_of("loco_dagger")
    job = recorded_episode(run.folder, 100_001)
    rollouts, expert = play_out(job)
    pushes = disturbance_of(job).pushes
    assert pushes is not None
    length = int(rollouts.length[0])
    felt = [tick for tick in range(length) if pushes.during(tick) is not None]
    first = [tick for tick in felt if tick - 1 not in felt]
    shown = [round(1000 * at) for at in report_episode(job, rollouts, expert).pushes]
    assert set(first) <= set(shown) <= set(felt)
    assert pushes.begun(0, min(shown)) == ()
    still = replace(pushes, impulse=np.zeros_like(pushes.impulse))
    assert still.begun(0, length) == ()


@pytest.mark.parametrize(
    ("method", "args", "message"),
    [
        ("dagger", ("--episode", 300_000), "nothing in iteration 3.*has collected iterations 0 to"),
        ("dagger", ("--iteration", 7, "--episode", 0), "no episode 700000.*iterations 0 to 2"),
        ("dagger", ("--episode", 100_002), "has 0 to 1, ids 100000 to 100001"),
        ("dagger", ("--iteration", 1, "--episode", 110_000), "an index from 0 on"),
        ("dagger", ("--iteration", -1, "--episode", 3), "nothing in iteration -1"),
        ("dagger", ("--episode", -5), "nothing in iteration -1"),
        ("dagger", ("--iteration", 1), "--iteration 1 needs an --episode"),
        ("behavior_cloning", ("--iteration", 1, "--episode", 0), "iterations 0 to 0"),
        ("loco_dagger", ("--episode", 9 * PART + 100_001), "ids 1000000100000 to 3000000100000"),
        ("loco_dagger", ("--episode", 100_002), "has 0 to 1, ids 100000 to 100001"),
    ],
)
def test_what_is_not_there_is_an_error_that_names_what_is(
    monkeypatch, capsys, run_of, method, args, message
):
    status, films = play(monkeypatch, run_of(method).folder, *args)
    error = capsys.readouterr().err
    assert status == 2 and not films
    assert re.search(message, error.replace("\n", " ")), error
    assert "Traceback" not in error


def test_a_run_that_has_collected_nothing(tmp_path):
    run = create(tmp_path / "run", config_of("dagger"))
    with pytest.raises(ValueError, match="it has collected nothing yet"):
        recorded_episode(run.folder, 0)


@pytest.fixture
def copy(run_of, tmp_path):
    """A run of one's own to damage."""

    def make(method: str) -> Run:
        shutil.copytree(run_of(method).folder, tmp_path / "run")
        return open_run(tmp_path / "run")

    return make


@pytest.mark.parametrize(
    ("method", "lost", "message"),
    first_often(
        1,
        [
            ("dagger", "policies/000", "no policy file .*000.safetensors.*--resume"),
            ("safe_dagger", "gates/classifier-000", "no classifier .*classifier-000.*--resume"),
            ("loco_safe_dagger", "gates/history-001", "no classifier .*history-001.*--resume"),
        ],
    ),
)
def test_a_driver_that_is_lost_is_named_and_how_to_get_it_back(copy, method, lost, message):
    run = copy(method)
    (run.folder / f"{lost}.safetensors").unlink()
    episode = 200_000 if "history" in lost else 100_000
    with pytest.raises(FileNotFoundError, match=message):
        play_out(recorded_episode(run.folder, episode))
    assert recorded_episode(run.folder, 0).episode == [0]  # the expert's are there


def scaled(gain: float):
    """A user's own MPC: stand, with a feed-forward torque; all of them have one name."""
    rows = np.zeros((100, 12))
    return lambda state, tick, command: MotionPlan(
        np.tile(state.q[7:], (100, 1)), rows, rows + 0.01 * gain
    )


def test_an_episode_of_an_own_expert_is_replayed_with_that_expert(tmp_path):
    run = create(tmp_path / "run", config_of("behavior_cloning"))
    job = methods.METHODS[run.method].collection(run, 0, scaled(1.0))
    collect_data(run, 0, job, Workers(1))
    replayed, _ = play_out(recorded_episode(run.folder, 3, plan=scaled(1.0)))
    frames = run.dataset.load()
    own = frames[frames.episode == 3]
    np.testing.assert_array_equal(replayed.torque[0, : len(own)], own.torque)
    with pytest.raises(RunError, match="which has changed since"):
        recorded_episode(run.folder, 3, plan=scaled(0.9))
    message = r"was scaled\.<locals>\.<lambda>, not surefoot\.mpc\.planner: replay .*plan=your_plan"
    with pytest.raises(ValueError, match=message):
        recorded_episode(run.folder, 3)


def test_a_run_of_other_versions_warns(copy):
    run = copy("behavior_cloning")
    path = run.folder / "config.json"
    record = json.loads(path.read_text())
    record["versions"]["numpy"] = "1.0"
    path.write_text(json.dumps(record))
    for again in (
        lambda: recorded_episode(run.folder, 0),
        lambda: create(run.folder, run.config, True),
    ):
        with pytest.warns(UserWarning, match=r"other versions \(numpy 1.0, now .*not be the same"):
            again()
