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
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertData,
    Gait,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    NoiseConfig,
    PolicyConfig,
    SafeDaggerConfig,
    SimulationConfig,
    TrainingConfig,
)
from surefoot.config.json_io import to_json
from surefoot.files import load_arrays
from surefoot.learning.policy import load, save
from surefoot.rollouts.jobs import disturbance_of, play_out, summarize_job
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.runs.policies import find_policy
from surefoot.runs.query import QUERIES, Query
from surefoot.runs.run import Run, create, open_run
from surefoot.viz.replay import episode_figures, recorded_episode
from surefoot.workers import Workers
from tests.fakes.learning import spec_of
from tests.fakes.robots import needs_pybullet

DATA = ExpertData(2, 1, False, 0.12)
SMALL = {"pretraining": DATA, "pretraining_epochs": 1, "iterations": 2, "epochs": 1}
SMALL |= {"velocities": 2, "perturbations": 1, "T": 0.7}
METHODS = {
    "behavior_cloning": BehaviorCloningConfig(DATA, 1, frames=(500,)),
    "dagger": DaggerConfig(**SMALL),
    "safe_dagger": SafeDaggerConfig(**SMALL),
    "loco_dagger": LocoDaggerConfig(**SMALL, N_query=3, T_query=0.1),
    "loco_safe_dagger": LocoSafeDaggerConfig(
        **SMALL, T_block=0.1, T_end=0.1, gates=("relaxing", "classifier", "history"), alarm=0.9
    ),
}
ROUGH = DisturbanceConfig(
    pushes=2, impulse=(0.5, 2.0), gentle=0.5, friction=(0.8, 1.2), mass=(0.9, 1.1), delay=1
)
NOISY = replace(ROUGH, noise=NoiseConfig(base_orientation=0.002, joint_velocity=0.05))


