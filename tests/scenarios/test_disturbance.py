"""Disturbances: drawn by episode id, measured with the noise asked for, judged by the truth."""

from dataclasses import astuple, replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.stats import kstest

from surefoot.config import Config, DisturbanceConfig, SafetyConfig, StateNoiseConfig
from surefoot.learning.policy import pd
from surefoot.learning.samples import derive
from surefoot.robots.load import load_robot
from surefoot.rollouts.arbiters import ExpertOnly, PolicyOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.disturbance import Disturbance, Pushes, draw_disturbances, warn_of_pushes
from surefoot.scenarios.sensors import make_sensors
from surefoot.scenarios.starts import Starts
from surefoot.sim import make_simulator
from surefoot.types import State
from tests.fakes.drivers import FakeController
from tests.fakes.learning import SMALL, spec_of
from tests.fakes.plans import MODEL, state_of
from tests.fakes.robots import ROBOT, STANDING, random_states
from tests.fakes.simulator import FakeSimulator

NOISE = StateNoiseConfig(0.01, 0.05, 0.1, 0.2, 0.03, 0.4)
ALL = DisturbanceConfig(
    pushes=3,
    impulse=(0.5, 2.0),
    push_duration=0.02,
    friction=(0.4, 1.2),
    mass=(0.8, 1.5),
    noise=NOISE,
    delay=3,
)
IDS = np.arange(1000)


def drawn(config=ALL, seed=0, episode=IDS, duration=5.0) -> Disturbance:
    return draw_disturbances(config, seed, episode, duration, friction=0.5)


def pushes_of(disturbance: Disturbance) -> Pushes:
    assert disturbance.pushes is not None
    return disturbance.pushes


def seeds(disturbance):
    return [seed.generate_state(4).tolist() for seed in disturbance.seeds]


# --- what is drawn


def test_what_is_drawn_depends_on_seed_and_id_alone():
    everything = drawn()
    ids = np.array([700, 3, 41])
    few = drawn(episode=ids)
    np.testing.assert_array_equal(pushes_of(few).impulse, pushes_of(everything).impulse[ids])
    np.testing.assert_array_equal(pushes_of(few).tick, pushes_of(everything).tick[ids])
    for name in ("friction", "mass"):
        np.testing.assert_array_equal(getattr(few, name), getattr(everything, name)[ids])
    assert seeds(few) == [seeds(everything)[id_] for id_ in ids]

    other = drawn(seed=1, episode=ids)
    assert not np.isin(pushes_of(other).impulse[..., :2], pushes_of(few).impulse).any()
    assert other.friction is not None
    assert not np.isin(other.friction, np.array(few.friction)).any()
    assert all(seed not in seeds(few) for seed in seeds(other))


def test_no_two_episodes_are_disturbed_alike():
    disturbance = drawn()
    assert len(np.unique(pushes_of(disturbance).impulse[..., 0])) == 3 * len(IDS)
    for part in (disturbance.friction, disturbance.mass):
        assert len(np.unique(np.array(part))) == len(IDS)
    assert len({tuple(seed) for seed in seeds(disturbance)}) == len(IDS)


def test_pushes_do_not_change_friction_and_mass():
    with_pushes = drawn()
    without = drawn(replace(ALL, pushes=0))
    assert without.pushes is None
    np.testing.assert_array_equal(with_pushes.friction, without.friction)
    np.testing.assert_array_equal(with_pushes.mass, without.mass)


