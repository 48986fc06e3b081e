"""The engine: exact bookkeeping on a simulator of a few lines, and the rest on MuJoCo."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.config import Config, PolicyConfig, SafetyConfig
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy
from surefoot.mpc.expert import Expert, make_expert
from surefoot.robots.model import clip_torque, standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly, SafetySwitch
from surefoot.rollouts.engine import Rollout, rollout
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.disturbance import Disturbance, Pushes
from surefoot.scenarios.starts import Starts, load_starts
from surefoot.sim import make_simulator
from surefoot.types import MotionPlan
from tests.fakes.learning import spec_of
from tests.fakes.simulator import FakeSimulator

ROBOT = solo12()
STANDING = standing(ROBOT)
CONFIG = Config()
STORED = load_starts()
LIMIT = ROBOT.torque_limit


def starts_of(ticks, commands=None):
    n = len(ticks)
    command = np.zeros((n, 3)) if commands is None else np.array(commands, float)
    q = np.tile(STANDING, (n, 1))
    return Starts(q, np.zeros((n, 18)), np.array(ticks), command, np.arange(n) + 70)


class Fake:
    """A controller: ``base`` plus a little of the state and the tick; remembers its calls."""

    def __init__(self, base, gives_up=None):
        self.base, self.gives_up = base, gives_up or {}

    def reset(self, batch):
        self.calls, self._diverged = [], np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        self.calls.append((tick.copy(), command.copy(), mask.copy()))
        for robot, at in self.gives_up.items():
            self._diverged[robot] |= bool(mask[robot] and tick[robot] >= at)
        torque = self.base + 0.01 * state.q[:, 7:] + 1e-3 * (tick % 7)[:, None] + command[:, :1]
        return np.where(mask[:, None], torque, np.nan)  # rows outside the mask are arbitrary

    @property
    def diverged(self):
        return self._diverged


class Script:
    """Who drives, from strings: X expert, dot policy."""

    def __init__(self, *rows):
        self.rows = np.array([[mark == "X" for mark in row] for row in rows])

    def reset(self, episode):
        self.ticks = []

    def choose(self, state, tick, command):
        self.ticks.append(tick.copy())
        return self.rows[:, len(self.ticks) - 1]


def same(a: Rollout, b: Rollout, rows_a: Any = slice(None), rows_b: Any = slice(None)) -> None:
    """Every bit of what happened is equal."""
    np.testing.assert_array_equal(a.length[rows_a], b.length[rows_b])
    np.testing.assert_array_equal(a.outcome[rows_a], b.outcome[rows_b])
    happened = a.happened[rows_a]
    for name in ("q", "v", "com", "feet", "contacts", "torque", "expert_drove"):
        one, other = getattr(a, name)[rows_a], getattr(b, name)[rows_b]
        np.testing.assert_array_equal(one[happened], other[happened], err_msg=name)


# --- bookkeeping, on the fake simulator


def test_record_is_what_happened_tick_by_tick():
    simulator, expert, policy = FakeSimulator(2), Fake(1.0), Fake(-1.0)
    starts = starts_of([0, 130], [[0.1, 0, 0], [0.2, 0, 0]])
    rows = ("..XXX.XXXX", "XX......X.")
    script = Script(*rows)
    record = rollout(simulator, ROBOT, starts, 0.010, script, expert, policy)

    assert record.q.shape == (2, 10, 19)
    assert record.v.shape == (2, 10, 18)
    assert record.com.shape == (2, 10, 3)
    assert record.feet.shape == (2, 10, 4, 3)
    assert record.contacts.shape == (2, 10, 4)
    assert record.torque.shape == (2, 10, 12)
    assert record.duration == 10
    assert record.length.tolist() == [10, 10]
    assert record.starts is starts
    np.testing.assert_array_equal(record.expert_drove, script.rows)
    # The state of a tick is the one before its step: it starts with the start.
    np.testing.assert_array_equal(record.q[:, 0], starts.q)
    np.testing.assert_allclose(record.q[:, :, 0], np.tile(np.arange(10) * 1e-3, (2, 1)))
    np.testing.assert_array_equal(record.feet[0, :, 0, 0], np.arange(10))
    np.testing.assert_allclose(record.com[..., 2], record.q[..., 2] - 0.01)
    # The torque of a tick is the driver's, and moves the joints to the next tick's.
    ticks = starts.tick[:, None] + np.arange(10)
    base = np.where(script.rows, 1.0, -1.0)[..., None]
    command = starts.command[:, None, :1]
    expected = base + 0.01 * record.q[..., 7:] + 1e-3 * (ticks % 7)[..., None] + command
    np.testing.assert_array_equal(record.torque, expected)
    moved = record.q[:, :-1, 7:] + 1e-3 * record.torque[:, :-1]
    np.testing.assert_array_equal(record.q[:, 1:, 7:], moved)
    np.testing.assert_array_equal(np.swapaxes(np.array(simulator.applied), 0, 1), record.torque)


def test_each_controller_is_asked_for_its_robots_only_and_with_the_gait_clock():
    expert, policy = Fake(1.0), Fake(-1.0)
    script = Script("..XXX.....", "X.........")
    starts = starts_of([0, 130], [[0.1, 0, 0], [0.2, 0, 0]])
    rollout(FakeSimulator(2), ROBOT, starts, 0.010, script, expert, policy)
    by_expert = {int(tick[0]): mask.tolist() for tick, _, mask in expert.calls}
    assert by_expert == {0: [False, True], **{t: [True, False] for t in (2, 3, 4)}}
    by_policy = {int(tick[0]): mask for tick, _, mask in policy.calls}
    assert sorted(by_policy) == list(range(10))
    for elapsed in range(10):
        np.testing.assert_array_equal(by_policy[elapsed], ~script.rows[:, elapsed])
    for tick, command, _ in [*expert.calls, *policy.calls]:
        assert tick[1] - tick[0] == 130
        np.testing.assert_array_equal(command, starts.command)


def test_applied_torque_is_clipped_and_recorded_as_applied():
    class Wild(Fake):
        def torque(self, state, tick, command, mask):
            torque = np.full((len(mask), 12), -0.5)
            torque[:, :6] = [np.nan, np.inf, -np.inf, 100.0, -100.0, LIMIT + 1e-9]
            return torque

    simulator = FakeSimulator(3)
    script = Script("X" * 5, "." * 5, "X.X.X")
    record = rollout(simulator, ROBOT, starts_of([0, 0, 0]), 0.005, script, Wild(0), Wild(0))
    expected = [0.0, LIMIT, -LIMIT, LIMIT, -LIMIT, LIMIT, *[-0.5] * 6]
    np.testing.assert_array_equal(record.torque, np.broadcast_to(expected, (3, 5, 12)))
    np.testing.assert_array_equal(np.array(simulator.applied).swapaxes(0, 1), record.torque)


def test_a_fall_ends_that_robot_and_it_is_stepped_no_more():
    simulator, expert, policy = FakeSimulator(3, heights={1: [(620, 0.09)]}), Fake(0.1), Fake(-0.1)
    script = Script("." * 800, "X" * 800, "." * 800)
    record = rollout(simulator, ROBOT, starts_of([0, 0, 0]), 0.8, script, expert, policy)
    assert record.length.tolist() == [800, 620, 800]
    assert record.outcome.tolist() == [Outcome.SUCCESS, Outcome.FELL, Outcome.SUCCESS]
    assert simulator.ticks.tolist() == [800, 620, 800]
    for elapsed, mask in enumerate(simulator.masks):
        assert mask.tolist() == [True, elapsed < 620, True]
    assert len(expert.calls) == 620  # nobody drives a fallen robot
    np.testing.assert_array_equal(record.happened.sum(axis=1), record.length)


@pytest.mark.parametrize(
    ("fall", "length"), [(0, 500), (3, 500), (499, 500), (500, 500), (501, 501), (700, 700)]
)
def test_falls_are_tested_from_the_end_of_the_grace_on(fall, length):
    simulator = FakeSimulator(1, heights={0: [(fall, 0.09)]})
    record = rollout(simulator, ROBOT, starts_of([0]), 0.7, ExpertOnly(), Fake(0.0))
    # Also the state that the last tick leads to is looked at.
    assert (record.length[0], record.outcome[0]) == (length, Outcome.FELL)


def test_a_robot_that_gets_up_within_the_grace_has_not_fallen():
    class Rising(FakeSimulator):
        @property
        def state(self):
            state = super().state
            low = (self.ticks < 480)[:, None] & (np.arange(19) == 2)
            return replace(state, q=np.where(low, 0.05, state.q))

    record = rollout(Rising(1), ROBOT, starts_of([0]), 0.9, ExpertOnly(), Fake(0.0))
    assert record.outcome.tolist() == [Outcome.SUCCESS]


@pytest.mark.parametrize("tick", [0, 1, 137, 500, 640])
def test_numbers_that_run_away_end_a_robot_at_once(tick):
    simulator = FakeSimulator(2, lost={1: tick})
    record = rollout(simulator, ROBOT, starts_of([0, 0]), 0.7, ExpertOnly(), Fake(0.0))
    assert record.length.tolist() == [700, tick]
    assert record.outcome.tolist() == [Outcome.SUCCESS, Outcome.FELL]
    assert simulator.ticks.tolist() == [700, tick]


def test_a_rollout_of_robots_that_are_all_lost_stops():
    simulator = FakeSimulator(2, lost={0: 4, 1: 9})
    record = rollout(simulator, ROBOT, starts_of([0, 0]), 0.7, ExpertOnly(), Fake(0.0))
    assert len(simulator.applied) == 9
    assert record.length.tolist() == [4, 9]


def test_an_expert_that_gives_up_ends_that_robot():
    simulator, policy = FakeSimulator(3), Fake(-1.0)
    expert = Fake(1.0, gives_up={0: 6, 2: 0})
    script = Script("....XXXXXX", "....XXXXXX", "..........")
    record = rollout(simulator, ROBOT, starts_of([0, 0, 0]), 0.010, script, expert, policy)
    assert record.length.tolist() == [6, 10, 10]
    assert record.outcome[0] == Outcome.DIVERGED
    assert Outcome.DIVERGED not in record.outcome[1:]
    assert simulator.ticks.tolist() == [6, 10, 10]


def test_invalid_plans_at_a_takeover_are_divergence():
    def plan(state, tick, command):
        rows = np.zeros((100, 12))
        return MotionPlan(rows, rows, rows, valid=tick < 50)

    expert = Expert(plan, 1.0, 0.1)
    script = Script("X" * 30 + "." * 90, "." * 40 + "X" * 80, "." * 70 + "X" * 50, "X" * 120)
    simulator = FakeSimulator(4)
    record = rollout(simulator, ROBOT, starts_of([0] * 4), 0.12, script, expert, Fake(0.0))
    # The third takes over without a plan; the others live on the second half of an old one until
    # the second invalid plan in a row, at tick 100.
    assert record.length.tolist() == [120, 100, 70, 100]
    assert record.outcome.tolist()[1:] == [Outcome.DIVERGED] * 3
    assert expert.plans.tolist() == [1, 3, 1, 3]
    assert expert.invalid_plans.tolist() == [0, 2, 1, 2]


def test_the_expert_drives_the_tail_and_fallen_robots_get_none():
    simulator, expert, policy = FakeSimulator(2, heights={0: [(700, 0.05)]}), Fake(1.0), Fake(-1.0)
    record = rollout(
        simulator, ROBOT, starts_of([0, 0]), 0.8, PolicyOnly(), expert, policy, tail=0.2
    )
    assert record.q.shape[1] == 1000
    assert record.duration == 800
    assert record.length.tolist() == [700, 1000]
    assert not record.expert_drove[:, :800].any()
    assert record.expert_drove[1, 800:].all()
    assert [int(tick[0]) for tick, _, _ in expert.calls] == list(range(800, 1000))
    assert all(mask.tolist() == [False, True] for _, _, mask in expert.calls)
    assert (record.torque[1, 800:] > 0).all()
    assert (record.torque[1, :800] < 0).all()


def test_falls_in_the_tail_are_falls():
    simulator = FakeSimulator(2, heights={0: [(900, 0.05)], 1: [(1000, 0.05)]})
    record = rollout(simulator, ROBOT, starts_of([0, 0]), 0.8, ExpertOnly(), Fake(0.0), tail=0.2)
    assert record.length.tolist() == [900, 1000]
    assert record.outcome.tolist() == [Outcome.FELL, Outcome.FELL]


def test_the_arbiter_is_asked_once_a_tick_and_not_about_the_tail():
    script = Script("." * 20, "X" * 20)
    starts = starts_of([100, 350])
    rollout(FakeSimulator(2), ROBOT, starts, 0.020, script, Fake(0.0), Fake(0.0), tail=0.01)
    np.testing.assert_array_equal(script.ticks, starts.tick + np.arange(20)[:, None])


def test_stepping_is_judged_without_the_tail():
    class Stops(FakeSimulator):
        def __init__(self, batch, walks):
            super().__init__(batch)
            self.walks = walks

        @property
        def state(self):
            state = super().state
            walks = self.walks(self.ticks)[:, None]
            low = np.where(walks, state.feet[..., 2], ROBOT.foot_radius)
            feet = np.concatenate([state.feet[..., :2], low[..., None]], axis=2)
            return replace(state, feet=feet, contacts=state.contacts | ~walks)

    def outcome(walks):
        simulator = Stops(1, walks)
        record = rollout(simulator, ROBOT, starts_of([0]), 1.6, ExpertOnly(), Fake(0.0), tail=1.6)
        return record.outcome.tolist()

    assert outcome(lambda ticks: ticks < 1600) == [Outcome.SUCCESS]  # stands in the tail only
    assert outcome(lambda ticks: ticks >= 1600) == [Outcome.STALLED]  # walks in the tail only


def test_another_number_of_starts_is_an_error():
    with pytest.raises(ValueError, match="3 starts for a simulator of 2 robots; make it 3"):
        rollout(FakeSimulator(2), ROBOT, starts_of([0, 0, 0]), 0.1, ExpertOnly(), Fake(0.0))


def test_an_arbiter_that_wants_a_policy_needs_one():
    with pytest.raises(ValueError, match="asks for a policy, but none was given"):
        rollout(FakeSimulator(1), ROBOT, starts_of([0]), 0.1, PolicyOnly(), Fake(0.0))


def test_progress_counts_all_ticks():
    done = []
    starts = starts_of([0])
    rollout(
        FakeSimulator(1),
        ROBOT,
        starts,
        0.4,
        ExpertOnly(),
        Fake(0.0),
        tail=0.1,
        progress=done.append,
    )
    assert sum(done) == 500


def test_fall_bounds_come_from_the_config():
    safety = SafetyConfig(fall_height=(0.3, 2.0), grace=0.01)
    starts = starts_of([0])
    record = rollout(FakeSimulator(1), ROBOT, starts, 0.1, ExpertOnly(), Fake(0.0), safety=safety)
    assert (record.length[0], record.outcome[0]) == (10, Outcome.FELL)


# --- frames


def test_frames_come_episode_by_episode_in_time_and_hold_the_record():
    simulator = FakeSimulator(3, heights={1: [(510, 0.05)]})
    rng = np.random.default_rng(0)
    script = Script(*("".join(rng.choice(["X", "."], 600)) for _ in range(3)))
    starts = starts_of([50, 400, 0], [[0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]])
    record = rollout(simulator, ROBOT, starts, 0.6, script, Fake(1.0), Fake(-1.0))
    keep = (rng.random((3, 600)) < 0.3) & record.expert_drove
    keep[1, 510:] = True
    episode = np.array([12, 5, 900])
    frames = record.frames(keep, episode)

    expected = [(b, t) for b in range(3) for t in range(600) if keep[b, t] and t < record.length[b]]
    assert len(frames) == len(expected)
    assert (keep[1, 510:]).any()  # asked for, but these ticks did not happen
    for row, (b, t) in enumerate(expected):
        for name in ("q", "v", "com", "feet", "contacts", "torque", "expert_drove"):
            np.testing.assert_array_equal(getattr(frames, name)[row], getattr(record, name)[b, t])
        assert frames.tick[row] == starts.tick[b] + t
        np.testing.assert_array_equal(frames.command[row], starts.command[b])
        assert frames.episode[row] == episode[b]
        assert frames.outcome[row] == record.outcome[b]


def test_frames_of_the_policy_are_no_frames_of_the_expert():
    script = Script("XX..XX")
    starts = starts_of([0])
    record = rollout(FakeSimulator(1), ROBOT, starts, 0.006, script, Fake(0.0), Fake(1.0))
    with pytest.raises(ValueError, match="the expert was not asked"):
        record.frames(np.ones((1, 6), bool), np.array([0]))
    assert len(record.frames(record.expert_drove, np.array([0]))) == 4


def test_a_rollout_needs_a_duration_and_a_command():
    arguments = (ExpertOnly(), Fake(0.0))
    with pytest.raises(ValueError, match="use at least"):
        rollout(FakeSimulator(1), ROBOT, starts_of([0]), 0.0, *arguments)
    with pytest.raises(ValueError, match="finite numbers"):
        rollout(FakeSimulator(1), ROBOT, starts_of([0], [[np.nan, 0, 0]]), 0.1, *arguments)


def test_nothing_kept_is_no_frames():
    record = rollout(FakeSimulator(1), ROBOT, starts_of([0]), 0.01, ExpertOnly(), Fake(0.0))
    assert len(record.frames(np.zeros((1, 10), bool), np.array([0]))) == 0
    assert len(record.frames(np.ones((1, 10), bool), np.array([0]))) == 10


# --- on MuJoCo


class Shaking:
    """PD to the standing pose and a tremor; no robot is like another in its command's vx."""

    def __init__(self, tremor=0.3, kp=3.0):
        self.tremor, self.kp = tremor, kp

    def reset(self, batch):
        self._batch = batch

    def torque(self, state, tick, command, mask):
        pd = self.kp * (STANDING[7:] - state.q[:, 7:]) - 0.1 * state.v[:, 6:]
        phase = (tick * 0.23 + 100 * command[:, 0])[:, None] + 1.7 * np.arange(12)
        return pd + self.tremor * np.sin(phase)

    @property
    def diverged(self):
        return np.zeros(self._batch, bool)