def config_of(method: str) -> Config:
    return replace(
        Config(),
        method=METHODS[method],
        chunk=3,
        seed=5,
        policy=PolicyConfig(hidden=(16, 16)),
        training=TrainingConfig(batch=64),
        evaluation=EvaluationConfig(duration=0.05, episodes=2),
        collection=NOISY if method == "loco_safe_dagger" else ROUGH,
    )


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
        *((method, "mujoco") for method in METHODS),
        pytest.param("loco_dagger", "bullet", marks=needs_pybullet),
    ],
)
def test_every_episode_repeats_bit_for_bit(run_of, method, backend):
    run = run_of(method, backend)
    frames, summary = run.dataset.load(), summary_of(run)
    assert set(summary.episode // 100_000) == set(range(1 if method == "behavior_cloning" else 3))
    some = summary.episode >= 100_000
    some[::7] = True  # of the pre-training; all of the others
    for episode in summary.episode[some].tolist():
        job = recorded_episode(run.folder, episode)
        assert job.episode.tolist() == [episode]
        record, expert = play_out(job)
        mine = frames[frames.episode == episode]
        rows = mine.tick - record.starts.tick[0]
        for name in ("q", "v", "com", "feet", "contacts"):
            seen = getattr(record.seen, name)[0, rows]
            np.testing.assert_array_equal(seen, getattr(mine, name), strict=True)
        np.testing.assert_array_equal(record.expert_torque[0, rows], mine.torque)
        np.testing.assert_array_equal(record.expert_drove[0, rows], mine.expert_drove)
        alone = summarize_job(job, record, expert, mine)
        stored = summary[summary.episode == episode]
        for field in fields(stored):
            if field.name not in UNKNOWN_ALONE:
                np.testing.assert_array_equal(
                    getattr(alone, field.name), getattr(stored, field.name), field.name
                )


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
    monkeypatch.setattr(play_command, "film_episode", lambda *film: films.append(film))
    monkeypatch.setattr(sys, "argv", ["surefoot", "play", *map(str, args)])
    return cli.main(), films


@pytest.mark.parametrize("index", [1, QUERIES + 4])
def test_play_by_index_and_by_id(monkeypatch, run_of, tmp_path, index):
    folder, file = run_of("loco_dagger").folder, tmp_path / "figures.json"
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
    assert not pushes if index >= QUERIES else 0 < len(pushes) <= 2


def test_the_pushes_shown_are_those_that_were_felt(run_of):
    run = run_of("loco_dagger")
    job = recorded_episode(run.folder, 100_001)
    record, expert = play_out(job)
    pushes = disturbance_of(job).pushes
    assert pushes is not None
    length = int(record.length[0])
    felt = [tick for tick in range(length) if pushes.during(tick) is not None]
    first = [tick for tick in felt if tick - 1 not in felt]
    shown = [round(1000 * at) for at in episode_figures(job, record, expert)["pushes"]]
    assert set(first) <= set(shown) <= set(felt)
    assert pushes.begun(0, min(shown)) == ()
    still = replace(pushes, impulse=np.zeros_like(pushes.impulse))
    assert still.begun(0, length) == ()


def test_parents_of_queries():
    query = Query(5, 1.0, 0.2)
    for index in (0, 3, 9999):
        first = 300_000 + QUERIES + 5 * index
        assert {query.parent(first + j) for j in range(5)} == {300_000 + index}
        assert query.parent(300_000 + index) == 300_000 + index


@pytest.mark.parametrize(
    ("method", "args", "message"),
    [
        ("dagger", ("--episode", 300_000), "nothing in iteration 3.*has collected iterations 0 to"),
        ("dagger", ("--iteration", 7, "--episode", 0), "no episode 700000.*iterations 0 to 2"),
        ("dagger", ("--episode", 100_002), "has 0 to 1, ids 100000 to 100001"),
        ("dagger", ("--iteration", 1, "--episode", 110_000), "an index from 0 on"),
        ("dagger", ("--iteration", -1, "--episode", 3), "nothing in iteration -1"),
        ("dagger", ("--episode", -5), "nothing in iteration -1"),
        ("dagger", ("--iteration", 1), "iteration 1 of which --episode"),
        ("behavior_cloning", ("--iteration", 1, "--episode", 0), "iterations 0 to 0"),
        ("loco_dagger", ("--episode", 110_006), "queries 10000 to 10005, ids 110000 to 110005"),
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
    [
        ("safe_dagger", "gates/classifier-000", "no classifier .*classifier-000.*--resume"),
        ("loco_safe_dagger", "gates/history-001", "no classifier .*history-001.*--resume"),
        ("dagger", "policies/000", "no policy file .*000.safetensors.*--resume"),
    ],
)
def test_a_driver_that_is_lost_is_named_and_how_to_get_it_back(copy, method, lost, message):
    run = copy(method)
    (run.folder / f"{lost}.safetensors").unlink()
    episode = 200_000 if "history" in lost else 100_000
    with pytest.raises(FileNotFoundError, match=message):
        play_out(recorded_episode(run.folder, episode))
    assert recorded_episode(run.folder, 0).episode == [0]  # the expert's are there


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


# --- policies that do not fit the configuration they are to be run under


def rewrite(run: Run, **changes) -> None:
    path = run.folder / "config.json"
    record = json.loads(path.read_text())
    record["config"] = to_json(replace(run.config, **changes))
    path.write_text(json.dumps(record))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gait": Gait(period=0.4)}, r"a gait period \[ms\] 500, .*config.json has 400"),
        ({"policy": PolicyConfig((16, 16), kp=3.0)}, r"kp \[Nm/rad\] 2.0, .*config.json has 3.0"),
        ({"policy": PolicyConfig((16, 16), kd=0.2)}, r"kd \[Nms/rad\] 0.1, .*has 0.2"),
        ({"policy": PolicyConfig((16, 16), phase="fraction")}, "a phase given as circle.*fraction"),
    ],
)
@pytest.mark.parametrize("command", ["evaluate", "play"])
def test_a_policy_of_another_period_gain_or_phase_is_refused(
    monkeypatch, capsys, copy, changes, message, command
):
    run = copy("behavior_cloning")
    policy = run.best_policy_path
    rewrite(run, **changes)
    for target in (run.folder, policy):
        monkeypatch.setattr(sys, "argv", ["surefoot", command, str(target)])
        assert cli.main() == 2
        error = " ".join(capsys.readouterr().err.split())
        assert re.search(message, error) and "in the folder of the run" in error, error


def test_a_policy_that_lies_in_no_run_brings_its_gains(run_of, tmp_path, capsys):
    policy = load(run_of("behavior_cloning").best_policy_path)
    own = PolicyConfig((16, 16), kp=2.5, kd=0.07, phase="fraction")
    policy.spec = spec_of(own)
    path = tmp_path / "elsewhere" / "policy.safetensors"
    save(policy, path)
    found, config = find_policy(path)
    assert found == path and config == replace(Config(), policy=own)
    said = capsys.readouterr().out
    assert "lies in no run" in said and "kp 2.5 Nm/rad, kd 0.07 Nms/rad, phase as a fr" in said
    policy.spec = spec_of(own, 400)
    save(policy, path)
    with pytest.raises(ValueError, match=r"period \[ms\] 400, the default configuration has 500"):
        find_policy(path)
