"""Episodes check themselves, and the frames of a rollout hold what happened."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import DisturbanceConfig, StateNoiseConfig
from surefoot.rollouts.arbiters import ExpertOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, join_episodes
from surefoot.scenarios.disturbance import Disturbance, Pushes, draw_disturbances
from tests.fakes.drivers import FakeController, Script, standing_for, starts_of
from tests.fakes.simulator import FakeSimulator


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"duration": 0.0}, "use at least 0.001 s"),
        ({"duration": -1.0}, "use at least 0.001 s"),
        ({"duration": np.nan}, "use at least 0.001 s"),
        ({"duration": np.inf}, "use at least 0.001 s"),
        ({"tail": -0.1}, "a tail of 0 s or more"),
        ({"tail": np.nan}, "a tail of 0 s or more"),
        ({"starts": starts_of([0], [[np.nan, 0, 0]])}, r"command\[0, 0\] is nan; use finite num"),
        ({"starts": starts_of([0], [[0.1, 0]])}, r"command is float64 \(1, 2\), expected \(1, 3\)"),
        ({"id": np.arange(2)}, r"ids \(2,\) for 1 initial states; give one for each"),
        ({"id": np.array([0.5])}, "ids are whole numbers, not float64"),
    ],
)
def test_episodes_that_cannot_be_simulated_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        Episodes(**{"starts": starts_of([0]), "duration": 0.1, **arguments})


@pytest.mark.parametrize(
    "disturbance",
    [
        Disturbance(Pushes(np.ones((3, 1, 3)), np.zeros((3, 1), int), 10)),
        Disturbance(friction=np.ones(3)),
        Disturbance(mass=np.ones(3)),
        Disturbance(measured=np.zeros(3, int)),
    ],
)
def test_there_are_as_many_disturbed_robots_as_episodes(disturbance):
    with pytest.raises(ValueError, match="a disturbance of 3 robots, but there are 1"):
        Episodes(starts_of([0]), 0.1, disturbance=disturbance)


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("q", lambda q: 0.0 * q, r"quaternion of row 0 is \[0.0, 0.0, 0.0, 0.0\] of length 0; div"),
        ("q", lambda q: q * (1.0 + 2e-6), r"quaternion of row 0 is .* of length 1.000002; divide"),
        ("q", lambda q: q + 0j, r"q is complex128 \(2, 19\), expected \(2, 19\) real numbers"),
        ("q", lambda q: q[:, :18], r"q is float64 \(2, 18\), expected \(2, 19\)"),
        ("q", lambda q: np.where(np.arange(19) == 8, np.nan, q), r"q\[0, 8\] is nan; use finite"),
        ("v", lambda v: v - np.inf, r"v\[0, 0\] is -inf; use finite numbers"),
        ("v", lambda v: v[:1], r"v is float64 \(1, 18\), expected \(2, 18\)"),
        ("tick", lambda tick: tick + 0.5, r"tick is float64 \(2,\), expected \(2,\) whole"),
    ],
)
def test_robots_begin_in_states_that_exist(name, change, message):
    starts = starts_of([0, 0])
    with pytest.raises(ValueError, match=message):
        Episodes(replace(starts, **{name: change(getattr(starts, name))}), 0.1)


def test_rounding_of_a_quaternion_is_no_fault():
    starts = starts_of([0])
    for length in (1.0 - 1e-7, 1.0 + 1e-7):
        q = starts.q.copy()
        q[:, 3:7] *= length
        assert len(Episodes(replace(starts, q=q), 0.1)) == 1


def test_some_of_the_episodes_keep_their_ids_and_what_disturbs_them():
    seeds = tuple(np.random.SeedSequence(number) for number in range(4))
    disturbance = Disturbance(
        Pushes(np.arange(12.0).reshape(4, 1, 3), np.arange(4)[:, None], 10),
        friction=np.array([0.5, 1.5, 2.5, 3.5]),
        mass=np.array([1.5, 2.5, 3.5, 4.5]),
        delay=3,
        seeds=seeds,
    )
    whole = Episodes(starts_of([0, 10, 20, 30]), 0.3, 0.2, disturbance=disturbance)
    for rows in (slice(1, 3), np.array([1, 2]), np.array([False, True, True, False])):
        part = whole[rows]
        assert len(part) == 2
        assert part.ids.tolist() == [1, 2]
        assert part.starts.tick.tolist() == [10, 20]
        assert (part.duration, part.tail) == (0.3, 0.2)
        assert part.disturbance is not None and part.disturbance.pushes is not None
        assert part.disturbance.pushes.tick.tolist() == [[1], [2]]
        assert part.disturbance.seeds == seeds[1:3]
        np.testing.assert_array_equal(part.disturbance.friction, [1.5, 2.5])
        np.testing.assert_array_equal(part.disturbance.mass, [2.5, 3.5])
        assert part.disturbance.delay == 3


# --- frames


def test_frames_come_episode_by_episode_in_time_and_hold_what_happened():
    simulator = FakeSimulator(3, heights={1: [(510, 0.05)]})
    rng = np.random.default_rng(0)
    script = Script(*("".join(rng.choice(["X", "."], 600)) for _ in range(3)))
    starts = starts_of([50, 400, 0], [[0.1, 0, 0], [0.2, 0, 0], [0.3, 0, 0]])
    episodes = Episodes(starts, 0.6)
    rollouts = rollout(simulator, episodes, script, FakeController(1.0), FakeController(-1.0))
    keep = (rng.random((3, 600)) < 0.3) & rollouts.expert_drove
    keep[1, 510:] = True
    episode = np.array([12, 5, 900])
    frames = rollouts.frames(keep, episode)

    expected = [
        (b, t) for b in range(3) for t in range(600) if keep[b, t] and t < rollouts.length[b]
    ]
    assert len(frames) == len(expected)
    assert (keep[1, 510:]).any()  # to be kept, but these ticks did not happen
    for row, (b, t) in enumerate(expected):
        for name in ("q", "v", "com", "feet", "contacts", "torque", "expert_drove"):
            np.testing.assert_array_equal(getattr(frames, name)[row], getattr(rollouts, name)[b, t])
        assert frames.tick[row] == starts.tick[b] + t
        np.testing.assert_array_equal(frames.command[row], starts.command[b])
        assert frames.episode[row] == episode[b]
        assert frames.outcome[row] == rollouts.outcome[b]


def test_frames_that_the_expert_was_not_asked_about_are_refused():
    script = Script("XX..XX")
    episodes = standing_for(0.006)
    rollouts = rollout(FakeSimulator(1), episodes, script, FakeController(), FakeController(1.0))
    with pytest.raises(ValueError, match="the expert was not asked"):
        rollouts.frames(np.ones((1, 6), bool), np.array([0]))
    assert len(rollouts.frames(rollouts.expert_drove, np.array([0]))) == 4


def test_frames_of_two_episodes_with_one_id_are_refused():
    rollouts = rollout(
        FakeSimulator(3), standing_for(0.01, batch=3), ExpertOnly(), FakeController()
    )
    keep = rollouts.expert_drove
    with pytest.raises(ValueError, match="2 episodes have the id 7; give each an id of its own"):
        rollouts.frames(keep, np.array([7, 1, 7]))
    with pytest.raises(ValueError, match=r"episode \(2,\), expected \(3, 10\) and \(3,\)"):
        rollouts.frames(keep, np.array([7, 1]))


def test_a_rule_that_keeps_nothing_gives_no_frames():
    rollouts = rollout(FakeSimulator(1), standing_for(0.01), ExpertOnly(), FakeController())
    assert len(rollouts.frames(np.zeros((1, 10), bool), np.array([0]))) == 0
    assert len(rollouts.frames(np.ones((1, 10), bool), np.array([0]))) == 10


# --- branches


def disturbed(n):
    """Pushes, noise, late torques, and a friction and a mass for each of n robots."""
    config = DisturbanceConfig(
        pushes=2,
        friction=(0.5, 1.5),
        mass=(0.8, 1.2),
        noise=StateNoiseConfig(joint_position=0.05, joint_velocity=0.1),
        delay=8,
    )
    return draw_disturbances(config, 3, np.arange(n), 0.6, 0.5)


def drive(episodes):
    """The rollout of a controller that answers to what it measures."""
    return rollout(FakeSimulator(len(episodes)), episodes, ExpertOnly(), FakeController(1.0))


def assert_goes_on(branch, whole, robot, elapsed):
    """The branch holds what the whole rollout holds from those ticks on, to the bit."""
    for row, (b, tick) in enumerate(zip(robot, elapsed, strict=True)):
        ticks = branch.q.shape[1]
        for name in ("q", "v", "torque"):
            expected = getattr(whole, name)[b, tick : tick + ticks]
            np.testing.assert_array_equal(getattr(branch, name)[row], expected, name)
        np.testing.assert_array_equal(branch.seen.q[row], whole.seen.q[b, tick : tick + ticks])


def test_a_branch_goes_on_to_the_bit_with_its_friction_mass_noise_pushes_and_late_torques():
    whole = drive(Episodes(starts_of([50, 400, 0]), 0.7, disturbance=disturbed(3)))
    assert not np.array_equal(whole.q, whole.seen.q)
    robot = np.array([2, 0, 0, 1, 2])
    elapsed = np.array([505, 3, 500, 250, 0])
    episodes = whole.branch(robot, elapsed, 0.15, np.arange(5) + 90)
    assert episodes.ids.tolist() == [90, 91, 92, 93, 94]
    assert episodes.starts.tick.tolist() == [505, 53, 550, 650, 0]
    assert episodes.starts.id.tolist() == [72, 70, 70, 71, 72]
    assert whole.disturbance.friction is not None and episodes.disturbance is not None
    np.testing.assert_array_equal(episodes.disturbance.friction, whole.disturbance.friction[robot])
    branch = drive(episodes)
    assert_goes_on(branch, whole, robot, elapsed)
    # And so does a branch of a branch, and a part of one.
    again = drive(branch.branch(np.array([0, 4]), np.array([5, 0]), 0.1, np.arange(2)))
    assert_goes_on(again, whole, [2, 2], [510, 0])
    part = drive(episodes[np.array([3, 1])])
    assert_goes_on(part, whole, [1, 0], [250, 3])
    joined = drive(join_episodes([episodes[:2], episodes[2:]]))
    assert_goes_on(joined, whole, robot, elapsed)


def test_a_branch_within_a_push_feels_the_rest_of_it():
    pushes = Pushes(np.array([[[0.0, 3.0, 0.0]]]), np.array([[20]]), 10)
    whole = drive(Episodes(starts_of([0]), 0.1, disturbance=Disturbance(pushes)))
    branch = drive(whole.branch(np.array([0]), np.array([25]), 0.05, np.array([0])))
    assert_goes_on(branch, whole, [0], [25])


def test_an_undisturbed_branch_has_nothing_late():
    whole = drive(Episodes(starts_of([0]), 0.05))
    episodes = whole.branch(np.array([0]), np.array([20]), 0.03, np.array([0]))
    assert episodes.late is None
    assert_goes_on(drive(episodes), whole, [0], [20])


def test_a_robot_does_not_go_on_after_its_episode():
    heights = {1: [(510, 0.05)]}
    simulator = FakeSimulator(2, heights)
    whole = rollout(simulator, standing_for(0.6, batch=2), ExpertOnly(), FakeController())
    with pytest.raises(ValueError, match=r"robot 1 cannot go on from tick 510.*lasted 510 ticks"):
        whole.branch(np.array([0, 1]), np.array([510, 510]), 0.1, np.arange(2))


def test_late_torques_fit_the_robots_and_the_delay():
    late = np.zeros((1, 3, 12))
    message = r"late torques \(1, 3, 12\) for 1 robots and a delay of 2 ms; give \(1, 2, 12\)"
    with pytest.raises(ValueError, match=message):
        Episodes(starts_of([0]), 0.1, disturbance=Disturbance(delay=2), late=late)


def test_only_episodes_of_one_kind_are_joined():
    plain = Episodes(starts_of([0]), 0.1)
    with pytest.raises(ValueError, match="1 of 2 parts are disturbed"):
        join_episodes([plain, replace(plain, disturbance=Disturbance())])
    late = replace(plain, disturbance=Disturbance(delay=1), late=np.zeros((1, 1, 12)))
    with pytest.raises(ValueError, match="1 of 2 parts have late torques; give all"):
        join_episodes([late, replace(late, late=None)])