def run(starts, duration, arbiter, expert, policy=None, tail=0.0) -> Rollout:
    simulator = make_simulator(ROBOT, len(starts), CONFIG.simulation)
    return rollout(simulator, ROBOT, starts, duration, arbiter, expert, policy, tail, CONFIG.safety)


@pytest.mark.parametrize("fault", [1e8, 1e12, np.nan, np.inf])
def test_a_robot_that_blows_up_is_lost_at_once_and_no_other_notices(fault):
    starts = STORED["select"][np.arange(20, 24)]
    healthy = run(starts, 0.6, ExpertOnly(), Shaking())
    broken = replace(starts, v=starts.v.copy())
    broken.v[2, 14] = fault
    record = run(broken, 0.6, ExpertOnly(), Shaking())
    assert record.outcome[2] == Outcome.FELL
    assert record.length[2] < 100  # well inside the grace
    others = [0, 1, 3]
    same(record, healthy, others, others)
    assert record.length[0] == 600


def test_a_standing_trembling_robot_has_stalled():
    starts = starts_of([0] * 4, [[x, 0, 0] for x in (0.0, 0.1, 0.2, 0.3)])
    for tremor in (0.0, 1.0):
        record = run(starts, 1.6, ExpertOnly(), Shaking(tremor))
        assert record.outcome.tolist() == [Outcome.STALLED] * 4
    # The strongest tremor does break contacts.
    assert (np.diff(record.contacts.astype(int), axis=1) != 0).sum() > 50