def test_one_more_push_comes_early_in_the_tail_if_there_is_one():
    config = replace(ALL, pushes=1, expert_impulse=(0.1, 0.2))
    pushes = pushes_of(draw_disturbances(config, 0, IDS, 5.0, 0.5, tail=1.0))
    assert pushes.impulse.shape == (1000, 2, 3)
    size = np.hypot(*np.moveaxis(pushes.impulse[..., :2], -1, 0))
    assert 0.5 <= size[:, 0].min() <= size[:, 0].max() <= 2.0
    assert 0.1 <= size[:, 1].min() <= size[:, 1].max() <= 0.2
    assert pushes.tick[:, 0].max() < 5000
    assert (pushes.tick[:, 1].min(), pushes.tick[:, 1].max()) == (5000, 5199)
    short = pushes_of(draw_disturbances(config, 0, IDS, 5.0, 0.5, tail=0.01))
    assert short.tick[:, 1].max() < 5010
    assert pushes_of(draw_disturbances(config, 0, IDS, 5.0, 0.5)).impulse.shape == (1000, 1, 3)
    none = pushes_of(draw_disturbances(config, 0, IDS, 5.0, 0.5, tail=0.0004))
    assert none.impulse.shape == (1000, 1, 3)  # such a tail has no tick
    alone = pushes_of(draw_disturbances(replace(config, pushes=0), 0, IDS, 5.0, 0.5, tail=1.0))
    assert alone.tick.min() == 5000


def test_draws_fill_their_ranges_evenly():
    disturbance = drawn()
    pushes = pushes_of(disturbance)
    x, y, z = np.moveaxis(pushes.impulse, -1, 0)
    assert (z == 0.0).all()
    assert (pushes.duration, disturbance.delay, disturbance.noise) == (20, 3, NOISE)
    assert pushes.tick.min() >= 0
    assert pushes.tick.max() < 5000
    uniform = {
        "size": (np.hypot(x, y) - 0.5) / 1.5,
        "direction": np.arctan2(y, x) / (2 * np.pi) + 0.5,
        "time": (pushes.tick + 0.5) / 5000,
        "friction": (np.array(disturbance.friction) - 0.2) / 0.4,  # of 0.5, times 0.4 to 1.2
        "mass": (np.array(disturbance.mass) - 0.8) / 0.7,
    }
    for name, values in uniform.items():
        assert values.min() >= 0.0, name
        assert values.max() <= 1.0, name
        # False alarms of one in a thousand draws; the seed is fixed.
        assert kstest(values.ravel(), "uniform").pvalue > 1e-3, name
    # Nothing is correlated: neither size and direction, nor one push and the next.
    columns = [uniform["size"], uniform["direction"], uniform["time"]]
    table = np.concatenate(columns, axis=1)
    correlation = np.corrcoef(table.T) - np.eye(table.shape[1])
    assert np.abs(correlation).max() < 4.5 / np.sqrt(len(IDS))


