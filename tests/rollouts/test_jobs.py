"""Many episodes: the same for any number of workers, chunks and companions."""

import json
from dataclasses import fields, replace
from functools import partial
from xml.etree import ElementTree

import numpy as np
import pytest

from surefoot.config import (
    Config,
    DisturbanceConfig,
    EvaluationConfig,
    PolicyConfig,
    RobotConfig,
)
from surefoot.config.array_io import load_arrays
from surefoot.config.checked import known
from surefoot.config.json_io import to_json
from surefoot.config.profiles import ODRI
from surefoot.config.robot_table import SOLO12
from surefoot.files import save_arrays
from surefoot.learning.frames import concatenate
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, save
from surefoot.robots.description import find_urdf
from surefoot.robots.model import standing
from surefoot.robots.scaling import with_own_values
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, SafetySwitch
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.jobs import Job, chunks_of, disturbance_of, play_out, run_chunk, run_episodes
from surefoot.rollouts.summary import Summary, join_summaries
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.disturbance import Disturbance
from surefoot.scenarios.starts import load_starts
from surefoot.types import MotionPlan
from surefoot.workers import Workers, map_chunks
from tests.fakes.learning import spec_of

CONFIG = replace(
    with_own_values(Config()), chunk=2, evaluation=EvaluationConfig(duration=0.3, episodes=5)
)
HIDDEN = PolicyConfig(hidden=(16, 16))
STORED = load_starts()
STANDING = standing(solo12())


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    path = tmp_path_factory.mktemp("policies") / "random.safetensors"
    save(Policy(PolicyNetwork(HIDDEN, seed=2), spec_of(HIDDEN), np.zeros((2, 3)), "solo12"), path)
    return path


def keep_expert(rollouts):
    return rollouts.expert_drove & rollouts.happened


def job_of(policy=None, chunk=2, episodes=5, duration=0.12, tail=0.02, **changes):
    starts = STORED["select"][10 : 10 + episodes]
    arbiter = ExpertOnly()
    if policy is not None:
        arbiter = SafetySwitch(SafetyMonitor(Bounds(CONFIG.safety), 0.05))
    job = Job(
        replace(CONFIG, chunk=chunk),
        Episodes(starts, duration, tail, 300 + np.arange(episodes)),
        arbiter,
        policy=policy,
        keep=keep_expert,
    )
    return replace(job, **changes)


def assert_equal(a, b):
    """Two summaries, or frames, are equal to the bit."""
    for field in fields(a):
        np.testing.assert_array_equal(
            getattr(a, field.name), getattr(b, field.name), err_msg=field.name
        )


def collected(job, workers):
    """Summary and frames of all chunks of a job."""
    parts = map_chunks(run_chunk, chunks_of(job), Workers(workers), "chunks")
    return join_summaries([part.summary for part in parts]), concatenate(
        [part.frames for part in parts]
    )


def test_results_do_not_depend_on_workers_or_chunks(policy):
    """Rescued rollouts of a policy: takeovers off the grid, tail, frames, and all figures."""
    summary, frames = collected(job_of(policy), 1)
    assert 0 < summary.expert_ticks.sum() < summary.proper_ticks.sum()
    assert len(frames) == summary.kept.sum() > 0
    for workers, chunk in ((2, 2), (1, 5), (1, 3)):
        other, other_frames = collected(job_of(policy, chunk), workers)
        assert_equal(summary, other)
        assert_equal(frames, other_frames)


def test_episodes_keep_their_order_and_ids(policy):
    job = job_of(policy, arbiter=PolicyOnly(), tail=0.0)
    summary, frames = collected(job, 1)
    np.testing.assert_array_equal(summary.episode, 300 + np.arange(5))
    np.testing.assert_array_equal(summary.start, job.starts.id)
    np.testing.assert_array_equal(summary.command, job.starts.command)
    assert len(frames) == 0  # the expert never drove
    assert not summary.plans.any()


