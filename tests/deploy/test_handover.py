"""The hand-over to the expert: latency, late and invalid plans, a planner that has ended."""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.gate import Blocking, BoundsGate, GateSwitch
from surefoot.deploy.handover import (
    LatePlan,
    NoPlan,
    PlanFollower,
    PlanRequest,
    Safeguard,
    expected,
)
from surefoot.deploy.interfaces import BaseEstimate, MissingBase, Sensors
from surefoot.types import TICK_NS, Command, GaitCommand, MotionPlan
from tests.fakes.bridge_world import World

COMMAND = Command(0.1)


def sensors(**change) -> Sensors:
    measured = Sensors(
        time_ns=0,
        sequence=1,
        joint_position=np.linspace(-1.0, 1.0, 12),
        joint_velocity=np.linspace(-5.0, 5.0, 12),
        joint_torque=np.zeros(12),
        orientation=np.array([0.0, 0.0, 0.0, 1.0]),
        angular_velocity=np.array([0.0, 0.0, 2.0]),
        acceleration=np.zeros(3),
        base=BaseEstimate(0.25, np.array([0.1, 0.0, -0.5])),
    )
    return measured._replace(**change)


def plan_at(tick: int, valid: bool = True) -> MotionPlan:
    """A plan whose torques are the ticks that they belong to."""
    rows = np.repeat(np.arange(tick, tick + 100.0)[:, None], 12, axis=1)
    return MotionPlan(np.zeros((100, 12)), np.zeros((100, 12)), rows, valid)


class Link:
    """A planner that takes some ticks to answer."""

    def __init__(self, takes: int = 3, valid=lambda number: True) -> None:
        self.takes = takes
        self.valid = valid
        self.now = 0
        self.requests: list[PlanRequest] = []
        self.coming: list[tuple[int, tuple[int, MotionPlan]]] = []
        self.ended = False

    def ask(self, request: PlanRequest) -> None:
        if self.ended:
            raise NoPlan("the planner's process has ended")
        plan = plan_at(request.tick, self.valid(len(self.requests)))
        self.requests.append(request)
        self.coming.append((self.now + self.takes, (request.tick, plan)))

    def answer(self, seconds=0.0):
        if self.coming and (seconds or self.coming[0][0] <= self.now):
            return self.coming.pop(0)[1]
        return None

    def forget(self) -> None:
        self.coming.clear()


def drive(driver: PlanFollower, link: Link, start: int, ticks: int) -> list[float | None]:
    """The torques of some ticks; None where the expert waits."""
    torques: list[float | None] = []
    for tick in range(start, start + ticks):
        link.now = tick
        command = driver.command(sensors(), tick, COMMAND)
        torques.append(None if command is None else float(command.torque[0]))
    return torques


def expert(link: Link, latency: int = 8, patience: int = 60) -> PlanFollower:
    return PlanFollower(link, 3.0, 0.05, latency, patience)


def test_the_state_that_is_expected_moves_on_as_it_moves():
    q, v = expected(sensors(), 10)
    measured = sensors()
    np.testing.assert_allclose(q[7:], measured.joint_position + 0.01 * measured.joint_velocity)
    assert q[2] == pytest.approx(0.245)
    np.testing.assert_allclose(q[3:7], [0.0, 0.0, np.sin(0.01), np.cos(0.01)])
    np.testing.assert_allclose(v[:6], [0.1, 0.0, -0.5, 0.0, 0.0, 2.0])
    np.testing.assert_array_equal(v[6:], measured.joint_velocity)


def test_a_base_that_is_tilted_moves_and_turns_in_its_own_frame():
    orientation = pin.exp3(np.array([0.5, -0.8, 1.2]))
    measured = sensors(
        orientation=pin.Quaternion(orientation).coeffs(),
        angular_velocity=np.array([1.0, -2.0, 1.5]),
        base=BaseEstimate(0.25, np.array([0.4, -0.3, 0.2])),
    )
    q, _ = expected(measured, 10)
    turned = pin.Quaternion(orientation @ pin.exp3(0.01 * measured.angular_velocity)).coeffs()
    assert abs(q[3:7] @ turned) == pytest.approx(1.0, abs=1e-12)
    assert measured.base is not None
    assert q[2] == pytest.approx(0.25 + 0.01 * (orientation @ measured.base.velocity)[2])


def test_without_an_estimate_of_the_base_there_is_no_plan():
    with pytest.raises(MissingBase, match="nothing measures the height"):
        expected(sensors(base=None), 8)


def test_a_plan_takes_effect_when_it_was_asked_for_and_each_row_at_its_tick():
    link = Link(takes=3)
    torques = drive(expert(link), link, 123, 300)
    assert torques[:8] == [None] * 8
    assert torques[8:] == [float(tick) for tick in range(131, 423)]
    asked = [request.tick for request in link.requests]
    assert asked == [131, 150, 200, 250, 300, 350, 400]


