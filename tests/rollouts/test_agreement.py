"""Parts of a rollout that do not belong together are refused before its first tick."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import SafetyConfig
from surefoot.config.gait_table import GAITS
from surefoot.config.sim import parse_terrains
from surefoot.rollouts.agreement import check_agreement
from surefoot.rollouts.arbiters import ExpertOnly, RandomMix
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.rollouts.outcome import Outcome
from surefoot.scenarios.gait_switches import GaitSwitches
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from surefoot.sim.terrain import Ground
from tests.fakes.drivers import FakeController, starts_of
from tests.fakes.robots import ROBOT
from tests.fakes.simulator import FakeSimulator, OnTheGround

STARTS = load_starts()["nominal"][:2]


class OfGaits(FakeController):
    """A controller that knows which gaits it walks."""

    def __init__(self, *names: str) -> None:
        super().__init__()
        self.gait = 0
        self.gaits = tuple(GAITS[name] for name in names)


class Answering(FakeController):
    """A controller that answers whatever it was made with."""

    def __init__(self, answer) -> None:
        super().__init__()
        self.answer = answer

    def torque(self, state, tick, command, mask):
        return self.answer


def ground_at(height: float) -> Ground:
    return Ground(parse_terrains("slope:5,slope:5"), np.tile([0, 0, height], (2, 1)), np.zeros(2))


def agree(simulated: Ground | None, judged: Ground | None) -> None:
    episodes = Episodes(STARTS, 0.01, ground=judged)
    simulator = make_simulator(ROBOT, 2, None, simulated)
    check_agreement(simulator, episodes, FakeController(), None)


def test_ground_is_that_of_the_simulator_and_of_the_episodes():
    agree(None, None)
    agree(ground_at(-0.2), ground_at(-0.2))
    with pytest.raises(ValueError, match=r"the episodes have none.*Episodes\(\.\.\., ground="):
        agree(ground_at(-0.2), None)
    with pytest.raises(ValueError, match=r"the simulator has none.*make_simulator"):
        agree(None, ground_at(-0.2))
    with pytest.raises(ValueError, match="not that of the episodes"):
        agree(ground_at(-0.2), ground_at(-0.3))


def test_ground_that_a_robot_begins_inside_is_refused():
    with pytest.raises(ValueError, match=r"episode 0: .* deep in the ground"):
        agree(ground_at(0.1), ground_at(0.1))


def test_a_gait_that_the_expert_does_not_know_is_refused():
    starts = starts_of([0, 0], [[0.1, 0, 0], [0.1, 0, 0]])
    episodes = Episodes(replace(starts, gait=np.array([0, 1])), 0.01)
    with pytest.raises(ValueError, match="gait number 1, but the expert knows 1"):
        rollout(FakeSimulator(2), episodes, ExpertOnly(), OfGaits("trot"))
    rollout(FakeSimulator(2), episodes, ExpertOnly(), OfGaits("trot", "walk"))
    switching = Episodes(
        starts, 0.01, switches=GaitSwitches(np.array([[5], [6]]), np.array([[0], [3]]))
    )
    with pytest.raises(ValueError, match="gait number 3, but the expert knows 2"):
        rollout(FakeSimulator(2), switching, ExpertOnly(), OfGaits("trot", "walk"))


def test_stepping_is_judged_by_the_gait_of_the_expert_whatever_the_bounds():
    """A walk of 0.8 s has not shown its steps after 1.6 s, in which a trot has."""
    starts = starts_of([0], [[0.1, 0, 0]])
    slow = OfGaits("walk")
    slow.gaits = (replace(GAITS["walk"], period=0.8),)
    for safety in (None, SafetyConfig()):
        outcomes = [
            rollout(OnTheGround(1), Episodes(starts, T), ExpertOnly(), slow, safety=safety).outcome
            for T in (1.7, 3.0)
        ]
        assert np.concatenate(outcomes).tolist() == [Outcome.SUCCESS, Outcome.STALLED]


@pytest.mark.parametrize("ask_always", [False, True])
@pytest.mark.parametrize("shape", [(12,), (2, 1), (1, 12), (2,)])
def test_torques_of_an_expert_are_not_broadcast(shape, ask_always):
    episodes = Episodes(starts_of([0, 0], [[0.1, 0, 0], [0.1, 0, 0]]), 0.01)
    expert = Answering(np.zeros(shape))
    with pytest.raises(ValueError, match=r"the expert gave torques .* give \(2, 12\)"):
        rollout(FakeSimulator(2), episodes, ExpertOnly(), expert, ask_always=ask_always)


def test_torques_may_be_nested_lists():
    episodes = Episodes(starts_of([0], [[0.1, 0, 0]]), 0.01)
    listed = Answering([[0.5] * 12])
    given = rollout(FakeSimulator(1), episodes, ExpertOnly(), listed)  # pyright: ignore
    assert (given.torque == 0.5).all()


def test_whole_numbers_may_be_lists_and_of_any_type():
    starts = starts_of([250, 250], [[0.1, 0, 0], [0.2, 0, 0]])
    expected = rollout(
        FakeSimulator(2),
        Episodes(starts, 0.01, id=np.array([3, 4])),
        RandomMix(0.5, 2, 0),
        FakeController(1.0),
        FakeController(-1.0),
    )
    for kind in (np.uint8, np.uint64, np.int16):
        small = replace(starts, tick=starts.tick.astype(kind), gait=[0, 0])  # pyright: ignore
        given = rollout(
            FakeSimulator(2),
            Episodes(small, 0.01, id=[3, 4]),  # pyright: ignore
            RandomMix(0.5, 2, 0),
            FakeController(1.0),
            FakeController(-1.0),
        )
        np.testing.assert_array_equal(given.torque, expected.torque)
        np.testing.assert_array_equal(given.expert_drove, expected.expert_drove)


def test_ids_are_whole_numbers_from_zero_on():
    starts = starts_of([0, 0], [[0.1, 0, 0], [0.2, 0, 0]])
    assert Episodes(starts, 0.01, id=range(2))[np.array([1])].ids.tolist() == [1]  # pyright: ignore
    for wrong in (np.array([-1, 0]), np.array([0, 2**63], np.uint64)):
        with pytest.raises(ValueError, match="use 0 to 9223372036854775807, or leave them out"):
            Episodes(starts, 0.01, id=wrong)  # pyright: ignore


def test_attributes_of_ones_own_may_mean_something_else():
    simulator = FakeSimulator(2)
    simulator.ground = "plane.urdf"  # pyright: ignore
    expert = FakeController()
    expert.gaits = None  # pyright: ignore
    episodes = Episodes(STARTS, 0.01)
    rollout(simulator, episodes, ExpertOnly(), expert)
    above = replace(episodes, ground=ground_at(-0.2))
    rollout(simulator, above, ExpertOnly(), expert)
