"""Learned gates on the toy: what pi_safe learns from, and where it calls the expert."""

import numpy as np
import pytest
import torch

from surefoot.learning.classifier import load_classifier
from surefoot.learning.observation import network_input
from surefoot.learning.policy import load
from surefoot.learning.samples import held_out
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.engine import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.safety.learned import Deviation
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import load_starts
from tests.fakes.learning import OBSERVATION_SPEC
from tests.fakes.runs import figures_of
from tests.fakes.toy import plan
from tests.fakes.toy_runs import (
    ALARM,
    CONFIG,
    alarms,
    driven,
    kept_in,
    last_block,
    outside,
    replayed,
)

pytestmark = pytest.mark.usefixtures("toys")


def deviations(run, i, frames):
    """(n, 12) what policy i's targets differ by from the labels, and the labels [rad]."""
    policy = load(run.policy_path(i))
    inputs = torch.from_numpy(
        network_input(frames.state, frames.tick, frames.command, OBSERVATION_SPEC)
    )
    with torch.no_grad():
        target = policy.network(inputs).numpy().astype(float)
    kp, kd = CONFIG.policy.kp, CONFIG.policy.kd
    label = (frames.torque + kd * frames.v[:, 6:]) / kp + frames.q[:, 7:]
    return target - label, label


def test_tau_is_the_quantile_asked_for_of_the_frames_held_out(runs):
    run = runs("safe_dagger")
    frames = kept_in(run, 0)
    error, label = deviations(run, 0, frames)
    done = figures_of(run, "guard_classifier", 0)
    np.testing.assert_allclose(done["sigma"], label.std(axis=0), rtol=1e-4)
    apart = held_out(frames.episode, CONFIG.training.validation)
    assert 0 < apart.sum() < len(frames)
    deviation = ((error / label.std(axis=0)) ** 2).sum(axis=1)
    assert (deviation[apart] > done["tau"]).mean() == pytest.approx(0.3, abs=2 / apart.sum())
    assert done["tau"] == pytest.approx(np.quantile(deviation[apart], 0.7), rel=1e-3)
    for i in (1, 2):  # the same tau and sigma for every policy
        later = figures_of(run, "guard_classifier", i)
        assert (later["tau"], later["sigma"]) == (done["tau"], done["sigma"])


@pytest.mark.parametrize("i", [0, 1, 2])
def test_pi_safe_learns_from_all_data_so_far_without_the_frames_that_judge_it(runs, i):
    run = runs("safe_dagger")
    frames = run.dataset.load()
    frames = frames[frames.episode // 100_000 <= i]
    done = figures_of(run, "guard_classifier", i)
    judges = held_out(frames.episode, CONFIG.training.validation) & (frames.episode % 2 == 1)
    assert done["rows"] == (~judges).sum() and done.get("held_out", 0) == judges.sum()
    error, _ = deviations(run, i, frames)
    yes = ((error / done["sigma"]) ** 2).sum(axis=1) > done["tau"]
    assert done["share_yes"] == pytest.approx(yes[~judges].mean(), abs=1e-3)
    assert 0.0 < done["share_yes"] < 1.0


@pytest.mark.parametrize("i", [1, 2])
def test_the_expert_drives_exactly_where_pi_safe_says_unsafe(runs, i):
    run = runs("safe_dagger")
    ((job, record),) = replayed(run, i)
    said = alarms(load_classifier(run.gate_path("classifier", i - 1)), record, 0.5)
    happened = record.happened
    np.testing.assert_array_equal(record.expert_drove[happened], said[happened])
    assert 0.02 < record.expert_drove[happened].mean() < 0.98
    frames = kept_in(run, i)
    for b, episode in enumerate(job.episode):
        length, unsafe = int(record.length[b]), said[b]
        if record.failed[b]:  # an unsafe spell that ends in a fall teaches how to fall
            unsafe = unsafe & ~last_block(unsafe, length)
        ticks = frames.tick[frames.episode == episode] - record.starts.tick[b]
        assert ticks.tolist() == np.flatnonzero(unsafe[:length]).tolist()


def test_pi_safe_comes_back_and_guards_at_run_time(runs):
    run = runs("safe_dagger")
    winner = figures_of(run, "best", 0)["best_iteration"]
    classifier = load_classifier(run.gate_path("classifier", winner))
    starts = load_starts()["test"][:8]

    def driven_by(alarm):
        switch = SafetySwitch(
            SafetyMonitor(Deviation(classifier, OBSERVATION_SPEC, alarm), block=0.0)
        )
        episodes = Episodes(starts, 0.3, id=starts.id)
        job = Job(run.config, episodes, switch, policy=run.best_policy_path, plan=plan)
        return play_out(job)[0]

    never = driven_by(1.0)
    assert not never.expert_drove.any()
    clock = starts.tick[:, None] + np.arange(300)
    rows = network_input(never.seen, clock, starts.command[:, None], OBSERVATION_SPEC)
    alarm = float(np.median(classifier.probability(rows.reshape(-1, rows.shape[-1]))))
    record = driven_by(alarm)
    np.testing.assert_array_equal(record.expert_drove, alarms(classifier, record, alarm))
    assert 0.0 < record.expert_drove.mean() < 1.0


@pytest.mark.parametrize("i", [1, 2])
def test_any_of_several_gates_blocks(runs, i):
    """In the finished run: bounds that relax, or the classifier that was trained before."""
    run = runs("loco_safe_dagger")
    ((_, record),) = replayed(run, i)
    by_network = alarms(load_classifier(run.gate_path("classifier", i - 1)), record, ALARM)
    share = {1: 0.6, 2: 1.0}[i]
    by_bounds, T = outside(record, share), record.duration
    for b, length in enumerate(np.minimum(record.length, T).tolist()):
        expected = driven((by_bounds | by_network)[b], 150, T)
        np.testing.assert_array_equal(record.expert_drove[b, :length], expected[:length])
    happened = record.happened
    assert (by_bounds & ~by_network & happened).any() and (by_network & ~by_bounds & happened).any()
    assert (record.expert_drove[:, T:] | ~happened[:, T:]).all()
    assert set((record.length - T)[~record.failed]) == {100}