def test_a_plan_that_comes_late_begins_at_the_row_of_its_tick():
    link = Link(takes=20)
    driver = expert(link)
    torques = drive(driver, link, 0, 100)
    assert torques[:20] == [None] * 20
    assert torques[20:] == [float(tick) for tick in range(20, 100)]
    assert driver.late == driver.plans > 0


def test_plans_of_a_rehearsal_are_neither_followed_nor_counted():
    link = Link(takes=3)
    driver = expert(link)
    for tick in range(1000):
        link.now = tick
        driver.rehearse(sensors(time_ns=tick * TICK_NS), COMMAND)
    assert [request.tick for request in link.requests] == [8, 508]
    link.now = 1000  # the answer to the next one is still to come
    driver.rehearse(sensors(time_ns=1000 * TICK_NS), COMMAND)
    driver.release()
    torques = drive(driver, link, 1001, 20)
    assert torques == [None] * 8 + [float(tick) for tick in range(1009, 1021)]
    assert driver.plans == 1


@pytest.mark.parametrize(("step", "offset"), [(2, 1), (10, 3), (10, 9)])
def test_a_planner_is_rehearsed_at_every_rate(step, offset):
    link = Link(takes=0)
    driver = expert(link)
    for tick in range(offset, 2000, step):
        link.now = tick
        driver.rehearse(sensors(time_ns=tick * TICK_NS), COMMAND)
    assert len(link.requests) == 4


def test_a_rehearsal_without_a_planner_is_no_fault_until_a_plan_is_needed():
    link = Link()
    link.ended = True
    driver = expert(link)
    driver.rehearse(sensors(), COMMAND)
    driver.rehearse(sensors(base=None), COMMAND)
    with pytest.raises(NoPlan, match="has ended"):
        driver.command(sensors(), 0, COMMAND)


def test_in_lockstep_the_robot_waits_for_a_planner_of_any_speed():
    torques = []
    for takes in (0, 3, 500):
        link = Link(takes, valid=lambda number: number != 0)
        driver = PlanFollower(link, 3.0, 0.05, 8, 60, lockstep=True)
        torques.append(drive(driver, link, 10, 200))
        assert driver.late == 0
    assert torques[0] == torques[1] == torques[2]
    assert torques[0][16:] == [float(tick) for tick in range(26, 210)]


def test_after_an_invalid_plan_the_old_one_goes_on():
    link = Link(valid=lambda number: number != 2)
    torques = drive(expert(link), link, 0, 190)
    assert torques[8:] == [float(tick) for tick in range(8, 190)]


def test_a_first_plan_that_is_invalid_is_asked_for_again():
    link = Link(valid=lambda number: number > 0)
    torques = drive(expert(link), link, 10, 50)
    assert [request.tick for request in link.requests][:2] == [18, 21]
    assert torques[11:] == [float(tick) for tick in range(21, 60)]


def test_without_valid_plans_nobody_can_take_over():
    link = Link(valid=lambda number: False)
    with pytest.raises(NoPlan, match="no valid plan came within 60 ms"):
        drive(expert(link), link, 0, 100)


def test_a_plan_that_ends_without_a_next_one_is_an_end():
    link = Link(valid=lambda number: number == 0)
    with pytest.raises(NoPlan, match="has ended after 100 ms"):
        drive(expert(link), link, 0, 150)


def test_a_planner_that_does_not_answer_is_late_and_has_not_failed():
    link = Link(takes=500)
    with pytest.raises(LatePlan, match="no plan came within 60 ms: the planner is slow"):
        drive(expert(link), link, 0, 100)
    link = Link(takes=0)
    driver = expert(link)
    drive(driver, link, 0, 60)
    link.takes = 500
    with pytest.raises(LatePlan, match="no plan followed one that has ended after 100 ms"):
        drive(driver, link, 60, 150)
    # An invalid one says that the planner has failed.
    link = Link(valid=lambda number: False)
    with pytest.raises(NoPlan) as raised:
        drive(expert(link), link, 0, 100)
    assert not isinstance(raised.value, LatePlan)


def test_a_planner_that_falls_silent_after_an_invalid_plan_is_late():
    link = Link(valid=lambda number: number != 1)
    driver = expert(link)
    drive(driver, link, 0, 46)
    assert driver.invalid == 1
    link.takes = 500
    with pytest.raises(LatePlan, match="no plan followed one that has ended after 100 ms"):
        drive(driver, link, 46, 100)


def test_plans_of_an_earlier_takeover_are_not_followed():
    link = Link(takes=3)
    driver = expert(link)
    drive(driver, link, 0, 2)
    driver.release()
    torques = drive(driver, link, 500, 20)
    assert torques[8:] == [float(tick) for tick in range(508, 520)]


def test_the_expert_drives_for_a_block_and_until_the_state_is_safe():
    blocking = Blocking(5)
    unsafe = [False, True, False, False, False, False, True, False, False]
    blocked = [blocking.is_blocked(value, tick) for tick, value in enumerate(unsafe)]
    assert blocked == [False, True, True, True, True, True, True, False, False]