def test_the_expert_trots_and_repeats_itself_bit_for_bit():
    starts = STORED["nominal"][np.array([0, 19])]
    expert = make_expert(ROBOT, CONFIG)
    # A third of the episode has to hold a touchdown of every foot: 0.52 s at least.
    record = run(starts, 1.6, ExpertOnly(), expert)
    assert record.outcome.tolist() == [Outcome.SUCCESS] * 2
    assert expert.plans.tolist() == [32, 32]
    assert record.q[1, -1, 0] > 0.3  # of 0.45 m at the commanded speed
    assert np.abs(record.torque).max() <= LIMIT
    # The same expert again, and another one.
    shorter = starts[np.array([1, 0])]
    for driver in (expert, make_expert(ROBOT, CONFIG)):
        again = run(shorter, 0.2, ExpertOnly(), driver)
        for row, twin in ((0, 1), (1, 0)):
            np.testing.assert_array_equal(again.q[row], record.q[twin, :200])
            np.testing.assert_array_equal(again.torque[row], record.torque[twin, :200])


def test_an_episode_is_the_same_in_any_batch_and_place():
    """Policy, monitor, takeovers of the expert off the grid, and tail, all together."""
    starts = STORED["select"][np.array([3, 31, 47, 55, 68])]
    network = PolicyNetwork(PolicyConfig(hidden=(32, 32)), seed=1)
    policy = Policy(network, spec_of(PolicyConfig()), np.zeros((2, 3)))
    expert = make_expert(ROBOT, CONFIG)

    def episodes(rows):
        switch = SafetySwitch(SafetyMonitor(Bounds(CONFIG.safety), 0.06))
        return run(starts[np.array(rows)], 0.25, switch, expert, policy, tail=0.03)

    record = episodes([0, 1, 2, 3, 4])
    share = record.expert_drove[:, :250].mean(axis=1)
    assert (share > 0).all()
    assert (share < 1).all()
    assert record.expert_drove[:, 250:].all()
    for rows in ([4, 2, 0], [3], [1]):
        same(episodes(rows), record, slice(None), rows)


