"""An episode on a twin that pushes its robot: that of the simulation with the same pushes."""

from dataclasses import replace

import numpy as np

from surefoot.config.twin import TwinConfig
from surefoot.field.collection import on_robot
from surefoot.field.episode import rollout_of
from surefoot.field.session import Session, deployed_policy
from surefoot.rollouts.jobs import chunks_of, play_out
from surefoot.runs.policies import PACKAGED_POLICY
from surefoot.runs.run import create
from surefoot.scenarios.disturbance import Disturbance, Pushes
from surefoot.twin.pushes import SPAN_TICKS, RandomPushes
from tests.fakes.bridge_world import MILLISECOND
from tests.fakes.lockstep_twin import LockstepTwin
from tests.field.test_collection import crew_of, job_of, strict


def pushes_from(pushes: RandomPushes, begun: int) -> Pushes:
    """The pushes of a twin on the clock of an episode that begins at a tick of theirs."""
    spans = range((pushes.tick - 1) // SPAN_TICKS + 1)
    drawn = [(number, pushes.span(number)) for number in spans]
    ticks = [each.tick + SPAN_TICKS * number - begun for number, each in drawn if each]
    impulses = [each.impulse for _, each in drawn if each]
    return Pushes(np.concatenate(impulses, axis=1), np.concatenate(ticks, axis=1), 10)


def test_in_lockstep_a_pushed_episode_is_that_of_the_simulation_with_the_same_pushes(tmp_path):
    run = create(tmp_path / "run", strict(2.0))
    twin = LockstepTwin(TwinConfig(pose="standing", pushes=30, impulse=(0.1, 0.3), seed=2))
    crew = crew_of(run, twin)
    policy = deployed_policy(PACKAGED_POLICY, twin.model, crew.config)
    session = Session(crew, policy, lambda: False)
    job = chunks_of(on_robot(job_of(run), twin.model))[1]
    report = session.run_episode(job)
    driver = twin.twin.driver
    episode = report.episode
    assert episode is not None
    since = driver.time_ns - int(episode.flight.robot_time_ns[0])
    pushes = pushes_from(driver.pushes, driver.pushes.tick - since // MILLISECOND)
    session.close()
    walked, measured = rollout_of(job, episode, twin.model)
    assert measured.all()
    assert len(pushes.begun(0, 700)) >= 3
    moved = Disturbance(pushes=pushes)
    episodes = replace(job.episodes, starts=walked.starts, disturbance=moved)
    simulated, _ = play_out(replace(job, episodes=episodes))
    assert simulated.length == walked.length == 700
    np.testing.assert_array_equal(simulated.expert_drove, walked.expert_drove)
    for name, here, there in (
        ("q", walked.q[..., 2:], simulated.q[..., 2:]),
        ("v", walked.v, simulated.v),
        ("torque", walked.torque, simulated.torque),
    ):
        np.testing.assert_allclose(here, there, atol=1e-5, err_msg=name)
    # Without them it would be another one.
    alone, _ = play_out(replace(job, episodes=replace(job.episodes, starts=walked.starts)))
    assert np.abs(alone.v - walked.v).max() > 0.05