def test_the_frames_of_a_chunk_are_those_that_the_rule_keeps(policy):
    job = job_of(policy, episodes=2)
    rollouts, _ = play_out(job)
    frames = run_chunk(job).frames
    mask = rollouts.expert_drove & rollouts.happened
    np.testing.assert_array_equal(frames.q, rollouts.q[mask])
    np.testing.assert_array_equal(frames.torque, rollouts.torque[mask])
    np.testing.assert_array_equal(np.unique(frames.episode), [300, 301])
    assert frames.expert_drove.all()
    assert len(run_chunk(replace(job, keep=None)).frames) == 0


def test_an_episode_alone_is_the_same_as_in_its_batch(policy):
    """What replaying a recorded episode relies on."""
    job = job_of(policy, episodes=3)
    rollouts, _ = play_out(job)
    row = np.array([1])
    alone, _ = play_out(job[row])
    np.testing.assert_array_equal(alone.length, rollouts.length[row])
    happened = alone.happened[0]
    np.testing.assert_array_equal(alone.q[0, happened], rollouts.q[1, happened])
    np.testing.assert_array_equal(alone.torque[0, happened], rollouts.torque[1, happened])


def test_summary_counts_plans_of_each_robot():
    job = job_of(episodes=2, duration=0.11, tail=0.0)
    summary = run_episodes(job, Workers(1), "plans")
    offsets = job.starts.tick % 50
    assert not offsets.any()
    np.testing.assert_array_equal(summary.plans, [3, 3])
    np.testing.assert_array_equal(summary.expert_ticks, [110, 110])
    assert summary.expert_drove_last.all()


def test_each_rollout_has_an_expert_of_its_own():
    """Its counters stay as they are when the next rollout begins."""
    longer, first = play_out(job_of(episodes=2, duration=0.11, tail=0.0))
    assert longer.length.tolist() == [110, 110]
    _, second = play_out(job_of(episodes=3, duration=0.01, tail=0.0))
    assert first is not second
    assert first.plans.tolist() == [3, 3]
    assert second.plans.tolist() == [1, 1, 1]


def test_a_plan_function_may_be_an_object_that_counts_as_false():
    class Log(list):
        """Keeps what it was asked; at first, nothing."""

        def __call__(self, state, tick, command):
            self.append(tick)
            still = np.zeros((100, 12))
            return MotionPlan(np.tile(STANDING[7:], (100, 1)), still, still)

    asked = Log()
    play_out(replace(job_of(episodes=1, duration=0.01, tail=0.0), plan=asked))
    assert len(asked) == 1


def test_the_disturbance_that_episodes_bring_takes_the_place_of_the_drawn_one():
    job = job_of(episodes=2, disturbance=DisturbanceConfig(pushes=1, impulse=(0.1, 0.2), delay=4))
    drawn = disturbance_of(job)
    assert drawn.pushes is not None
    assert drawn.delay == 4
    own = Disturbance(delay=2)
    assert disturbance_of(replace(job, episodes=replace(job.episodes, disturbance=own))) is own


def test_the_disturbance_of_an_episode_does_not_depend_on_its_companions():
    config = DisturbanceConfig(pushes=2, impulse=(0.1, 0.2), friction=(0.5, 1.5), mass=(0.8, 1.2))
    job = job_of(episodes=3, disturbance=config)
    together = disturbance_of(job)
    alone = disturbance_of(job[np.array([1])])
    assert together.pushes is not None and alone.pushes is not None
    assert together.mass is not None and alone.mass is not None
    np.testing.assert_array_equal(alone.pushes.impulse, together.pushes.impulse[[1]])
    np.testing.assert_array_equal(alone.pushes.tick, together.pushes.tick[[1]])
    np.testing.assert_array_equal(alone.mass, together.mass[[1]])