def test_a_push_acts_evenly_for_its_duration():
    pushes = Pushes(np.array([[[1.0, 0, 0], [0, 2.0, 0]], [[0, 0, 0], [4.0, 0, 0]]]),
                    np.array([[3, 5], [0, 9]]), 4)  # fmt: skip
    acting = [pushes.during(elapsed) for elapsed in range(15)]
    none = np.zeros((2, 3))
    total = np.sum([none if impulse is None else impulse for impulse in acting], axis=0)
    np.testing.assert_array_equal(total, [[1.0, 2.0, 0.0], [4.0, 0.0, 0.0]])
    assert acting[13] is None
    np.testing.assert_array_equal(acting[5], [[0.25, 0.5, 0.0], [0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(acting[12], [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])


@pytest.mark.parametrize(
    ("impulse", "tick", "duration", "message"),
    [
        (np.zeros((2, 3)), np.zeros(2, int), 1, "must be"),
        (np.zeros((2, 1, 3)), np.zeros((2, 2), int), 1, "must be"),
        (np.zeros((1, 1, 3)), np.zeros((2, 1), int), 1, "must be"),
        (np.full((1, 1, 3), np.inf), np.zeros((1, 1), int), 1, "not finite"),
        (np.full((2, 1, 3), np.nan), np.zeros((2, 1), int), 1, "not finite"),
        (np.ones((1, 1, 3)), np.zeros((1, 1), int), 0, "duration of 0 ms; use whole numbers from"),
        (np.ones((1, 1, 3)), np.zeros((1, 1), int), 60_001, "from 1 to 60000"),
        (np.ones((1, 1, 3)), np.zeros((1, 1), int), 10.0, "duration of 10.0 ms"),
        (np.ones((1, 1, 3)), np.zeros((1, 1), int), float("nan"), "duration of nan ms"),
        (np.ones((1, 1, 3)), np.zeros((1, 1)), 1, "ticks of type float64; use whole numbers"),
        (np.ones((1, 1, 3)), np.full((1, 1), np.nan), 1, "ticks of type float64"),
    ],
)
def test_pushes_of_other_shapes_or_without_a_duration_are_refused(impulse, tick, duration, message):
    with pytest.raises(ValueError, match=message):
        Pushes(impulse, tick, duration)


TWO_SEEDS = tuple(np.random.SeedSequence(number) for number in range(2))
ONE_PUSH = Pushes(np.ones((1, 1, 3)), np.zeros((1, 1), int), 10)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"friction": np.array([0.5, np.nan])}, "friction of robot 1 is nan; use a finite number"),
        ({"friction": np.array([0.0])}, "friction of robot 0 is 0.0; use a finite number above 0"),
        ({"mass": np.array([1.0, -1.0])}, "mass of robot 1 is -1.0"),
        ({"mass": np.array([np.inf])}, "mass of robot 0 is inf"),
        ({"mass": np.ones((2, 1))}, r"mass has shape \(2, 1\); give one for each robot"),
        ({"friction": 0.5}, r"friction has shape \(\); give one for each robot"),
        ({"friction": np.ones(2), "mass": np.ones(3)}, "friction for 2, mass for 3; give each for"),
        ({"pushes": ONE_PUSH, "friction": np.ones(2)}, "pushes for 1, friction for 2"),
        ({"mass": np.ones(3), "seeds": TWO_SEEDS}, "mass for 3, seeds for 2"),
        ({"mass": np.ones(3), "measured": np.zeros(2, int)}, "mass for 3, measured for 2"),
        ({"measured": np.array([-1])}, "measured must be"),
        ({"measured": np.array([0.5])}, "measured must be"),
        ({"delay": -1}, "delay of -1 ms; use whole numbers from 0 to 1000"),
        ({"delay": 1001}, "delay of 1001 ms"),
        ({"delay": 2.5}, "delay of 2.5 ms"),
        ({"noise": NOISE}, "noise without seeds"),
    ],
)
def test_a_disturbance_that_cannot_be_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        Disturbance(**fields)


def test_a_disturbance_knows_for_how_many_robots_it_is():
    assert type(Disturbance(delay=np.int64(3)).delay) is int  # pyright: ignore
    assert Disturbance().batch is None and Disturbance(delay=3).batch is None
    assert Disturbance(friction=np.ones(4)).batch == 4
    assert Disturbance(pushes=ONE_PUSH).batch == 1
    assert drawn().batch == 1000 and drawn()[5:7].batch == 2
    given = Disturbance(friction=[0.5, 1])  # pyright: ignore[reportArgumentType]
    np.testing.assert_array_equal(given[1:].friction, [1.0])


# --- what is measured


def batch(q, v) -> State:
    rows = [state_of(*pair) for pair in zip(q, v, strict=True)]
    return State(*(np.array([astuple(row)[i] for row in rows]) for i in range(5)))


def measured(state: State, noise=NOISE, episode=None, calls=1) -> list[State]:
    episode = np.arange(len(state.q)) if episode is None else episode
    config = DisturbanceConfig(noise=noise)
    measure = make_sensors(ROBOT, draw_disturbances(config, 7, episode, 1.0, 0.5))
    assert measure is not None
    return [measure(state) for _ in range(calls)]