def test_recorded_torques_replay_the_motion():
    """What stands in the record is what the simulator was given."""
    starts = STORED["select"][np.arange(2)]
    record = run(starts, 0.3, ExpertOnly(), Shaking(tremor=4.0))
    assert (np.abs(record.torque) == LIMIT).any()
    simulator = make_simulator(ROBOT, 2, CONFIG.simulation)
    simulator.reset(starts.q, starts.v)
    for tick in range(300):
        np.testing.assert_array_equal(simulator.state.q, record.q[:, tick])
        np.testing.assert_array_equal(simulator.state.contacts, record.contacts[:, tick])
        simulator.step(record.torque[:, tick])
    np.testing.assert_array_equal(record.torque, clip_torque(record.torque, LIMIT))


def test_a_push_acts_on_its_robot_at_its_time_in_its_heading():
    simulator = FakeSimulator(3, heights={2: [(4, 0.05)]})
    starts = starts_of([0, 0, 0])
    starts.q[1, 3:7] = [0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)]  # heads along y
    impulse = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.2], [3.0, 0.0, 0.0]])
    pushes = Disturbance(Pushes(impulse[:, None], np.full((3, 1), 3), 5))
    safety = replace(CONFIG.safety, grace=0.0)
    limp = np.zeros((100, 12))
    still = Expert(lambda *_: MotionPlan(limp, limp, limp), 0.0, 0.0)
    rollout(simulator, ROBOT, starts, 0.02, ExpertOnly(), still, None, 0.0, safety, pushes)
    assert [int(tick) for tick, _, _ in simulator.pushes] == [3, 4, 5, 6, 7]
    for tick, given, mask in simulator.pushes:
        # Nobody pushes the first robot, nor the third once it has fallen.
        assert mask.tolist() == [False, True, tick < 4]
        np.testing.assert_allclose(given[1], np.array([-0.5, 1.0, 0.2]) / 5, atol=1e-15)


