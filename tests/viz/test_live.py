"""A live simulation: what is told from outside acts from the next tick on."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from surefoot.config.gait_clock import switch_tick
from surefoot.config.gait_table import GAITS
from surefoot.rotations import from_heading
from surefoot.safety.monitor import SafetyMonitor
from surefoot.types import Command
from surefoot.viz.live import LIMP_TICKS, PUSH_TICKS, LiveSimulation
from surefoot.viz.snapshot import PUSH_SHOWN, SAMPLE_TICKS
from tests.fakes.drivers import FakeController
from tests.fakes.simulator import FakeSimulator
from tests.fakes.toy_runs import SAFETY

EXPERT = 0.5
POLICY = -0.5


class Alarm:
    """A gate that is alarmed in one tick."""

    def __init__(self, tick):
        self.tick = tick

    def reset(self, batch):
        """It has no memory."""

    def unsafe(self, state, tick, command):
        return tick == self.tick


def live(alarm=5, gives_up=None, policy=True, safety=SAFETY, **script) -> Any:
    return LiveSimulation(
        FakeSimulator(1, **script),
        safety,
        damping=0.1,
        expert=FakeController(EXPERT, gives_up),
        policy=FakeController(POLICY) if policy else None,
        monitor=SafetyMonitor(Alarm(alarm), 0.003) if policy else None,
    )


def drove(simulation):
    """Who drove each tick, by the sign of the torques that were applied."""
    torques = [torque[0, 0] for torque in simulation._simulator.applied]
    return "".join("X" if torque > 0.0 else "." for torque in torques)


def test_whoever_is_chosen_drives_from_the_next_tick_on():
    simulation = live()
    assert (simulation.driver, simulation.drivers[0]) == ("policy", "policy")
    simulation.step(3)
    simulation.set_driver("expert")
    simulation.step(2)
    assert drove(simulation) == "...XX"
    assert simulation.snapshot().expert_drives


def test_the_guarded_policy_is_driven_for_until_the_block_ends():
    simulation = live()
    simulation.set_driver("guarded policy")
    simulation.step(12)
    assert drove(simulation) == ".....XXX...."


def test_without_a_policy_only_the_expert_can_drive():
    simulation = live(policy=False)
    assert simulation.drivers == ("expert",)
    with pytest.raises(ValueError, match="expert"):
        simulation.set_driver("policy")
    simulation.step(2)
    assert drove(simulation) == "XX"


def test_a_command_reaches_who_drives_and_survives_a_reset():
    simulation = live()
    simulation.set_command(Command(0.1, -0.05, 0.3))
    simulation.step(1)
    simulation.reset()
    simulation.step(1)
    [(tick, command, _)] = simulation._policy.calls
    assert (tick.tolist(), command.tolist()) == ([0], [[0.1, -0.05, 0.3]])


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_are_refused(value):
    simulation = live()
    with pytest.raises(ValueError, match="not finite"):
        simulation.set_command(Command(value))
    with pytest.raises(ValueError, match="not finite"):
        simulation.push(value, 0.0)
    with pytest.raises(ValueError, match="not finite"):
        simulation.push(1.0, value)


def test_a_push_is_spread_over_its_ticks_in_the_heading_frame():
    simulation = live()
    simulation.step(2)
    assert simulation.snapshot().push is None
    simulation.push(0.8, 90.0)
    heading = simulation.snapshot().state.heading
    simulation.step(PUSH_TICKS + 5)
    pushes = simulation._simulator.pushes
    assert [tick for tick, _, _ in pushes] == list(range(2, 2 + PUSH_TICKS))
    total = sum(impulse for _, impulse, _ in pushes)
    expected = from_heading(np.array([0.0, 0.8]), heading)
    np.testing.assert_allclose(total, [*expected, 0.0], atol=1e-12)
    np.testing.assert_allclose(simulation.snapshot().push, total)
    simulation.step(PUSH_SHOWN)
    assert simulation.snapshot().push is None


def test_a_robot_that_fell_lies_down_and_then_time_stands_still():
    simulation = live(heights={0: [(600, 0.05)]})
    simulation.step(5000)
    snapshot = simulation.snapshot()
    assert snapshot.ended == "the robot fell"
    assert snapshot.seconds == pytest.approx(0.6 + LIMP_TICKS / 1000)
    assert simulation.over
    limp = simulation._simulator.applied[-1]
    np.testing.assert_allclose(limp, -0.1 * snapshot.state.v[None, 6:])
    simulation.reset()
    assert (simulation.over, simulation.snapshot().ended) == (False, "")


def test_a_body_that_stays_on_the_ground_is_a_fall_where_the_bounds_say_so():
    touches = {0: [(600, 620), (700, 5000)]}
    simulation = live(safety=replace(SAFETY, body_contact=0.1), touches=touches)
    simulation.step(3000)
    assert simulation.snapshot().seconds == pytest.approx(0.799 + LIMP_TICKS / 1000)
    simulation = live(touches=touches)
    simulation.step(3000)
    assert simulation.snapshot().ended == ""


def test_an_expert_that_gives_up_and_numbers_that_run_away_end_it():
    simulation = live(gives_up={0: 20}, policy=False)
    simulation.step(30)
    assert simulation.snapshot().ended.startswith("the expert gave up")
    simulation = live(lost={0: 20})
    simulation.step(30)
    assert simulation.snapshot().ended == "the simulation has blown up"
    assert simulation.over


def test_the_trace_holds_ten_seconds_at_most():
    simulation = live()
    simulation.step(2 * SAMPLE_TICKS + 1)
    np.testing.assert_allclose(simulation.trace[:, 0], [0.0, 0.02, 0.04])
    simulation.step(11_000)
    assert simulation.trace.shape == (500, 7)


def test_contact_forces_are_those_of_the_simulator():
    simulation = live()
    simulation.step(1)
    force = simulation.snapshot().force
    np.testing.assert_array_equal(force > 0.0, simulation.snapshot().state.contacts)


class RememberingController(FakeController):
    """Notes the torques of all ticks, as a policy with a history does."""

    def reset(self, batch):
        super().reset(batch)
        self.observed = []

    def observe(self, state, tick, torque):
        self.observed.append((tick[0], torque[0]))


def test_a_policy_with_a_history_remembers_every_tick_with_the_clipped_torque_whoever_drives():
    simulator = FakeSimulator(1)
    policy = RememberingController(-1e3)
    simulation: Any = LiveSimulation(simulator, SAFETY, 0.1, FakeController(EXPERT), policy)
    simulation.step(2)
    simulation.set_driver("expert")
    simulation.step(2)
    ticks, torques = zip(*policy.observed, strict=True)
    assert ticks == (0, 1, 2, 3)
    np.testing.assert_array_equal(torques, np.concatenate(simulator.applied))
    np.testing.assert_array_equal(torques[0], -simulator.robot.torque_limit)
    assert torques[3][0] > 0.0


class GaitController(FakeController):
    """Notes the gait of each tick."""

    gait = 0

    def reset(self, batch):
        super().reset(batch)
        self.gaits_told = []
        self.gait = 0

    def torque(self, state, tick, command, mask):
        self.gaits_told.append(self.gait)
        return super().torque(state, tick, command, mask)


def in_gaits(*names) -> Any:
    gaits = [GAITS[name] for name in names]
    controllers = (GaitController(EXPERT), GaitController(POLICY))
    return LiveSimulation(FakeSimulator(1), SAFETY, 0.1, *controllers, gaits=gaits)


def test_a_gait_begins_by_the_rule_of_episodes_for_policy_and_expert():
    simulation = in_gaits("trot", "walk")
    simulation.step(200)
    simulation.set_gait(1)
    simulation.step(300)
    snapshot = simulation.snapshot()
    assert (snapshot.gait, snapshot.asked_gait) == (0, 1)
    simulation.step(600)
    begun = switch_tick(GAITS["trot"], GAITS["walk"], 200)
    assert begun == 1000
    assert simulation._policy.gaits_told == [0] * begun + [1] * (1100 - begun)
    simulation.set_driver("expert")
    simulation.step(1)
    assert simulation._expert.gaits_told == [1]
    assert simulation.snapshot().gait == 1


def test_a_reset_begins_in_the_gait_that_was_asked_for():
    simulation = in_gaits("trot", "walk")
    simulation.step(200)
    simulation.set_gait(1)
    simulation.reset()
    simulation.step(2)
    assert simulation._policy.gaits_told == [1, 1]
    simulation.begin_in(0)
    simulation.step(1)
    assert simulation._policy.gaits_told == [0]


def test_a_robot_goes_on_with_further_gaits_where_it_is():
    first = in_gaits("trot")
    first.set_command(Command(0.2))
    first.step(230)
    state = first.snapshot().state
    second = in_gaits("trot", "walk")
    second.go_on_from(first)
    second.set_gait(1)
    snapshot = second.snapshot()
    np.testing.assert_array_equal(snapshot.state.q, state.q)
    assert (snapshot.seconds, snapshot.command) == (0.23, Command(0.2))
    np.testing.assert_array_equal(second.trace, first.trace)
    second.step(771)
    [(tick, _, _)] = second._policy.calls[-1:]
    assert tick.tolist() == [1000]
    assert second._policy.gaits_told == [0] * 770 + [1]


def test_who_cannot_be_told_the_gait_or_has_none_of_that_number_is_refused():
    gaits = [GAITS["trot"], GAITS["walk"]]
    with pytest.raises(ValueError, match="FakeController takes none"):
        LiveSimulation(FakeSimulator(1), SAFETY, 0.1, FakeController(), gaits=gaits)
    with pytest.raises(ValueError, match="use 0 to 1"):
        in_gaits("trot", "walk").set_gait(2)


def test_a_simulation_is_of_one_robot():
    with pytest.raises(ValueError, match="give it one"):
        LiveSimulation(FakeSimulator(2), SAFETY, 0.1, FakeController())