def test_a_robot_whose_files_have_changed_is_loaded_again(tmp_path):
    urdf = tmp_path / "mine.urdf"
    text = find_urdf(SOLO12).read_text()
    profile = tmp_path / "mine.json"

    def played(mass: str, torque: float) -> Rollout:
        root = ElementTree.fromstring(text)
        base = root.find("link[@name='base_link']/inertial/mass")
        assert base is not None
        base.set("value", mass)
        urdf.write_bytes(ElementTree.tostring(root))
        profile.write_text(json.dumps(to_json(replace(ODRI, torque_limit=(torque,) * 3))))
        spec = replace(SOLO12, urdf=str(urdf))
        job = job_of(episodes=1, tail=0.0)
        robot = RobotConfig(spec=spec, profile=str(profile))
        return play_out(replace(job, config=replace(job.config, robot=robot)))[0]

    light = played("1.0", 1.8)
    heavy = played("3.0", 1.8)
    weak = played("3.0", 0.2)
    assert light.com[0, 0, 2] < heavy.com[0, 0, 2]  # the base is above the legs
    assert np.abs(heavy.torque).max() > 0.2
    assert np.abs(weak.torque).max() <= 0.2


def first_again(job, rollouts):
    """The first episode of a chunk once more, from where it began, under another id."""
    first = job[:1]
    episodes = replace(first.episodes, id=first.episode + 1000)
    return replace(first, episodes=episodes, query=True, then=None)


def test_episodes_that_follow_are_run_and_appended():
    job = job_of(episodes=2, then=first_again)
    result = run_chunk(job)
    assert result.summary.episode.tolist() == [300, 301, 1300]
    assert result.summary.query.tolist() == [False, False, True]
    assert result.summary.kept.tolist()[0] == result.summary.kept.tolist()[2] > 0
    assert np.unique(result.frames.episode).tolist() == [300, 301, 1300]
    assert len(result.frames) == result.summary.kept.sum()


def test_a_trace_is_returned_where_the_job_asks_for_one():
    job = job_of(episodes=2)
    assert run_chunk(job).trace is None
    trace = run_chunk(replace(job, trace=True)).trace
    assert trace is not None
    assert trace.episode.tolist() == [300, 301]
    assert trace.inputs.shape == (2, 12, 47)


def test_a_summary_comes_back_from_its_file_to_the_bit(policy, tmp_path):
    summary = run_episodes(job_of(policy, episodes=2), Workers(1), "file")
    path = tmp_path / "episodes" / "part.npz"
    save_arrays(path, summary)
    assert_equal(summary, load_arrays(path, Summary))


def stiff(state, tick, command):
    """A user's own MPC: stand, stiffly."""
    rows = np.zeros((100, 12))
    return MotionPlan(np.tile(STANDING[7:], (100, 1)), rows, rows + 0.01 * command.vx)


class Stiff:
    """The same as an object, which is called in a worker too."""

    def __call__(self, state, tick, command):
        return stiff(state, tick, command)


@pytest.mark.parametrize(
    ("plan", "name", "workers"),
    [
        (stiff, "stiff", 1),
        (stiff, "stiff", 2),
        (partial(stiff), "stiff", 2),
        (Stiff(), "Stiff", 1),
        (lambda *given: stiff(*given), "<lambda>", 2),
        (None, "surefoot.mpc.planner", 1),
    ],
)
def test_the_expert_has_the_name_of_its_plan(plan, name, workers):
    summary, _ = collected(job_of(plan=plan, duration=0.01, tail=0.0), workers)
    assert summary.expert.tolist() == [name] * 5


@pytest.mark.parametrize("workers", [1, 2])
def test_the_plan_of_a_user_drives_as_the_expert(workers):
    job = job_of(plan=stiff, duration=0.06, tail=0.0)
    summary, frames = collected(job, workers)
    config = with_own_values(CONFIG)
    kp = known(config.expert.kp, "kp")
    kd = known(config.expert.kd, "kd")
    pd = kp * (STANDING[7:] - frames.q[:, 7:]) - kd * frames.v[:, 6:]
    tau = pd + 0.01 * frames.command[:, :1]
    limit = known(config.robot.torque_limit, "limit")
    np.testing.assert_allclose(frames.torque, np.clip(tau, -limit, limit), atol=1e-12)
    assert summary.plans.tolist() == [2] * 5
