"""DAGGER on the toy: a coin at every tick, and an expert that is asked at every tick."""

import numpy as np
import pytest

from surefoot.rollouts.jobs import play_out
from tests.fakes.toy_runs import answers, collection, replayed
from tests.fakes.toy_worlds import shifted

pytestmark = pytest.mark.usefixtures("toys")


def test_the_coin_is_thrown_at_every_tick_for_every_episode(runs):
    run = runs("dagger")
    assert replayed(run, 0)[0][1].expert_drove.all()  # beta_1 = 1
    drove = {}
    for i, p in ((1, 0.6), (2, 0.36)):
        ((job, rollouts),) = replayed(run, i)
        assert job.ask_always
        for b, episode in enumerate(job.episode.tolist()):
            throws = rollouts.expert_drove[b, : rollouts.length[b]]
            n = len(throws)
            change = 2 * p * (1 - p)
            drove[episode] = throws
            assert n >= 500
            assert abs(throws.mean() - p) < 4 * np.sqrt(p * (1 - p) / n)
            changes = (throws[1:] != throws[:-1]).mean()
            assert abs(changes - change) < 6 * np.sqrt(change * (1 - change) / n)
        # Two episodes agree as often as two coins do.
        one, other = (drove[e][:500] for e in job.episode[:2].tolist())
        alike = p * p + (1 - p) * (1 - p)
        assert abs((one == other).mean() - alike) < 4 * np.sqrt(alike * (1 - alike) / 500)
    ticks = np.concatenate(list(drove.values()))
    assert 0.3 < ticks.mean() < 0.7


def test_the_expert_plans_on_its_grid_whenever_an_episode_begins_and_whoever_drives(runs):
    job = shifted(collection(runs("dagger"), 2), 17)
    rollouts, _ = play_out(job)
    assert not rollouts.expert_drove.all(axis=1).any()
    torque = answers(rollouts, rollouts.happened)
    asked = rollouts.expert_torque[rollouts.happened]
    np.testing.assert_allclose(asked, torque[rollouts.happened], rtol=0, atol=1e-9)
    drove = rollouts.expert_drove & rollouts.happened
    np.testing.assert_array_equal(rollouts.torque[drove], rollouts.expert_torque[drove])
    policy = rollouts.happened & ~drove
    assert (np.abs(rollouts.torque - rollouts.expert_torque)[policy].max(-1) > 1e-6).mean() > 0.9
