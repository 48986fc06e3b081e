"""Methods side by side: known answers in the tables, nothing run twice, nothing mixed up."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import surefoot.study.comparison as module
from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    ExpertData,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    PushConfig,
)
from surefoot.evaluation.statistics import wilson
from surefoot.files import load_arrays
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.methods.behavior_cloning import behavior_cloning
from surefoot.methods.loco_safe_dagger import loco_safe_dagger
from surefoot.rollouts.outcome import Outcome
from surefoot.rollouts.summary import Summary, join
from surefoot.runs.accounting import collection_cost, cost_of
from surefoot.runs.metrics import Best, StageRecord
from surefoot.runs.run import RunError, create, open_run
from surefoot.scenarios.starts import load_starts
from surefoot.study.comparison import compare, label_of
from surefoot.study.tables import BEGIN, END, page, tables
from surefoot.viz.plots import comparison_figure
from surefoot.workers import Workers
from tests.fakes.runs import (
    collected_record,
    gate_record,
    trained_record,
    validated_record,
)

SMALL = PolicyConfig(hidden=(4,))
DATA = ExpertData(1, 1, False, 0.2)
STARTS = load_starts()


class Interrupted(Exception):
    """Stands for Ctrl-C."""


def collected(iteration, **figures):
    """A record of a collection: by default 10 rollouts of 6 s, of which the expert drove 1 s."""
    share = 1.0 if iteration == 0 else 1 / 6
    changes = {
        "episodes": 10,
        "plans": 0,
        "frames_kept": 1000,
        "expert_share": share,
        "expert_share_with_tail": share,
        "robot_seconds": 60.0,
        "expert_seconds": 60.0 * share,
        "falls_per_robot_minute": float(figures.get("falls", 0)),
        "starts_hash": STARTS.hash,
        "seconds": 100.0,
    }
    return collected_record(iteration, **(changes | figures))


def run_of(folder: Path, method, weights: int, best: int | None = 0, **config) -> Path:
    """A run's folder without data: two policies and what stands in its metrics."""
    run = create(folder, Config(method=method, policy=SMALL, **config))
    iterations = 1 if isinstance(method, BehaviorCloningConfig) else 2
    for i in range(iterations):
        save(
            Policy(PolicyNetwork(SMALL, weights + i), SMALL, 500, np.zeros((2, 3))),
            run.policy_path(i),
        )
        run.append_metrics(
            collected(i, falls=3 * i, near_falls=4 * i, near_falls_in_tail=2 * i, plans=1200)
        )
        run.append_metrics(trained_record(i, seconds=20.0))
        run.append_metrics(gate_record("classifier", i, seconds=0.5))
        run.append_metrics(validated_record(i, starts_hash=STARTS.hash, seconds=3.0))
    if best is not None:
        run.append_metrics(Best(best_iteration=best))
    return folder


@pytest.fixture
def runs(tmp_path) -> list[Path]:
    return [
        run_of(tmp_path / "bc", BehaviorCloningConfig(), 0),
        run_of(tmp_path / "safe", LocoSafeDaggerConfig(), 10, best=1),
    ]