def test_noise_has_the_deviations_asked_for_and_is_white():
    truth = batch(*random_states(4, seed=3))  # tilted every way
    states = measured(truth, calls=2500)  # several blocks of draws
    orientation = [
        [pin.log3(R.T @ M) for R, M in zip(truth.rotation, state.rotation, strict=True)]
        for state in states[::5]
    ]
    q, v = (np.array([getattr(state, name) for state in states]) for name in ("q", "v"))
    np.testing.assert_allclose(np.linalg.norm(q[..., 3:7], axis=-1), 1.0, atol=1e-12)
    assert (q[..., :2] == truth.q[:, :2]).all()
    errors = {
        "base_height": q[..., 2:3] - truth.q[:, 2:3],
        "base_orientation": np.array(orientation),
        "base_linear_velocity": (v - truth.v)[..., :3],
        "base_angular_velocity": (v - truth.v)[..., 3:6],
        "joint_position": (q - truth.q)[..., 7:],
        "joint_velocity": (v - truth.v)[..., 6:],
    }
    for name, error in errors.items():
        sigma = getattr(NOISE, name)
        n = error.shape[0]
        # For each robot and each axis, within five standard errors.
        np.testing.assert_allclose(error.std(axis=0), sigma, rtol=5 / np.sqrt(2 * n), err_msg=name)
        assert np.abs(error.mean(axis=0)).max() < 5 * sigma / np.sqrt(n), name
        table = error.reshape(n, -1) / sigma
        across = np.corrcoef(table.T) - np.eye(table.shape[1]) if table.shape[1] > 1 else 0.0
        after = (table[1:] * table[:-1]).mean(axis=0)
        assert max(np.abs(across).max(), np.abs(after).max()) < 5 / np.sqrt(n), name


def test_feet_and_center_of_mass_are_those_of_the_measured_configuration():
    truth = batch(*random_states(5))
    (seen,) = measured(truth)
    data = MODEL.createData()
    for row in range(5):
        pin.framesForwardKinematics(MODEL, data, seen.q[row])
        feet = [data.oMf[foot].translation for foot in ROBOT.feet]
        np.testing.assert_allclose(seen.feet[row], feet, atol=1e-12)
        com = pin.centerOfMass(MODEL, data, seen.q[row])
        np.testing.assert_allclose(seen.com[row], com, atol=1e-12)
    assert np.abs(seen.feet - truth.feet).max() > 1e-3
    assert (seen.contacts == truth.contacts).all()


def test_one_kind_of_noise_leaves_all_else_alone():
    truth = batch(*random_states(3))
    (seen,) = measured(truth, StateNoiseConfig(joint_velocity=0.1))
    np.testing.assert_allclose(seen.q, truth.q, atol=1e-15)
    np.testing.assert_array_equal(seen.v[:, :6], truth.v[:, :6])
    assert (seen.v[:, 6:] != truth.v[:, 6:]).all()
    (seen,) = measured(truth, StateNoiseConfig(base_height=0.1))
    np.testing.assert_allclose(np.delete(seen.q, 2, axis=1), np.delete(truth.q, 2, axis=1))
    assert (seen.q[:, 2] != truth.q[:, 2]).all()


def test_noise_of_a_robot_does_not_depend_on_its_neighbors():
    truth = batch(*random_states(3))
    together = measured(truth, episode=np.array([5, 90, 2]), calls=3)
    alone = measured(truth[1:2], episode=np.array([90]), calls=3)
    for several, one in zip(together, alone, strict=True):
        np.testing.assert_array_equal(several.q[1:2], one.q)
        np.testing.assert_array_equal(several.v[1:2], one.v)
    assert (together[0].q != together[1].q)[:, 7:].all()


# --- in the engine, on a simulator of a few lines


class Numbered:
    """A controller whose torque is the number of its call; keeps the states it was shown."""

    def __init__(self):
        self.seen = []
        self.diverged = np.zeros(1, bool)

    def reset(self, batch):
        self.diverged = np.zeros(batch, bool)

    def torque(self, state, tick, command, mask):
        self.seen.append(state)
        return np.full((len(mask), 12), 0.01 * len(self.seen))


class Watching(PolicyOnly):
    """The policy drives on even ticks, the expert on odd ones; keeps the states it was shown."""

    def reset(self, episode):
        self.seen = []

    def choose(self, state, tick, command):
        self.seen.append(state)
        return np.full(len(tick), len(self.seen) % 2 == 0)


def starts(n=2):
    q = np.tile(STANDING, (n, 1))
    return Starts(q, np.zeros((n, 18)), np.zeros(n, int), np.zeros((n, 3)), np.arange(n))


def noisy(sigma, n=2):
    return draw_disturbances(
        DisturbanceConfig(noise=StateNoiseConfig(*[sigma] * 6)), 0, np.arange(n), 1.0, 0.5
    )


