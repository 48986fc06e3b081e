"""The engine's bookkeeping, exact to the tick, on a simulator of a few lines."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import SafetyConfig
from surefoot.mpc.expert import Expert
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.disturbance import Disturbance, Pushes
from surefoot.types import MotionPlan
from tests.fakes.drivers import FakeController, Script, standing_for, starts_of
from tests.fakes.gates import NOT_FLAGS, CarelessArbiter
from tests.fakes.robots import ROBOT
from tests.fakes.simulator import FakeSimulator

LIMIT = float(ROBOT.torque_limit[0])


# --- what is recorded


def test_every_array_holds_what_happened_tick_by_tick():
    simulator = FakeSimulator(2)
    expert = FakeController(1.0)
    policy = FakeController(-1.0)
    starts = starts_of([0, 130], [[0.1, 0, 0], [0.2, 0, 0]])
    script = Script("..XXX.XXXX", "XX......X.")
    rollouts = rollout(simulator, Episodes(starts, 0.010), script, expert, policy)

    assert rollouts.q.shape == (2, 10, 19)
    assert rollouts.v.shape == (2, 10, 18)
    assert rollouts.com.shape == (2, 10, 3)
    assert rollouts.feet.shape == (2, 10, 4, 3)
    assert rollouts.contacts.shape == (2, 10, 4)
    assert rollouts.torque.shape == (2, 10, 12)
    assert rollouts.duration == 10
    assert rollouts.length.tolist() == [10, 10]
    assert rollouts.starts is starts
    np.testing.assert_array_equal(rollouts.expert_drove, script.rows)
    # The state of a tick is the one before its step: the first is the initial state.
    np.testing.assert_array_equal(rollouts.q[:, 0], starts.q)
    np.testing.assert_allclose(rollouts.q[:, :, 0], np.tile(np.arange(10) * 1e-3, (2, 1)))
    np.testing.assert_array_equal(rollouts.feet[0, :, 0, 0], np.arange(10))
    np.testing.assert_allclose(rollouts.com[..., 2], rollouts.q[..., 2] - 0.01)
    # The torque of a tick is the driver's, and moves the joints to the next tick's.
    ticks = starts.tick[:, None] + np.arange(10)
    base = np.where(script.rows, 1.0, -1.0)[..., None]
    command = starts.command[:, None, :1]
    expected = base + 0.01 * rollouts.q[..., 7:] + 1e-3 * (ticks % 7)[..., None] + command
    np.testing.assert_array_equal(rollouts.torque, expected)
    moved = rollouts.q[:, :-1, 7:] + 1e-3 * rollouts.torque[:, :-1]
    np.testing.assert_array_equal(rollouts.q[:, 1:, 7:], moved)
    np.testing.assert_array_equal(np.swapaxes(np.array(simulator.applied), 0, 1), rollouts.torque)


def test_each_controller_is_asked_for_its_robots_only_and_with_the_gait_clock():
    expert = FakeController(1.0)
    policy = FakeController(-1.0)
    script = Script("..XXX.....", "X.........")
    starts = starts_of([0, 130], [[0.1, 0, 0], [0.2, 0, 0]])
    rollout(FakeSimulator(2), Episodes(starts, 0.010), script, expert, policy)
    by_expert = {int(tick[0]): mask.tolist() for tick, _, mask in expert.calls}
    assert by_expert == {0: [False, True], **{t: [True, False] for t in (2, 3, 4)}}
    by_policy = {int(tick[0]): mask for tick, _, mask in policy.calls}
    assert sorted(by_policy) == list(range(10))
    for elapsed in range(10):
        np.testing.assert_array_equal(by_policy[elapsed], ~script.rows[:, elapsed])
    for tick, command, _ in [*expert.calls, *policy.calls]:
        assert tick[1] - tick[0] == 130
        np.testing.assert_array_equal(command, starts.command)


def test_torques_of_a_wrong_shape_are_an_error_that_names_the_right_one():
    class Short(FakeController):
        def torque(self, state, tick, command, mask):
            return super().torque(state, tick, command, mask)[:, :11]

    with pytest.raises(ValueError, match=r"torques \(2, 11\) for 2 robots; give \(2, 12\)"):
        rollout(FakeSimulator(2), standing_for(0.004, batch=2), PolicyOnly(), Short(), Short())


def test_an_expert_that_is_always_asked_answers_where_it_does_not_drive_too():
    expert = FakeController(1.0)
    policy = FakeController(-1.0)
    script = Script("..XX", "XXXX")
    episodes = standing_for(0.004, batch=2)
    rollouts = rollout(FakeSimulator(2), episodes, script, expert, policy, ask_always=True)
    assert [mask.tolist() for _, _, mask in expert.calls] == [[True, True]] * 4
    assert rollouts.expert_asked.all()
    np.testing.assert_array_equal(rollouts.expert_drove, script.rows)
    difference = np.where(script.rows, 0.0, -2.0)
    np.testing.assert_allclose(
        rollouts.torque, rollouts.expert_torque + difference[..., None], atol=1e-15
    )
    # Asked only where it drives, its torque is the one commanded, and no other is recorded.
    rollouts = rollout(FakeSimulator(2), episodes, script, expert, policy)
    np.testing.assert_array_equal(rollouts.expert_asked, script.rows)
    assert np.shares_memory(rollouts.expert_torque, rollouts.torque)


def test_torques_are_clipped_before_they_are_applied_and_recorded():
    class Wild(FakeController):
        def torque(self, state, tick, command, mask):
            torque = np.full((len(mask), 12), -0.5)
            torque[:, :6] = [np.nan, np.inf, -np.inf, 100.0, -100.0, LIMIT + 1e-9]
            return torque

    simulator = FakeSimulator(3)
    script = Script("X" * 5, "." * 5, "X.X.X")
    rollouts = rollout(simulator, standing_for(0.005, batch=3), script, Wild(), Wild())
    expected = [0.0, LIMIT, -LIMIT, LIMIT, -LIMIT, LIMIT, *[-0.5] * 6]
    np.testing.assert_array_equal(rollouts.torque, np.broadcast_to(expected, (3, 5, 12)))
    np.testing.assert_array_equal(np.array(simulator.applied).swapaxes(0, 1), rollouts.torque)


def test_the_arbiter_gets_the_ids_of_the_episodes():
    script = Script("X", "X")
    starts = starts_of([0, 0])
    rollout(FakeSimulator(2), Episodes(starts, 0.001), script, FakeController())
    assert script.episode.tolist() == [0, 1]
    episodes = Episodes(starts, 0.001, id=np.array([300, 17]))
    rollout(FakeSimulator(2), episodes, script, FakeController())
    assert script.episode.tolist() == [300, 17]


# --- how episodes end


def test_a_fall_ends_that_robot_and_it_is_stepped_no_more():
    simulator = FakeSimulator(3, heights={1: [(620, 0.09)]})
    expert = FakeController(0.1)
    script = Script("." * 800, "X" * 800, "." * 800)
    episodes = standing_for(0.8, batch=3)
    rollouts = rollout(simulator, episodes, script, expert, FakeController(-0.1))
    assert rollouts.length.tolist() == [800, 620, 800]
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS, Outcome.FELL, Outcome.SUCCESS]
    assert rollouts.failed.tolist() == [False, True, False]
    assert simulator.ticks.tolist() == [800, 620, 800]
    for elapsed, mask in enumerate(simulator.masks):
        assert mask.tolist() == [True, elapsed < 620, True]
    assert len(expert.calls) == 620  # it is not asked about a robot that has fallen
    np.testing.assert_array_equal(rollouts.happened.sum(axis=1), rollouts.length)


@pytest.mark.parametrize(
    ("fall", "length"), [(0, 500), (3, 500), (499, 500), (500, 500), (501, 501), (700, 700)]
)
def test_falls_are_tested_from_the_end_of_the_grace_on(fall, length):
    simulator = FakeSimulator(1, heights={0: [(fall, 0.09)]})
    rollouts = rollout(simulator, standing_for(0.7), ExpertOnly(), FakeController())
    # The state that the last tick leads to is tested too.
    assert (rollouts.length[0], rollouts.outcome[0]) == (length, Outcome.FELL)


def test_a_robot_that_gets_up_within_the_grace_has_not_fallen():
    class Rising(FakeSimulator):
        @property
        def state(self):
            state = super().state
            low = (self.ticks < 480)[:, None] & (np.arange(19) == 2)
            return replace(state, q=np.where(low, 0.05, state.q))

    rollouts = rollout(Rising(1), standing_for(0.9), ExpertOnly(), FakeController())
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS]


@pytest.mark.parametrize("tick", [0, 1, 137, 500, 640])
def test_numbers_that_run_away_end_a_robot_at_once(tick):
    simulator = FakeSimulator(2, lost={1: tick})
    rollouts = rollout(simulator, standing_for(0.7, batch=2), ExpertOnly(), FakeController())
    assert rollouts.length.tolist() == [700, tick]
    assert rollouts.outcome.tolist() == [Outcome.SUCCESS, Outcome.FELL]
    assert simulator.ticks.tolist() == [700, tick]


def test_a_rollout_of_robots_that_are_all_lost_stops():
    simulator = FakeSimulator(2, lost={0: 4, 1: 9})
    rollouts = rollout(simulator, standing_for(0.7, batch=2), ExpertOnly(), FakeController())
    assert len(simulator.applied) == 9
    assert rollouts.length.tolist() == [4, 9]


def test_an_expert_that_gives_up_ends_that_robot():
    simulator = FakeSimulator(3)
    expert = FakeController(1.0, gives_up={0: 6, 2: 0})
    script = Script("....XXXXXX", "....XXXXXX", "..........")
    episodes = standing_for(0.010, batch=3)
    rollouts = rollout(simulator, episodes, script, expert, FakeController(-1.0))
    assert rollouts.length.tolist() == [6, 10, 10]
    assert rollouts.outcome[0] == Outcome.DIVERGED
    assert Outcome.DIVERGED not in rollouts.outcome[1:]
    assert simulator.ticks.tolist() == [6, 10, 10]


def test_invalid_plans_at_a_takeover_are_divergence():
    def plan(state, tick, command):
        rows = np.zeros((100, 12))
        return MotionPlan(rows, rows, rows, valid=tick < 50)

    expert = Expert(plan, 1.0, 0.1)
    script = Script("X" * 30 + "." * 90, "." * 40 + "X" * 80, "." * 70 + "X" * 50, "X" * 120)
    episodes = standing_for(0.12, batch=4)
    rollouts = rollout(FakeSimulator(4), episodes, script, expert, FakeController())
    # The third takes over without a plan; the others follow the second half of an old one until
    # the second invalid plan in a row, at tick 100.
    assert rollouts.length.tolist() == [120, 100, 70, 100]
    assert rollouts.outcome.tolist()[1:] == [Outcome.DIVERGED] * 3
    assert expert.plans.tolist() == [1, 3, 1, 3]
    assert expert.invalid_plans.tolist() == [0, 2, 1, 2]


def test_fall_bounds_come_from_the_config():
    safety = SafetyConfig(fall_height=(0.3, 2.0), grace=0.01)
    episodes = standing_for(0.1)
    rollouts = rollout(FakeSimulator(1), episodes, ExpertOnly(), FakeController(), safety=safety)
    assert (rollouts.length[0], rollouts.outcome[0]) == (10, Outcome.FELL)


# --- the tail


def test_the_expert_drives_the_tail_of_robots_that_have_not_fallen():
    simulator = FakeSimulator(2, heights={0: [(700, 0.05)]})
    expert = FakeController(1.0)
    episodes = standing_for(0.8, tail=0.2, batch=2)
    rollouts = rollout(simulator, episodes, PolicyOnly(), expert, FakeController(-1.0))
    assert rollouts.q.shape[1] == 1000
    assert rollouts.duration == 800
    assert rollouts.length.tolist() == [700, 1000]
    assert not rollouts.expert_drove[:, :800].any()
    assert rollouts.expert_drove[1, 800:].all()
    assert [int(tick[0]) for tick, _, _ in expert.calls] == list(range(800, 1000))
    assert all(mask.tolist() == [False, True] for _, _, mask in expert.calls)
    assert (rollouts.torque[1, 800:] > 0).all()
    assert (rollouts.torque[1, :800] < 0).all()


def test_falls_in_the_tail_are_falls():
    simulator = FakeSimulator(2, heights={0: [(900, 0.05)], 1: [(1000, 0.05)]})
    episodes = standing_for(0.8, tail=0.2, batch=2)
    rollouts = rollout(simulator, episodes, ExpertOnly(), FakeController())
    assert rollouts.length.tolist() == [900, 1000]
    assert rollouts.outcome.tolist() == [Outcome.FELL, Outcome.FELL]


def test_the_arbiter_is_asked_once_a_tick_and_not_about_the_tail():
    script = Script("." * 20, "X" * 20)
    starts = starts_of([100, 350])
    episodes = Episodes(starts, 0.020, tail=0.01)
    rollout(FakeSimulator(2), episodes, script, FakeController(), FakeController())
    np.testing.assert_array_equal(script.ticks, starts.tick + np.arange(20)[:, None])


class WalksSometimes(FakeSimulator):
    """All feet stay on the ground where ``walks(ticks)`` is False."""

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


@pytest.mark.parametrize(
    ("walks", "outcome"),
    [
        (lambda ticks: ticks < 1600, Outcome.SUCCESS),  # stands in the tail only
        (lambda ticks: ticks >= 1600, Outcome.STALLED),  # walks in the tail only
    ],
)
def test_stepping_is_judged_without_the_tail(walks, outcome):
    simulator = WalksSometimes(1, walks)
    rollouts = rollout(simulator, standing_for(1.6, tail=1.6), ExpertOnly(), FakeController())
    assert rollouts.outcome.tolist() == [outcome]


# --- arguments


def test_another_number_of_initial_states_than_robots_is_an_error():
    with pytest.raises(ValueError, match="3 initial states for a simulator of 2 robots; give it 3"):
        rollout(FakeSimulator(2), standing_for(0.1, batch=3), ExpertOnly(), FakeController())


def test_an_arbiter_that_asks_for_a_policy_needs_one():
    with pytest.raises(ValueError, match="asks for a policy, but none was given"):
        rollout(FakeSimulator(1), standing_for(0.1), PolicyOnly(), FakeController())


@pytest.mark.parametrize("mistake", NOT_FLAGS)
def test_answers_of_an_arbiter_that_are_no_flags_are_refused(mistake):
    with pytest.raises(
        ValueError, match=r"CarelessArbiter answered with .*: give a NumPy array .3,."
    ):
        rollout(
            FakeSimulator(3),
            standing_for(0.003, batch=3),
            CarelessArbiter(mistake),
            FakeController(1.0),
            FakeController(-1.0),
        )


def test_whole_numbers_are_no_flags_of_a_simulator_or_an_expert():
    class Worn(FakeSimulator):
        @property
        def blown_up(self):
            return super().blown_up.astype(int)

    class Dragging(FakeSimulator):
        @property
        def body_contact(self):
            return super().body_contact.astype(int)

    class Resigning(FakeController):
        @property
        def diverged(self):
            return super().diverged.astype(int)

    episodes = standing_for(0.003, batch=3)
    for simulator in (Worn, Dragging):
        with pytest.raises(
            ValueError, match=f"{simulator.__name__} answered with an array .3,. of"
        ):
            rollout(simulator(3), episodes, ExpertOnly(), FakeController())
    with pytest.raises(ValueError, match=r"Resigning answered with an array .3,. of int64: give"):
        rollout(FakeSimulator(3), episodes, ExpertOnly(), Resigning())


@pytest.mark.parametrize(("duration", "tail"), [(0.4, 0.1), (0.43, 0.129), (0.05, 0.0)])
def test_progress_counts_all_ticks(duration, tail):
    done = []
    episodes = standing_for(duration, tail=tail)
    rollout(FakeSimulator(1), episodes, ExpertOnly(), FakeController(), progress=done.append)
    assert sum(done) == round(1000 * (duration + tail))
    assert all(done)


def test_a_push_acts_on_its_robot_at_its_time_in_its_heading():
    simulator = FakeSimulator(3, heights={2: [(4, 0.05)]})
    starts = starts_of([0, 0, 0])
    starts.q[1, 3:7] = [0.0, 0.0, np.sin(np.pi / 4), np.cos(np.pi / 4)]  # heads along y
    impulse = np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.2], [3.0, 0.0, 0.0]])
    pushes = Disturbance(Pushes(impulse[:, None], np.full((3, 1), 3), 5))
    episodes = Episodes(starts, 0.02, disturbance=pushes)
    safety = SafetyConfig(grace=0.0)
    rollout(simulator, episodes, ExpertOnly(), FakeController(), safety=safety)
    assert [int(tick) for tick, _, _ in simulator.pushes] == [3, 4, 5, 6, 7]
    for tick, applied, mask in simulator.pushes:
        # The first robot is not pushed, nor is the third once it has fallen.
        assert mask.tolist() == [False, True, tick < 4]
        np.testing.assert_allclose(applied[1], np.array([-0.5, 1.0, 0.2]) / 5, atol=1e-15)


# --- something other than a foot on the ground


def touched_for(touches, body_contact=0.0, grace=0.01):
    """The rollout of standing robots whose bodies are on the ground in these ticks."""
    simulator = FakeSimulator(len(touches), touches=dict(enumerate(touches)))
    safety = SafetyConfig(body_contact=body_contact, grace=grace)
    episodes = standing_for(0.3, batch=len(touches))
    return rollout(simulator, episodes, ExpertOnly(), FakeController(), safety=safety)


def test_body_contact_is_recorded_tick_by_tick_and_is_no_fall_by_default():
    rollouts = touched_for([[(0, 3), (100, 300)], [], [(299, 400)]])
    assert rollouts.body_contact.sum(axis=1).tolist() == [203, 0, 1]
    assert rollouts.body_contact[0].nonzero()[0].tolist() == [0, 1, 2, *range(100, 300)]
    assert not (rollouts.outcome == Outcome.FELL).any()
    assert SafetyConfig().body_contact == 0.0


def test_a_body_that_stays_on_the_ground_has_fallen_where_the_option_says_so():
    touches = [
        [(50, 149)],  # a tick less than 0.1 s
        [(50, 151)],
        [(50, 149), (150, 249)],  # it gets up in between
        [(0, 300)],
    ]
    rollouts = touched_for(touches, body_contact=0.1)
    fell = rollouts.outcome == Outcome.FELL
    assert fell.tolist() == [False, True, False, True]
    assert rollouts.length[fell].tolist() == [149, 99]
    # Falls are tested from the grace on, contact counts from the beginning.
    rollouts = touched_for([[(0, 300)], [(0, 150)]], body_contact=0.1, grace=0.2)
    assert rollouts.length.tolist() == [200, 300]


@pytest.mark.parametrize("body_contact", [0.0001, 0.0005, 0.001])
def test_the_first_tick_of_contact_is_a_fall_where_bounds_allow_no_more(body_contact):
    rollouts = touched_for([[(50, 51)], []], body_contact=body_contact)
    assert rollouts.length.tolist() == [50, 300]
    assert (rollouts.outcome == Outcome.FELL).tolist() == [True, False]


# --- what does not fit


def test_a_policy_of_another_robot_is_refused():
    class Foreign(FakeController):
        robot = "go2"

    class Own(FakeController):
        robot = ROBOT.name

    class Any(FakeController):
        robot = ROBOT  # not a name: it says nothing

    for fits in (Own(), Any()):
        rollout(FakeSimulator(1), standing_for(0.002), PolicyOnly(), FakeController(), fits)
    with pytest.raises(ValueError, match="policy of the robot 'go2' for a simulator of 'solo12'"):
        rollout(FakeSimulator(1), standing_for(0.002), PolicyOnly(), FakeController(), Foreign())