def pretend(monkeypatch, stop_after=1000):
    """Of four starts the expert loses none, BC the first two, LocoSafeDAGGER the second."""
    calls = []
    lost = {None: (), "bc": (0, 1), "safe": (1,)}

    def count(what, config, policy):
        if len(calls) == stop_after:
            raise Interrupted
        who = None if policy is None else policy.parent.parent.name
        calls.append((what, config.simulation.backend, who))
        return who

    def evaluate(config, policy, split, workers, label):
        who = count("evaluation", config, policy)
        assert (split, config.evaluation.episodes) == ("test", 4)
        outcome = np.array([Outcome.SUCCESS] * 4)
        outcome[list(lost[who])] = [Outcome.FELL, Outcome.STALLED][: len(lost[who])]
        successes = 4 - len(lost[who])
        figures = {
            "episodes": 4,
            "successes": successes,
            "success_rate": successes / 4,
            "success_interval": wilson(successes, 4),
            "falls": int((outcome == Outcome.FELL).sum()),
            "stalls": int((outcome == Outcome.STALLED).sum()),
            "diverged": 0,
            "strict_successes": successes - 1,
            "mse": [0.001, 0.002, 0.0345],
            "settled_mse": [None, 0.002, 0.003],
        }
        strict = np.array([True, False, True, True])
        return figures, SimpleNamespace(outcome=outcome, strict=strict)

    def push_recovery(config, policy, workers, label):
        # Both robots survive 2 Ns; of those of a policy one, not the other, survives the control.
        who = count("push", config, policy)
        fitted = [2.0, 4.0] if who is None else [1.0, 1.0]
        return {
            "starts_hash": STARTS.hash,
            "split": "test",
            "episodes": 2,
            "share": 1.0,
            "direction_deg": [0.0, 180.0],
            "levels": [[0.0, each] for each in fitted],
            "successes": [[2, 2], [2, 2]],
            "survived": [["11", "11"]] * 2,
            "fitted_impulse": fitted,
            "interval": [[each, each] for each in fitted],
            "mean_fitted_impulse": float(np.mean(fitted)),
            "mean_interval": [float(np.mean(fitted))] * 2,
        }

    for function in (evaluate, push_recovery):
        monkeypatch.setattr(module, function.__name__, function)
    return calls


BOTH = ("mujoco", "bullet")


def measure(runs, path=None, simulators=BOTH, **options):
    return compare(runs, simulators, 4, Workers(1), path, **options)