def test_ticks_that_nobody_saw_are_part_of_a_block():
    blocking = Blocking(5)
    blocked = [blocking.is_blocked(tick == 1, tick) for tick in (0, 1, 2, 5, 7)]
    assert blocked == [False, True, True, True, False]


def world_with(link: Link | None, unsafe: list[bool]) -> World:
    class Gate(BoundsGate):
        def unsafe(self, sensors: Sensors) -> bool:
            return unsafe[0]

    gate = Gate(np.zeros(15), np.zeros(15), lambda joints: np.zeros((1, 3)))
    driver = None if link is None else expert(link)
    safeguard = Safeguard(GateSwitch(gate, 100), driver)
    config = RuntimeConfig(stand=0.05, absurd_torque=100.0)  # plans ask for a torque of their tick
    world = World(safeguard=safeguard, config=config)
    world.run(200)
    world.driver.written.clear()
    return world


def test_a_gate_without_an_expert_damps():
    unsafe = [False]
    world = world_with(None, unsafe)
    unsafe[0] = True
    assert world.until_damped() <= 2
    fault = world.runtime.fault
    assert fault is not None and fault.kind == "gate"
    assert world.runtime.recorder.flight().tick[-1] == fault.tick


def test_a_gate_with_an_expert_hands_over_and_back():
    unsafe = [False]
    link = Link(takes=0)
    world = world_with(link, unsafe)
    unsafe[0] = True
    world.run(1)
    unsafe[0] = False
    for _ in range(150):
        link.now += 1
        world.tick()
    runtime = world.runtime
    assert runtime.fault is None
    assert runtime.drivers.takeovers == 1
    assert runtime.drivers.expert_ticks == 100 - 8
    stiffness = [command[24] for command in world.driver.written]
    first = stiffness.index(3.0)
    assert set(stiffness[first : first + 92]) == {3.0}
    assert set(stiffness[first + 92 :]) == {2.0}
    # The expert's ticks are in the policy's history: 1 N m more with each, as its plan says.
    assert len(world.policy.remembered) == 92
    np.testing.assert_allclose(
        np.diff([torque[0] for torque in world.policy.remembered]), 1, atol=0.5
    )
    drove = runtime.recorder.flight().expert_drove
    assert drove.sum() == 92


def test_a_planner_that_has_ended_damps_at_the_takeover():
    unsafe = [False]
    link = Link()
    world = world_with(link, unsafe)
    link.ended = True
    world.run(50)
    assert world.runtime.fault is None
    unsafe[0] = True
    assert world.until_damped() <= 2
    assert world.runtime.fault is not None and world.runtime.fault.kind == "expert"
    assert "has ended" in world.runtime.fault.detail


def test_a_gait_clock_that_skips_the_grid_has_its_plans_right_after_it():
    link = Link(takes=0)
    driver = expert(link)
    skipped = {142, 192, 193}
    for tick in (tick for tick in range(130, 250) if tick not in skipped):
        link.now = tick
        command = driver.command(sensors(), tick, COMMAND)
        if tick >= 138:
            assert command is not None and command.torque[0] == tick
    assert [request.tick for request in link.requests] == [138, 151, 202, 250]


def test_without_latency_a_robot_in_lockstep_follows_a_plan_at_once_and_from_where_it_is():
    link = Link(takes=500)
    driver = PlanFollower(link, 3.0, 0.05, 0, 60, lockstep=True)
    torques = drive(driver, link, 123, 200)
    assert torques == [float(tick) for tick in range(123, 323)]
    assert [request.tick for request in link.requests] == [123, 150, 200, 250, 300]
    measured = sensors()
    np.testing.assert_array_equal(link.requests[0].q[3:7], measured.orientation)
    np.testing.assert_array_equal(link.requests[0].q[7:], measured.joint_position)


def test_plans_of_an_episode_before_are_not_followed_though_the_gait_clock_begins_anew():
    link = Link(takes=5)
    driver = expert(link)
    drive(driver, link, 900, 60)
    driver.release()
    torques = drive(driver, link, 0, 60)
    assert torques[8:] == [float(tick) for tick in range(8, 60)]


def test_a_plan_of_another_gait_is_asked_for_at_once_though_the_grid_is_not_reached():
    link = Link(takes=0)
    driver = PlanFollower(link, 3.0, 0.05, 0, 60, lockstep=True)
    torques = []
    for tick in range(100, 160):
        command = driver.command(sensors(), tick, GaitCommand(0.1, gait=int(tick >= 120)))
        assert command is not None
        torques.append(float(command.torque[0]))
    asked = [(request.tick, request.command.gait) for request in link.requests]
    assert asked == [(100, 0), (120, 1), (150, 1)]
    assert torques == [float(tick) for tick in range(100, 160)]


def test_after_a_hand_back_the_gait_of_the_next_plan_is_that_of_its_own_command():
    link = Link(takes=0)
    driver = expert(link)
    driver.command(sensors(), 0, GaitCommand(0.1, gait=1))
    driver.release()
    drive(driver, link, 10, 20)
    asked = [(request.tick, request.command.gait) for request in link.requests]
    assert asked == [(8, 1), (18, 0)]
