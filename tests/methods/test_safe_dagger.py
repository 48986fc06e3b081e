"""SafeDAGGER on the toy: what its gate learns from, and where it calls the expert."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from surefoot.learning.classifier import load_classifier
from surefoot.learning.observation import network_input
from surefoot.learning.policy import load
from surefoot.learning.samples import held_out
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.jobs import Job, play_out
from surefoot.runs.gate_training import deviation_samples
from surefoot.runs.layout import RunError
from surefoot.runs.run import open_run
from surefoot.safety.learned import Deviation
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import load_starts
from tests.fakes.learning import OBSERVATION_SPEC
from tests.fakes.runs import best, gate_trained
from tests.fakes.toy import plan
from tests.fakes.toy_runs import CONFIG, alarms, kept_in, last_block, replayed

pytestmark = pytest.mark.usefixtures("toys")


def deviations(run, i, frames):
    """(n, 12) how much policy i's outputs differ from the targets, and the targets [rad]."""
    policy = load(run.policy_path(i))
    inputs = torch.from_numpy(
        network_input(frames.state, frames.tick, frames.command, OBSERVATION_SPEC)
    )
    with torch.no_grad():
        output = policy.network(inputs).numpy().astype(float)
    kp = run.config.policy.kp
    kd = run.config.policy.kd
    target = (frames.torque + kd * frames.v[:, 6:]) / kp + frames.q[:, 7:]
    return output - target, target


def test_tau_is_the_configured_quantile_of_the_frames_held_out(runs):
    run = runs("safe_dagger")
    frames = kept_in(run, 0)
    error, target = deviations(run, 0, frames)
    done = gate_trained(run, "classifier", 0)
    assert done.sigma is not None
    np.testing.assert_allclose(done.sigma, target.std(axis=0), rtol=1e-4)
    held = held_out(frames.episode, CONFIG.training.validation)
    assert 0 < held.sum() < len(frames)
    deviation = ((error / target.std(axis=0)) ** 2).sum(axis=1)
    assert (deviation[held] > done.tau).mean() == pytest.approx(0.3, abs=2 / held.sum())
    assert done.tau == pytest.approx(np.quantile(deviation[held], 0.7), rel=1e-3)
    for i in (1, 2):  # the same tau and sigma for every policy
        later = gate_trained(run, "classifier", i)
        assert (later.tau, later.sigma) == (done.tau, done.sigma)


@pytest.mark.parametrize("i", [0, 1, 2])
def test_the_gate_learns_from_all_data_so_far_without_the_frames_that_judge_it(runs, i):
    run = runs("safe_dagger")
    frames = run.dataset.load()
    frames = frames[frames.episode // 100_000 <= i]
    done = gate_trained(run, "classifier", i)
    judges = held_out(frames.episode, CONFIG.training.validation) & (frames.episode % 2 == 1)
    assert done.rows == (~judges).sum() and (done.held_out or 0) == judges.sum()
    error, _ = deviations(run, i, frames)
    unsafe = ((error / np.array(done.sigma)) ** 2).sum(axis=1) > done.tau
    assert done.share_yes == pytest.approx(unsafe[~judges].mean(), abs=1e-3)
    assert 0.0 < done.share_yes < 1.0


def test_a_dataset_without_held_out_frames_is_an_error(runs):
    run = open_run(runs("safe_dagger").folder)
    run.config = replace(CONFIG, training=replace(CONFIG.training, validation=0.0))
    with pytest.raises(RunError, match="no frame held out to judge the policy by"):
        deviation_samples(run, 0, 0.2)


@pytest.mark.parametrize("i", [1, 2])
def test_the_expert_drives_exactly_where_the_gate_says_unsafe(runs, i):
    run = runs("safe_dagger")
    ((job, rollouts),) = replayed(run, i)
    unsafe_by_gate = alarms(load_classifier(run.gate_path("classifier", i - 1)), rollouts, 0.5)
    happened = rollouts.happened
    np.testing.assert_array_equal(rollouts.expert_drove[happened], unsafe_by_gate[happened])
    assert 0.02 < rollouts.expert_drove[happened].mean() < 0.98
    frames = kept_in(run, i)
    for b, episode in enumerate(job.episode):
        length = int(rollouts.length[b])
        unsafe = unsafe_by_gate[b]
        if rollouts.failed[b]:  # an unsafe spell that ends in a fall teaches how to fall
            unsafe = unsafe & ~last_block(unsafe, length)
        ticks = frames.tick[frames.episode == episode] - rollouts.starts.tick[b]
        assert ticks.tolist() == np.flatnonzero(unsafe[:length]).tolist()


def test_the_best_policys_gate_can_be_loaded_and_used_in_other_rollouts(runs):
    run = runs("safe_dagger")
    winner = best(run).best_iteration
    classifier = load_classifier(run.gate_path("classifier", winner))
    starts = load_starts()["test"][:8]

    def driven_by(alarm):
        switch = SafetySwitch(SafetyMonitor(Deviation(classifier, OBSERVATION_SPEC, alarm), 0.0))
        episodes = Episodes(starts, 0.3, id=starts.id)
        job = Job(run.config, episodes, switch, policy=run.best_policy_path, plan=plan)
        return play_out(job)[0]

    never = driven_by(1.0)
    assert not never.expert_drove.any()
    clock = starts.tick[:, None] + np.arange(300)
    rows = network_input(never.seen, clock, starts.command[:, None], OBSERVATION_SPEC)
    alarm = float(np.median(classifier.probability(rows.reshape(-1, rows.shape[-1]))))
    rollouts = driven_by(alarm)
    np.testing.assert_array_equal(rollouts.expert_drove, alarms(classifier, rollouts, alarm))
    assert 0.0 < rollouts.expert_drove.mean() < 1.0
