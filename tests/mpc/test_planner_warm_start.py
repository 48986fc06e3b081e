"""Starting from an earlier plan: fewer ADMM iterations, the same plan, no harm if it is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import CentroidalConfig, Config, ExpertConfig, Gait, KinematicConfig
from surefoot.mpc.expert import make_expert
from surefoot.mpc.planner import PLAN_TICKS, Planner
from surefoot.robots.model import standing
from surefoot.robots.scaling import own_expert
from surefoot.sim import make_simulator
from surefoot.types import Command
from tests.fakes.plans import FORWARD, FRICTION, PLANNER, ROBOT

CONFIG = own_expert(ExpertConfig(), ROBOT)
TOLERANCE = CONFIG.centroidal.tolerance


@pytest.fixture(scope="module")
def trot():
    """``(state, tick, previous, warm)`` of each replan of a trot whose plans all start warm."""
    replans = []
    previous = None

    def plan(state, tick, command):
        nonlocal previous
        stages = PLANNER.solve(state, tick, command, previous)
        replans.append((state, tick, previous, stages))
        previous = stages
        return stages.motion

    expert = make_expert(ROBOT, Config(expert=CONFIG), plan)
    expert.reset(1)
    simulator = make_simulator(ROBOT, 1)
    simulator.reset(standing(ROBOT)[None], np.zeros((1, 18)))
    for tick in range(1500):
        state = simulator.state
        clock = np.array([tick])
        simulator.step(expert.torque(state, clock, np.array([FORWARD]), np.array([True])))
    assert simulator.state.q[0, 0] > 0.2  # it walks
    return replans[1:]


def test_warm_plans_of_a_trot_need_fewer_admm_iterations(trot):
    cold = [PLANNER.solve(state, tick, FORWARD) for state, tick, _, _ in trot]
    warm = [stages for _, _, _, stages in trot]
    pairs = zip(cold, warm, strict=True)
    fewer = [c.centroidal.iterations - w.centroidal.iterations for c, w in pairs]
    assert np.mean(fewer) > 3.0  # 4.5 measured, of 17
    assert np.min(fewer) >= 0


def test_warm_plans_of_a_trot_agree_with_cold_ones(trot):
    torque = []
    cost = []
    for state, tick, _, warm in trot:
        cold = PLANNER.solve(state, tick, FORWARD)
        assert warm.motion.valid
        assert warm.centroidal.residual < TOLERANCE
        np.testing.assert_allclose(warm.centroidal.forces, cold.centroidal.forces, atol=0.2)
        # The first nodes only: y after a second hardly matters to the objective.
        np.testing.assert_allclose(warm.centroidal.com[:4], cold.centroidal.com[:4], atol=5e-4)
        torque.append(np.abs(warm.motion.torque - cold.motion.torque).max())
        cost.append(warm.kinematic.cost / cold.kinematic.cost - 1)
    # Three Gauss-Newton iterations are not the optimum, least of all after a touchdown.
    assert np.median(torque) < 0.02
    assert abs(np.median(cost)) < 5e-3


def planner_of(iterations: int) -> Planner:
    """A planner that makes so many Gauss-Newton iterations."""
    config = replace(CONFIG, kinematic=KinematicConfig(max_iterations=iterations))
    return Planner(ROBOT, Gait(), config, FRICTION)


def test_one_gauss_newton_iteration_gets_farther_from_a_warm_start(trot):
    once = planner_of(1)
    many = planner_of(30)
    cold = []
    warm = []
    for state, tick, previous, _ in trot[5:]:
        best = many.solve(state, tick, FORWARD).kinematic.cost
        cold.append(once.solve(state, tick, FORWARD).kinematic.cost / best - 1)
        warm.append(once.solve(state, tick, FORWARD, previous).kinematic.cost / best - 1)
    assert np.median(warm) < 0.25 * np.median(cold)  # 0.03 and 0.7 measured


@pytest.mark.parametrize("later", [0, 10, 17, 41, 99])
def test_off_the_grid_plans_agree_too(trot, later):
    """At ticks between the nodes, and from plans that were made there."""
    state, _, previous, _ = trot[10]
    for clock in (previous.tick + later, previous.tick + 7):
        cold = PLANNER.solve(state, clock, FORWARD)
        warm = PLANNER.solve(state, clock, FORWARD, previous)
        assert warm.centroidal.residual < TOLERANCE
        assert warm.centroidal.iterations <= cold.centroidal.iterations
        np.testing.assert_allclose(warm.centroidal.forces, cold.centroidal.forces, atol=0.3)
        previous = cold


def spoiled(plan, size: float):
    """A plan with noise, or NaN, in all that a warm start uses."""
    rng = np.random.default_rng(0)

    def with_noise(array):
        return array + size * rng.normal(size=array.shape)

    c = plan.centroidal
    fields = ("com", "com_velocity", "angular_momentum", "dual")
    centroidal = replace(c, **{name: with_noise(getattr(c, name)) for name in fields})
    kinematic = replace(plan.kinematic, q=with_noise(plan.kinematic.q))
    return replace(plan, centroidal=centroidal, kinematic=kinematic)


@pytest.mark.parametrize(
    "wrong", ["other state", "other command", "other gait", 0.01, 1.0, 100.0, 1e200, np.nan]
)
def test_a_wrong_plan_does_no_harm(trot, wrong):
    pronk = Planner(ROBOT, Gait(period=0.6, duty=0.5, offsets=(0, 0, 0, 0)), CONFIG, FRICTION)
    kinematic = []
    for at in range(5, 25):
        state, tick, previous, _ = trot[at]
        if wrong == "other state":
            previous = replace(trot[(at + 12) % 25][2], tick=tick)
        elif wrong == "other command":
            previous = PLANNER.solve(state, tick, Command(-1.0, 0.5, 2.0))
        elif wrong == "other gait":
            previous = pronk.solve(state, tick, FORWARD)
        else:
            previous = spoiled(previous, wrong)
        cold = PLANNER.solve(state, tick, FORWARD)
        warm = PLANNER.solve(state, tick, FORWARD, previous)
        assert warm.motion.valid
        assert warm.centroidal.residual < TOLERANCE
        np.testing.assert_allclose(warm.centroidal.forces, cold.centroidal.forces, atol=0.5)
        kinematic.append(warm.kinematic.cost / cold.kinematic.cost - 1)
    assert np.median(kinematic) < 0.02


def test_plans_that_cannot_be_used_leave_the_cold_bits(trot):
    state, tick, previous, _ = trot[3]
    cold = PLANNER.solve(state, tick, FORWARD)
    short = replace(CONFIG, centroidal=CentroidalConfig(nodes=12))
    shorter = replace(CONFIG, kinematic=KinematicConfig(nodes=5))
    unusable = [
        replace(previous, tick=tick + 1),
        replace(previous, tick=tick - PLAN_TICKS),
        replace(previous, motion=replace(previous.motion, valid=False)),
        *(
            Planner(ROBOT, Gait(), c, FRICTION).solve(state, tick, FORWARD)
            for c in (short, shorter)
        ),
    ]
    for plan in unusable:
        other = PLANNER.solve(state, tick, FORWARD, plan)
        assert np.array_equal(other.motion.torque, cold.motion.torque)
        assert other.centroidal.iterations == cold.centroidal.iterations


def test_nothing_is_remembered_and_the_earlier_plan_is_not_changed(trot):
    state, tick, previous, _ = trot[3]
    before = PLANNER.plan(state, tick, FORWARD)
    arrays = [previous.kinematic.q, previous.centroidal.com, previous.centroidal.dual]
    copies = [array.copy() for array in arrays]
    PLANNER.solve(state, tick, FORWARD, previous)
    for array, copy in zip(arrays, copies, strict=True):
        assert np.array_equal(array, copy)
    assert np.array_equal(PLANNER.plan(state, tick, FORWARD).torque, before.torque)