def test_a_push_of_nothing_changes_no_bit():
    starts = STORED["nominal"][:2]
    simulator = make_simulator(ROBOT, 2)
    expert = make_expert(ROBOT, CONFIG)
    at = np.array([[5], [30]])
    none = Disturbance(Pushes(np.zeros((2, 1, 3)), at, 10))
    tiny = Disturbance(Pushes(np.full((2, 1, 3), 1e-9), at, 10))
    plain, zero, pushed = (
        rollout(simulator, ROBOT, starts, 0.1, ExpertOnly(), expert, disturbance=pushes)
        for pushes in (None, none, tiny)
    )
    np.testing.assert_array_equal(plain.q, zero.q)
    np.testing.assert_array_equal(plain.torque, zero.torque)
    assert not np.array_equal(plain.q, pushed.q)


@pytest.mark.parametrize(
    ("impulse", "tick", "duration", "message"),
    [
        (np.zeros((1, 1, 3)), np.zeros((2, 1), int), 10, "impulse"),
        (np.zeros((2, 3)), np.zeros(2, int), 10, "impulse"),
        (np.full((2, 1, 3), np.nan), np.zeros((2, 1), int), 10, "finite"),
        (np.ones((2, 1, 3)), np.zeros((2, 1), int), 0, "at least 1 ms"),
    ],
)
def test_pushes_that_make_no_sense(impulse, tick, duration, message):
    with pytest.raises(ValueError, match=message):
        Pushes(impulse, tick, duration)


def test_as_many_pushes_as_robots():
    pushes = Disturbance(Pushes(np.ones((3, 1, 3)), np.zeros((3, 1), int), 10))
    expert = make_expert(ROBOT, CONFIG)
    with pytest.raises(ValueError, match="pushes of 3 robots for 1 robots"):
        rollout(
            FakeSimulator(1), ROBOT, starts_of([0]), 0.1, ExpertOnly(), expert, disturbance=pushes
        )