def cells(text: str) -> list[list[str]]:
    """The cells of a text's tables, without their heads."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in lines
        if not line.startswith(("| ---", "| simulator", "| method"))
    ]


def test_the_tables_hold_the_known_answers(monkeypatch, runs, tmp_path):
    calls = pretend(monkeypatch)
    path = tmp_path / "methods.json"
    record = measure(runs, path)
    assert json.loads(path.read_text()) == record
    assert len(calls) == len(set(calls)) == 2 * 2 * 3  # two measurements, simulators; three rows
    assert record["baseline"] == "BC"
    assert [row["results"]["bullet"]["evaluation"]["outcomes"] for row in record["rows"]] == [
        "0000",
        "1200",
        "0100",
    ]
    assert record["rows"][0]["results"]["mujoco"]["evaluation"]["strict"] == "1011"
    found = cells(tables(record))
    assert found[1] == [
        "mujoco",
        "BC",
        "2 of 4, 50.0 % (15.0 to 85.0)",
        "25.0 %",
        "1",
        "1",
        "0",
        "1.00, 2.00, 34.50",
        "-, 2.00, 3.00",
        "1.00 (1.00 to 1.00)",
        "1.00, 1.00",
    ]
    assert found[5][:3] == ["bullet", "LocoSafeDAGGER, bounds", "3 of 4, 75.0 % (30.1 to 95.4)"]
    assert found[5][4:6] == ["1", "0"]
    assert found[0][-2:] == ["3.00 (3.00 to 3.00)", "2.00, 4.00"]
    # Of four starts drawn anew the share of one is 0 to 75 %, that of two 0 to 100 %.
    assert found[6] == [
        "mujoco",
        "expert",
        "-",
        "+50.0 (+0.0 to +100.0)",
        "-",
        "+2.00 (+2.00 to +2.00)",
    ]
    assert found[7][2:4] == ["-50.0 (-100.0 to +0.0)", "-"]
    assert found[8][2:] == [
        "-25.0 (-75.0 to +0.0)",
        "+25.0 (+0.0 to +75.0)",
        "-2.00 (-2.00 to -2.00)",
        "+0.00 (+0.00 to +0.00)",
    ]
    assert found[12] == [
        *("BC", "0", "60", "1200", "0 of 10 (0.0 to 27.8 %)", "-", "-", "0, 0"),
        *("-", "0", "-", "-"),
        *("1000", "0.0 %, 0.0 %", "100, 20, 3, 0"),
    ]
    # 3 falls in 10 rollouts, together one minute; the expert drove 10 of 60 s.
    assert found[13][2:5] == ["70", "2400", "0 of 10 (0.0 to 27.8 %)"]
    assert found[13][5:11] == ["3 of 10 (10.8 to 60.3 %)", "3.00", "4, 2", "-", "0", "0"]
    assert "80 % of 2 robots survive" in tables(record)
    assert found[13][11:] == ["16.7 %", "2000", "0.0 %, 0.0 %", "200, 40, 6, 1"]


@pytest.mark.parametrize("stop", [0, 1, 4, 11])
def test_an_interrupted_comparison_goes_on_where_it_stopped(monkeypatch, runs, tmp_path, stop):
    pretend(monkeypatch)
    whole = measure(runs)
    path = tmp_path / "methods.json"
    pretend(monkeypatch, stop_after=stop)
    with pytest.raises(Interrupted):
        measure(runs, path)
    if stop:
        assert tables(json.loads(path.read_text()))  # an unfinished one has tables
    calls = pretend(monkeypatch)
    assert measure(runs, path) == whole == json.loads(path.read_text())
    assert len(calls) == 12 - stop


def test_names_order_and_more_runs_cost_only_what_is_new(monkeypatch, runs, tmp_path):
    path = tmp_path / "methods.json"
    pretend(monkeypatch)
    measure(runs[:1], path, simulators=("mujoco",))
    calls = pretend(monkeypatch)
    names = ("mine", "cloned")
    record = measure(runs[::-1], path, simulators=("mujoco",), names=names, baseline=runs[1])
    assert calls == [("evaluation", "mujoco", "safe"), ("push", "mujoco", "safe")]
    assert [row["label"] for row in record["rows"]] == ["expert", "mine", "cloned"]
    assert record["baseline"] == "mine"
    assert record["rows"][2]["differences"]["mujoco"]["baseline"]["success"]["difference"] == -0.25
    before = path.read_bytes()
    with pytest.raises(ValueError, match=r"also holds results of mine .*name these runs too"):
        measure(runs[:1], path)
    assert path.read_bytes() == before


def test_without_pushes_and_without_a_baseline(monkeypatch, runs):
    calls = pretend(monkeypatch)
    record = measure(runs[1:], pushes=False, simulators=("bullet",))
    assert {what for what, *_ in calls} == {"evaluation"}
    assert record["baseline"] is None
    found = cells(tables(record))
    assert found[0][-2:] == ["-", "-"]
    assert found[2] == [
        *("bullet", "LocoSafeDAGGER, bounds", "-25.0 (-75.0 to +0.0)", "-", "-", "-")
    ]


def test_a_file_of_other_settings_is_refused(monkeypatch, runs, tmp_path):
    path = tmp_path / "methods.json"
    pretend(monkeypatch)
    measure(runs, path)
    before = path.read_bytes()
    other = Config(push=PushConfig(levels=7))
    new = run_of(tmp_path / "new", BehaviorCloningConfig(), 5, push=other.push)
    with pytest.raises(ValueError, match="other config; name another file"):
        measure([new], path)
    with pytest.raises(ValueError, match="other episodes; name another file"):
        compare(runs, BOTH, 3, Workers(1), path)
    save(
        Policy(PolicyNetwork(SMALL, 9), SMALL, 500, np.zeros((2, 3))),
        open_run(runs[0]).policy_path(0),
    )
    with pytest.raises(ValueError, match="trained on has another policy"):
        measure(runs, path)
    assert path.read_bytes() == before


BASE = Config()


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"simulation": replace(BASE.simulation, friction=0.7)}, "simulation.friction 0.7"),
        ({"evaluation": replace(BASE.evaluation, duration=2.0)}, "evaluation.duration 2.0"),
        ({"gait": replace(BASE.gait, duty=0.7)}, "gait.duty 0.7"),
        ({"expert": replace(BASE.expert, kp=4.0)}, "expert.kp 4.0"),
        ({"safety": replace(BASE.safety, fall_angle=40.0)}, "safety.fall_angle 40.0"),
        ({"push": PushConfig(after=1.0)}, "push.after 1.0"),
    ],
)
def test_runs_on_other_ground_are_refused(monkeypatch, runs, tmp_path, changed, message):
    calls = pretend(monkeypatch)
    other = run_of(tmp_path / "other", LocoDaggerConfig(), 20, **changed)
    with pytest.raises(ValueError, match=re.escape(f"{other} has {message}, {runs[0]} has")):
        measure([*runs, other])
    assert not calls


def test_what_bears_on_training_only_may_differ(monkeypatch, runs, tmp_path):
    pretend(monkeypatch)
    changed = {
        "seed": 5,
        "chunk": 3,
        "simulation": replace(BASE.simulation, backend="bullet"),
        "safety": replace(BASE.safety, roll_pitch=20.0),
        "collection": replace(BASE.collection, pushes=3, delay=2),
        "evaluation": replace(BASE.evaluation, episodes=20),
    }
    other = run_of(tmp_path / "2" / "safe", LocoDaggerConfig(alpha=0.8), 20, **changed)
    assert measure([*runs, other])["rows"][3]["label"] == "LocoDAGGER, alpha 0.8, pushes, disturbed"


def test_a_run_on_other_starts_or_with_an_own_expert_is_named(monkeypatch, runs, tmp_path):
    pretend(monkeypatch)
    for name, record, message in (
        ("starts", {"starts_hash": "0123456789"}, "made from other starts .01234567"),
        ("own", {"expert": "mine.plan"}, "own expert mine.plan"),
    ):
        run = create(tmp_path / name, Config(policy=SMALL))
        run.append_metrics(collected(0, **record))
        with pytest.raises(ValueError, match=f"{name} .*{message}"):
            measure([*runs, run.folder])


def test_rows_are_told_apart(monkeypatch, runs, tmp_path):
    pretend(monkeypatch)
    monkeypatch.setattr(module, "cost_of", lambda *_: None)
    twin = run_of(tmp_path / "2" / "bc", BehaviorCloningConfig(), 30)
    third = run_of(tmp_path / "safe3" / "safe", BehaviorCloningConfig(), 40)
    labels = [row["label"] for row in measure([runs[0], third])["rows"]]
    assert labels == ["expert", "BC (bc)", "BC (safe)"]
    with pytest.raises(ValueError, match=r"same name: BC \(bc\)"):
        measure([runs[0], twin])
    with pytest.raises(ValueError, match="same name: expert"):
        measure(runs, names=("expert", "other"))
    with pytest.raises(ValueError, match="1 names for 2 runs"):
        measure(runs, names=("one",))
    with pytest.raises(ValueError, match="none of"):
        measure(runs, baseline=twin)
    with pytest.raises(ValueError, match="hold the same policy"):
        measure([runs[0], runs[0]], names=("a", "b"))
    with pytest.raises(ValueError, match="compare what"):
        measure([])


def test_best_or_last_policy(monkeypatch, runs, tmp_path):
    pretend(monkeypatch)
    early = run_of(tmp_path / "2" / "safe", LocoSafeDaggerConfig(guard=("history",)), 50)
    row = measure([early])["rows"][1]
    assert (row["label"], row["policy"]) == (
        "LocoSafeDAGGER, history",
        str(open_run(early).policy_path(0)),
    )
    assert measure([early], which="last")["rows"][1]["policy"] == str(
        open_run(early).policy_path(1)
    )
    unfinished = run_of(tmp_path / "3" / "safe", LocoSafeDaggerConfig(), 60, best=None)
    with pytest.raises(RunError, match="not finished"):
        measure([unfinished])
    assert measure([unfinished], which="last")["rows"][1]["cost"]["falls"] == 3
    nothing = create(tmp_path / "4", Config()).folder
    with pytest.raises(RunError, match="no policy yet"):
        measure([nothing], which="last")


def summary_of(rng, n: int, T: int, tail: int, drove: float, fell: float, query: bool = False):
    """n random episodes; ``drove`` is the expert's mean share."""
    failed = rng.random(n) < fell
    proper = np.where(failed, rng.integers(T // 2, T, n), T)
    whole = {field.name: rng.integers(0, 50, n) for field in fields(Summary)}
    given = {
        "query": np.full(n, query),
        "outcome": np.where(failed, int(Outcome.FELL), int(Outcome.SUCCESS)),
        "proper_ticks": proper,
        "ticks": proper + np.where(failed, 0, tail),
        "expert_ticks": np.round(proper * (drove if drove == 1 else rng.random(n) * drove)).astype(
            int
        ),
        "tilted_far": rng.random((n, 2)) < 0.3,
        "expert_drove_last": rng.random(n) < 0.5,
        "expert_drove_before": rng.random(n) < 0.5,
    }
    return Summary(**(whole | given))


@pytest.mark.parametrize("tail", [0, 1000])
@pytest.mark.parametrize("queries", [False, True])
@pytest.mark.parametrize("fell", [0.0, 0.4])
def test_cost_is_pooled_exactly(tail, queries, fell):
    """From the records of the iterations alone, as if all rollouts had been in one."""
    rng = np.random.default_rng(int(tail + 10 * fell) + queries)
    T, records, parts = 5000, [], []
    for i in range(5):
        tail = 0 if queries else tail
        drove = 1.0 if i == 0 or (i == 1 and queries) else 0.8**i
        part = summary_of(rng, 10 + i, T, 0 if i == 0 else tail, drove, fell)
        if queries and i > 0:
            part = join([part, summary_of(rng, 50, 1000, 0, 1.0, fell, query=True)])
        records.append(collected_record(i, seconds=2.0, **vars(collection_cost(part))))
        parts.append(part)
    cost, pooled = cost_of(records, T / 1000), vars(collection_cost(join(parts[1:])))
    for key in ("episodes", "falls", "takeovers"):
        assert cost[key] == pooled[key]
    for key in ("expert_share", "falls_per_robot_minute"):
        assert cost[key] == pytest.approx(pooled[key], rel=1e-9)
    assert cost["expert_share"] < 0.99
    everything = vars(collection_cost(join(parts)))
    keys = ("expert_seconds", "plans", "frames_kept", "queries_failed", "recoveries_tilted")
    for key in (*keys, "near_falls", "near_falls_in_tail"):
        assert cost[key] == pytest.approx(everything[key])
    assert cost["pretraining_episodes"] == 10
    assert cost["seconds"] == {"collect": 10.0, "train": 0, "validate": 0, "guards": 0}


def test_of_a_series_of_sizes_only_the_last_is_what_a_policy_cost():
    records: list[StageRecord] = [collected(0)]
    for size in range(3):
        records.append(trained_record(size, seconds=10.0 * (size + 1)))
        records.append(validated_record(size, seconds=size + 1.0))
    records.append(Best(best_iteration=2))
    cost = cost_of(records, 0.0)
    assert cost["seconds"] == {"collect": 100.0, "train": 30.0, "validate": 3.0, "guards": 0}
    # Of an iterative method each policy goes on from the one before.
    records += [collected(i) for i in (1, 2)]
    cost = cost_of(records, 6.0)
    assert cost["seconds"] == {"collect": 300.0, "train": 60.0, "validate": 6.0, "guards": 0}


def test_prose_around_the_tables_stays(tmp_path):
    path = tmp_path / "methods.md"
    assert page(path, "| a |") == f"{BEGIN}\n| a |\n{END}\n"
    path.write_text(f"# Methods\n\n{BEGIN}\nold\n{END}\n\nAfter.\n")
    assert page(path, "new") == f"# Methods\n\n{BEGIN}\nnew\n{END}\n\nAfter.\n"
    path.write_text(page(path, "new"))
    assert page(path, "new") == path.read_text()
    for text in ("prose", f"{BEGIN} open", f"{END}{BEGIN}"):
        path.write_text(text)
        with pytest.raises(ValueError, match="no place for the tables"):
            page(path, "new")


def test_figure_of_whole_and_unfinished_comparisons(monkeypatch, runs, tmp_path):
    pretend(monkeypatch)
    whole, path = measure(runs), tmp_path / "figure.svg"
    text = comparison_figure(whole, path).read_text()
    for part in ("MuJoCo", "PyBullet", "LocoSafeDAGGER, bounds", "forward", "100 % survive"):
        assert part in text
    assert comparison_figure(whole, tmp_path / "again.svg").read_text() == text
    pretend(monkeypatch, stop_after=3)
    with pytest.raises(Interrupted):
        measure(runs, tmp_path / "part.json")
    part = json.loads((tmp_path / "part.json").read_text())
    assert "PyBullet" not in comparison_figure(part, path).read_text()
    pretend(monkeypatch)
    without = comparison_figure(measure(runs, pushes=False), path).read_text()
    assert "forward" not in without
    with pytest.raises(ValueError, match="nothing to draw"):
        comparison_figure({"rows": [{"label": "expert", "results": {}}]}, path)


@pytest.fixture(scope="module")
def trained(tmp_path_factory) -> list[Path]:
    """Two finished runs, too small to have learned anything."""
    methods = (
        (BehaviorCloningConfig(DATA, epochs=1), behavior_cloning),
        (LocoSafeDaggerConfig(DATA, 1, 2, 2, 1, 0.3, T_end=0.1, epochs=1), loco_safe_dagger),
    )
    folders = []
    for method, train in methods:
        push = PushConfig(
            speeds=1, before=0.1, after=0.2, directions=2, resolution=4.0, levels=1, success=0.5
        )
        config = Config(method=method, policy=PolicyConfig(hidden=(16, 16)), push=push)
        evaluation = replace(config.evaluation, duration=0.7, episodes=4)
        run = create(
            tmp_path_factory.mktemp("run") / "tiny", replace(config, evaluation=evaluation)
        )
        train(run, workers=Workers(1))
        folders.append(run.folder)
    return folders


def test_a_real_comparison(trained, tmp_path):
    path = tmp_path / "methods.json"
    record = measure(trained, path, simulators=("mujoco",), which="last")
    expert, *policies = (row["results"]["mujoco"] for row in record["rows"])
    assert expert["evaluation"]["outcomes"] == "0000"
    assert expert["pushes"]["levels"][0][0] == 0.0
    for results in policies:
        assert results["evaluation"]["outcomes"].count("0") == results["evaluation"]["successes"]
        assert results["evaluation"]["starts_hash"] == expert["evaluation"]["starts_hash"]
    assert len({json.dumps(results["evaluation"]) for results in policies}) == 2
    run = open_run(trained[1])
    later = [run.summary_path(name) for name in run.dataset.shards if "_000-" not in name]
    pooled = vars(collection_cost(join([load_arrays(file, Summary) for file in later])))
    for key in ("episodes", "falls", "takeovers", "expert_share", "falls_per_robot_minute"):
        assert record["rows"][2]["cost"][key] == pytest.approx(pooled[key], rel=1e-9)
    assert label_of(run) == record["rows"][2]["label"]
    assert len(cells(tables(record))) == 3 + 3 + 2
    assert json.loads(path.read_text()) == record
