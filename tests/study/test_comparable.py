"""Which runs can be compared, and what their rows are called."""

import re
from dataclasses import replace

import pytest

from surefoot.config import (
    BehaviorCloningConfig,
    Config,
    ExpertConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    OtherGait,
    PushConfig,
)
from surefoot.config.gait_table import GAITS
from surefoot.runs.layout import RunError
from surefoot.runs.run import create, open_run
from surefoot.scenarios.starts import load_starts, save_starts
from surefoot.study.comparable import WhichPolicy, open_comparable_runs, rows_of
from tests.fakes.comparisons import SMALL, run_of, ten_rollouts
from tests.fakes.learning import FLOAT32

BASE = Config()


def rows(folders, names=(), which: WhichPolicy = "best"):
    return rows_of(open_comparable_runs(folders), names, which)


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
def test_runs_on_other_ground_are_refused(runs, tmp_path, changed, message):
    other = run_of(tmp_path / "other", LocoDaggerConfig(), 20, **changed)
    with pytest.raises(ValueError, match=re.escape(f"{other} has {message}, {runs[0]} has")):
        open_comparable_runs([*runs, other])


@pytest.mark.parametrize("first", [False, True])
def test_a_run_of_several_gaits_is_refused_with_what_to_do_on_the_command_line(
    runs, tmp_path, first
):
    path = tmp_path / "bound.npz"
    save_starts(replace(load_starts(), gait=GAITS["bound"]), path)
    other = OtherGait(GAITS["bound"], ExpertConfig(command_gain=(1.0, 1.0, 1.0)), str(path))
    several = run_of(tmp_path / "several", LocoDaggerConfig(), 20, other_gaits=(other,))
    message = r"several is a run of several gaits \(trot, bound\).*`surefoot train` with --gait, or"
    with pytest.raises(ValueError, match=message):
        open_comparable_runs([several, *runs] if first else [*runs, several])


def test_what_bears_on_training_only_may_differ(runs, tmp_path):
    changed = {
        "seed": 5,
        "chunk": 3,
        "simulation": replace(BASE.simulation, backend="bullet"),
        "safety": replace(BASE.safety, roll_pitch=20.0),
        "collection": replace(BASE.collection, pushes=3, delay=2),
        "evaluation": replace(BASE.evaluation, episodes=20),
    }
    other = run_of(tmp_path / "2" / "safe", LocoDaggerConfig(alpha=0.8), 20, **changed)
    assert rows([*runs, other])[3].label == "LocoDAGGER, alpha 0.8, pushes, disturbed"


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("starts", {"starts_hash": "0123456789"}, "made from other starts .01234567"),
        ("own", {"expert": "lab.plan"}, "own expert lab.plan"),
    ],
)
def test_a_run_from_other_starts_or_of_an_own_expert_is_refused(
    runs, tmp_path, name, changes, message
):
    run = create(tmp_path / name, Config(policy=SMALL, training=FLOAT32))
    run.append_metrics(ten_rollouts(0, **changes))
    with pytest.raises(ValueError, match=f"{name} .*{message}"):
        open_comparable_runs([*runs, run.folder])


def test_no_runs_are_an_error():
    with pytest.raises(ValueError, match="no runs to compare"):
        open_comparable_runs([])


def test_runs_of_one_method_are_labeled_by_their_folders(runs, tmp_path):
    third = run_of(tmp_path / "safe3" / "safe", BehaviorCloningConfig(), 40)
    assert [row.label for row in rows([runs[0], third])] == ["expert", "BC (bc)", "BC (safe)"]
    twin = run_of(tmp_path / "2" / "bc", BehaviorCloningConfig(), 30)
    with pytest.raises(ValueError, match=r"same name: BC \(bc\)"):
        rows([runs[0], twin])


def test_names_must_fit_the_runs(runs):
    assert [row.label for row in rows(runs, ("one", "two"))] == ["expert", "one", "two"]
    with pytest.raises(ValueError, match="same name: expert"):
        rows(runs, ("expert", "other"))
    with pytest.raises(ValueError, match="1 names for 2 runs"):
        rows(runs, ("one",))


def test_one_policy_twice_is_an_error(runs):
    with pytest.raises(ValueError, match="hold the same policy"):
        rows([runs[0], runs[0]], ("a", "b"))


def test_the_best_or_the_last_policy_of_a_run_is_compared(tmp_path):
    folder = run_of(tmp_path / "safe", LocoSafeDaggerConfig(gates=("history",)), 50)
    run = open_run(folder)
    best = rows([folder])[1]
    assert (best.label, best.policy) == ("LocoSafeDAGGER, history", str(run.policy_path(0)))
    last = rows([folder], which="last")[1]
    assert last.policy == str(run.policy_path(1))
    assert (best.run, best.method) == (str(folder), "loco_safe_dagger")


def test_of_an_unfinished_run_only_the_last_policy_can_be_compared(tmp_path):
    unfinished = run_of(tmp_path / "3" / "safe", LocoSafeDaggerConfig(), 60, best=None)
    with pytest.raises(RunError, match="not finished"):
        rows([unfinished])
    cost = rows([unfinished], which="last")[1].cost
    assert cost is not None and cost.falls == 3
    nothing = create(tmp_path / "4", Config(training=FLOAT32)).folder
    with pytest.raises(RunError, match="no policy yet"):
        rows([nothing], which="last")
