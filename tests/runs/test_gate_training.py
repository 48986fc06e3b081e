"""Which gates watch over which iteration, and a small run whose history network learns."""

import shutil
from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import (
    TABLE_I,
    Config,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertData,
    LocoSafeDaggerConfig,
    PolicyConfig,
    TrainingConfig,
)
from surefoot.config.array_io import load_arrays
from surefoot.learning.classifier import digest, load_classifier
from surefoot.methods.loco_safe_dagger import collection, loco_safe_dagger
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.traces import Trace
from surefoot.runs import gate_training
from surefoot.runs.gate_training import GateSamples, make_gate, train_gates
from surefoot.runs.policies import load_policy
from surefoot.runs.run import Run, create, open_run
from surefoot.runs.sampling import rising_share
from surefoot.safety.gates import AnyOf, Bounds, tightened
from surefoot.safety.learned import History
from surefoot.workers import Workers
from tests.fakes.runs import gate_trained

METHOD = LocoSafeDaggerConfig(
    # Taught just enough that its policy meets safe and unsafe states.
    pretraining=ExpertData(4, 1, True, 0.3),
    pretraining_epochs=8,
    iterations=2,
    velocities=4,
    perturbations=2,
    T=0.8,
    T_block=0.15,
    T_end=0.1,
    gates=("bounds", "history"),
    alarm=0.3,
    epochs=1,
)
CONFIG = replace(
    Config(),
    method=METHOD,
    chunk=4,
    policy=PolicyConfig(hidden=(64, 64)),
    training=TrainingConfig(batch=64, precision="float32"),
    collection=DisturbanceConfig(1),
    evaluation=EvaluationConfig(duration=0.1, episodes=2),
)


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Run:
    run = create(tmp_path_factory.mktemp("gated") / "run", CONFIG)
    loco_safe_dagger(run, Workers(1))
    return run


def test_the_history_network_learns_from_all_rollouts_so_far(run):
    known = 0
    for i in (1, 2):
        names = [name for name in run.dataset.shards if name.startswith(f"iteration_{i:03d}")]
        traces = [load_arrays(run.trace_path(name), Trace) for name in names]
        assert [trace.inputs.shape for trace in traces] == [(4, 80, 47)] * 2
        known += sum((trace.label >= 0).sum() for trace in traces)
        record = gate_trained(run, "history", i)
        assert record.rows + (record.held_out or 0) == known
        assert record.alarm in (None, 0.3)
        classifier = load_classifier(run.gate_path("history", i))
        assert classifier.quality.rows == record.rows
        assert digest(classifier) == record.sha256
    assert not run.gate_path("history", 0).exists()


def test_a_lost_network_comes_back_to_the_bit(run):
    path = run.gate_path("history", 2)
    before = path.read_bytes()
    records = run.metrics
    path.unlink()
    train_gates(open_run(run.folder), 2, METHOD.gates, alarm=METHOD.alarm)
    assert path.read_bytes() == before
    assert run.metrics == records


@pytest.mark.parametrize("unsafe", [True, False])
def test_a_history_network_that_would_know_one_answer_is_not_trained(
    run, tmp_path, monkeypatch, unsafe, caplog
):
    rows = np.zeros((40, History.row_size), np.float32)
    held = np.arange(40) < 4
    known = np.where(held, not unsafe, unsafe)  # the other kind is among the held-out rows only
    monkeypatch.setattr(gate_training, "history_samples", lambda *_: GateSamples(rows, known, held))
    other = create(tmp_path / "run", CONFIG)
    with caplog.at_level("INFO"):
        train_gates(other, 1, ("history",))
    assert "the other gates, or the bounds, take its place" in caplog.text
    assert other.gate_trained("history", 1) is None
    assert isinstance(make_gate(other, 2, ("history",)), Bounds)


def test_a_history_network_is_used_from_the_iteration_after_its_first_data(run):
    first = make_gate(run, 1, METHOD.gates)
    second = make_gate(run, 2, METHOD.gates)
    assert isinstance(first, Bounds)
    assert isinstance(second, AnyOf)
    assert [type(gate) for gate in second._gates] == [Bounds, History]
    assert isinstance(make_gate(run, 1, ["history"]), Bounds)  # the paper's take its place
    assert isinstance(make_gate(run, 3, ["history"]), History)


def test_a_history_network_raises_its_alarm_at_the_methods_probability(run):
    arbiter = collection(run, 2).arbiter
    assert isinstance(arbiter, SafetySwitch)
    gate = arbiter._monitor._gate
    assert isinstance(gate, AnyOf)
    _, history = gate._gates
    assert isinstance(history, History)
    assert history._alarm == METHOD.alarm == 0.3


@pytest.mark.parametrize(("i", "share"), [(1, 0.6), (2, 0.7), (3, 0.8), (5, 1.0)])
def test_relaxing_bounds_reach_the_papers_table_in_the_last_iteration(run, i, share):
    gate = make_gate(run, i, ["relaxing"], share=rising_share(0.6, i, 5))
    assert isinstance(gate, Bounds)
    expected = tightened(TABLE_I, share, 0.20)
    bounds = gate._config
    assert bounds.roll_pitch == pytest.approx(expected.roll_pitch)
    assert bounds.com_height == pytest.approx(expected.com_height)
    if i == 5:
        assert bounds.roll_pitch == TABLE_I.roll_pitch
        assert bounds.com_height == pytest.approx(TABLE_I.com_height)


def test_the_method_tightens_its_bounds_by_its_own_share(tmp_path):
    method = replace(METHOD, gates=("relaxing",), tightest=0.6, iterations=5)
    run = Run(tmp_path / "run", with_own_values(replace(CONFIG, method=method)))
    for i, share in ((1, 0.6), (3, 0.8), (5, 1.0)):
        arbiter = collection(run, i).arbiter
        assert isinstance(arbiter, SafetySwitch)
        bounds = arbiter._monitor._gate
        assert isinstance(bounds, Bounds)
        expected = tightened(TABLE_I, share, 0.20).roll_pitch
        assert bounds._config.roll_pitch == pytest.approx(expected)


def test_a_policy_answers_a_part_of_the_data_at_a_time(run, tmp_path, monkeypatch):
    written = []
    sizes = []

    def load_counted(run, i):
        policy = load_policy(run, i)
        forward = policy.forward

        def counted(rows):
            sizes.append(len(rows))
            return forward(rows)

        policy.forward = counted
        return policy

    monkeypatch.setattr(gate_training, "load_policy", load_counted)
    for together in (1_000_000, 64):
        monkeypatch.setattr("surefoot.learning.policy.ROWS_AT_ONCE", together)
        folder = tmp_path / str(together)
        shutil.copytree(run.folder, folder)
        train_gates(open_run(folder), 0, ["classifier"])
        written.append(open_run(folder).gate_path("classifier", 0).read_bytes())
    assert sizes[0] == sum(sizes[1:]) > 64 >= max(sizes[1:])
    assert written[0] == written[1]