@pytest.mark.parametrize("privileged", [True, False])
def test_a_policy_sees_what_is_measured_and_a_teacher_and_its_arbiter_the_truth(privileged):
    simulator = FakeSimulator(2)
    expert = Numbered()
    policy = Numbered()
    arbiter = Watching()
    disturbance = replace(noisy(0.02), privileged=privileged)
    episodes = Episodes(starts(), 0.02, disturbance=disturbance)
    rollouts = rollout(simulator, episodes, arbiter, expert, policy)
    assert (rollouts.q != rollouts.seen.q)[..., 7:].all()
    truth = State(rollouts.q, rollouts.v, rollouts.com, rollouts.feet, rollouts.contacts)
    np.testing.assert_array_equal(rollouts.q[:, 0, 7:], starts().q[:, 7:])
    shown = {"arbiter": range(20), "policy": range(0, 20, 2), "expert": range(1, 20, 2)}
    for name, observer in (("arbiter", arbiter), ("policy", policy), ("expert", expert)):
        states = truth if privileged and name != "policy" else rollouts.seen
        for state, elapsed in zip(observer.seen, shown[name], strict=True):
            for field in ("q", "v", "com", "feet", "contacts"):
                expected = getattr(states, field)[:, elapsed]
                np.testing.assert_array_equal(getattr(state, field), expected, err_msg=name)
    frames = rollouts.frames(rollouts.expert_drove, np.arange(2))
    np.testing.assert_array_equal(frames.q, rollouts.seen.q[rollouts.expert_drove])
    np.testing.assert_array_equal(frames.com, rollouts.seen.com[rollouts.expert_drove])


@pytest.mark.parametrize("ask_always", [False, True])
def test_a_label_gives_the_torque_of_the_expert_at_what_the_policy_measures(ask_always):
    """The expert's torque is that of the truth; the target makes up for the noise."""
    episodes = Episodes(starts(), 0.02, disturbance=noisy(0.02))
    expert = FakeController(0.3)
    rollouts = rollout(FakeSimulator(2), episodes, Watching(), expert, Numbered(), None, ask_always)
    robot, tick = np.nonzero(rollouts.expert_asked)
    answer = 0.3 + 0.01 * rollouts.q[robot, tick, 7:] + 1e-3 * (tick % 7)[:, None]
    frames = rollouts.frames(rollouts.expert_asked, np.arange(2))
    assert len(frames) == (40 if ask_always else 20)
    np.testing.assert_allclose(frames.torque, answer, rtol=0, atol=1e-15)
    spec = spec_of(SMALL)
    target = derive(frames, spec)[:, -12:]
    np.testing.assert_allclose(pd(target, frames.q, frames.v, spec), answer, rtol=0, atol=1e-5)


@pytest.mark.parametrize(("height", "sigma"), [(0.25, 0.5), (0.05, 1e-6)])
def test_falls_are_judged_by_the_truth(height, sigma):
    """With such noise a standing robot is measured on its side; a fallen one fell anyway."""
    safety = SafetyConfig(grace=0.01)
    episodes = Episodes(starts(), 0.05, disturbance=noisy(sigma))
    simulator = FakeSimulator(2, {0: [(0, height)], 1: [(0, height)]})
    rollouts = rollout(simulator, episodes, ExpertOnly(), Numbered(), safety=safety)
    fell = height < 0.1
    assert (rollouts.outcome == Outcome.FELL).tolist() == [fell] * 2
    assert rollouts.length.tolist() == [10 if fell else 50] * 2
    if not fell:
        assert (np.abs(rollouts.seen.roll_pitch) > np.radians(safety.fall_angle)).any()


@pytest.mark.parametrize("delay", [0, 1, 7, 1000])
def test_a_late_torque_is_the_one_commanded_so_many_ticks_ago(delay):
    simulator = FakeSimulator(2)
    episodes = Episodes(starts(), 0.02, disturbance=Disturbance(delay=delay))
    rollouts = rollout(simulator, episodes, ExpertOnly(), Numbered())
    commanded = 0.01 * (np.arange(20) + 1)
    late = commanded[np.maximum(np.arange(20) - delay, 0)]
    np.testing.assert_allclose(rollouts.torque[0, :, 0], commanded)  # as commanded, not as applied
    np.testing.assert_allclose(np.array(simulator.applied)[:, 1, 5], late)


def test_friction_and_mass_are_given_before_the_reset():
    simulator = FakeSimulator(2)
    disturbance = Disturbance(friction=np.array([0.3, 0.4]), mass=np.array([1.1, 1.2]))
    episodes = Episodes(starts(), 0.002, disturbance=disturbance)
    rollout(simulator, episodes, ExpertOnly(), Numbered())
    assert simulator.order == ["vary", "reset"]
    assert simulator.varied == [([0.3, 0.4], [1.1, 1.2])]


def test_a_disturbance_of_nothing_disturbs_no_robot():
    nothing = draw_disturbances(DisturbanceConfig(), 0, np.arange(2), 1.0, 0.5)
    assert (nothing.pushes, nothing.friction, nothing.mass, nothing.delay) == (None, None, None, 0)
    assert make_sensors(ROBOT, nothing) is None
    simulator = FakeSimulator(2)
    episodes = Episodes(starts(), 0.01, disturbance=nothing)
    rollouts = rollout(simulator, episodes, ExpertOnly(), Numbered())
    assert simulator.order == ["reset"]
    assert simulator.pushes == []
    assert rollouts.seen.q.base is rollouts.q.base  # the very same numbers


# --- on MuJoCo


class Shaking:
    """PD to the standing pose and a tremor."""

    diverged = np.zeros(3, bool)

    def reset(self, batch):
        """No memory."""

    def torque(self, state, tick, command, mask):
        tremor = 0.3 * np.sin(0.2 * tick[:, None] + np.arange(12))
        return 3.0 * (STANDING[7:] - state.q[:, 7:]) - 0.1 * state.v[:, 6:] + tremor


def shaken(disturbance=None):
    simulator = make_simulator(ROBOT, 3, Config().simulation)
    episodes = Episodes(starts(3), 0.2, disturbance=disturbance)
    rollouts = rollout(simulator, episodes, PolicyOnly(), Shaking(), Shaking())
    return np.concatenate([rollouts.q, rollouts.v], axis=2)


def test_a_disturbance_of_nothing_changes_no_bit_on_mujoco():
    undisturbed = shaken()
    nothing = DisturbanceConfig(impulse=(0.1, 3.0), gentle=0.1, push_duration=0.1)
    for config in (DisturbanceConfig(), nothing):
        same = shaken(draw_disturbances(config, 0, np.arange(3), 0.2, 0.5))
        np.testing.assert_array_equal(same, undisturbed)


@pytest.mark.parametrize(
    "config",
    [
        DisturbanceConfig(pushes=3),
        DisturbanceConfig(friction=(0.3, 0.6)),
        DisturbanceConfig(mass=(1.2, 1.5)),
        DisturbanceConfig(noise=StateNoiseConfig(joint_velocity=0.1)),
        DisturbanceConfig(delay=2),
    ],
    ids=["pushes", "friction", "mass", "noise", "delay"],
)
def test_every_kind_of_disturbance_reaches_every_robot(config):
    undisturbed = shaken()
    disturbed = shaken(draw_disturbances(config, 0, np.arange(3), 0.1, 0.5))
    assert (np.abs(disturbed - undisturbed).max(axis=(1, 2)) > 1e-6).all()
    np.testing.assert_array_equal(disturbed[:, 0], undisturbed[:, 0])


def test_pushes_of_a_solo12_on_a_heavier_robot_are_warned_of(caplog):
    pushed = DisturbanceConfig(pushes=1)
    warn_of_pushes("collection", DisturbanceConfig(), load_robot("go2"))
    warn_of_pushes("collection", pushed, load_robot("solo12"))
    warn_of_pushes("collection", replace(pushed, impulse=None), load_robot("go2"))
    warn_of_pushes("collection", replace(pushed, impulse=(1.0, 2.0)), load_robot("go2"))
    assert not caplog.text
    warn_of_pushes("collection", pushed, load_robot("go2"))
    assert "collection.impulse: pushes of 0.5 to 1.5 N s" in caplog.text
