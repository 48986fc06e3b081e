"""The whole-body solver against an independent one, finite differences and the dynamics."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import KinematicConfig
from surefoot.mpc.footholds import ContactPlan
from surefoot.mpc.kinematics import KinematicProblem, KinematicSolver
from surefoot.robots.scaling import own_kinematic
from surefoot.robots.solo12 import solo12

ROBOT = solo12()
MODEL = ROBOT.model
CONFIG = own_kinematic(KinematicConfig(), ROBOT)
DATA = np.load(Path(__file__).parent / "data" / "kinematic_known_answers.npz")
COUNT = len(DATA["cost"])
NOMINAL = range(0, COUNT, 2)  # every second instance starts from a perturbed state


def known_problem(index: int) -> KinematicProblem:
    via = DATA["via"][index]
    position = DATA["contact"][index][:, :, 1:].copy()
    position[via, 2] = DATA["via_height"]
    active = DATA["contact"][index][:, :, 0] > 0.5
    contacts = ContactPlan(active, position, DATA["dt"][index], via)
    q_ref = np.tile(DATA["x_reg"][:19], (11, 1))
    x0 = DATA["x0"][index]
    return KinematicProblem(
        x0[:19], x0[19:], contacts, DATA["momentum"][index], q_ref, np.zeros((11, 18))
    )


def solver(**changes) -> KinematicSolver:
    return KinematicSolver(ROBOT, replace(CONFIG, **changes))


def random_problem(seed: int) -> KinematicProblem:
    """A known problem with uneven nodes, a moving reference and a start that is out of place."""
    rng = np.random.default_rng(seed)
    problem = known_problem(int(rng.integers(COUNT)))
    q0 = pin.integrate(MODEL, problem.q0, rng.normal(0, 0.1, 18))
    q_ref = np.array([pin.integrate(MODEL, q, rng.normal(0, 0.1, 18)) for q in problem.q_ref])
    dt = np.concatenate([[rng.integers(10, 60) / 1000], np.full(9, 0.05)])
    contacts = replace(problem.contacts, dt=dt)
    v0 = rng.normal(0, 0.3, 18)
    v_ref = rng.normal(0, 0.3, (11, 18))
    return KinematicProblem(q0, v0, contacts, problem.momentum, q_ref, v_ref)


def test_weights_are_those_of_the_known_answers():
    subject = solver()
    state, control = DATA["reg_wt"]
    np.testing.assert_allclose(subject._state_weight, state * DATA["state_wt"])
    np.testing.assert_allclose(subject._control_weight, control * DATA["ctrl_wt"])
    assert np.all(DATA["foot_wt"] == CONFIG.foot_weight)
    assert np.all(DATA["momentum_wt"] == CONFIG.momentum_weight)


def test_objective_equals_the_stored_costs():
    subject = solver()
    for i in range(COUNT):
        xs = DATA["xs"][i]
        cost = subject.cost(known_problem(i), xs[:, :19], xs[:, 19:], DATA["us"][i])
        assert cost == pytest.approx(DATA["cost"][i], rel=1e-9)


def test_converged_solver_reaches_the_independent_solvers_costs():
    subject = solver(max_iterations=60, tolerance=1e-12)
    for i in range(COUNT):
        plan = subject.solve(known_problem(i))
        assert plan.cost <= DATA["cost"][i] * (1 + 1e-6)
        if i in NOMINAL:  # the same minimum, not only the same cost
            np.testing.assert_allclose(plan.acceleration, DATA["us"][i], atol=2e-2)


def test_default_iterations_are_enough_on_nominal_states():
    subject = solver()
    excess = [subject.solve(known_problem(i)).cost / DATA["cost"][i] - 1 for i in range(COUNT)]
    nominal = np.array(excess)[NOMINAL]
    assert np.median(nominal) < 1e-6
    assert np.max(nominal) < 2e-2
    assert np.median(excess) < 2e-3


def test_a_guess_does_no_harm_and_a_good_one_saves_iterations():
    """A wrong guess: another instance's motion. A good one: the solution's; kept where it helps."""
    subject = solver()
    once = solver(max_iterations=1)
    lower = 0
    for i in range(COUNT):
        problem = known_problem(i)
        other = known_problem((i + 7) % COUNT)
        solution = subject.solve(problem)
        wrong = subject.solve(problem, subject.solve(other).q)
        assert wrong.cost < 1.2 * solution.cost
        lower += once.solve(problem, solution.q).cost < once.solve(problem).cost
    assert lower > 0.8 * COUNT


@pytest.mark.parametrize("spoil", [np.nan, np.inf, 1e6])
def test_a_guess_that_costs_more_than_the_cold_start_is_not_taken(spoil):
    problem = known_problem(0)
    cold = solver().solve(problem)
    guess = cold.q.copy()
    guess[4, 9] = spoil
    assert np.array_equal(solver().solve(problem, guess).acceleration, cold.acceleration)


def rollout(problem, u):
    """The dynamics, with Pinocchio's integration."""
    q = [problem.q0]
    v = [problem.v0]
    for dt, acceleration in zip(problem.contacts.dt, u, strict=True):
        v.append(v[-1] + dt * acceleration)
        q.append(pin.integrate(MODEL, q[-1], dt * v[-1]))
    return np.array(q), np.array(v)


@pytest.mark.parametrize("seed", range(3))
def test_solution_satisfies_the_dynamics(seed):
    problem = random_problem(seed)
    plan = solver().solve(problem)
    q, v = rollout(problem, plan.acceleration)
    np.testing.assert_allclose(plan.v, v, atol=1e-11)
    sign = np.sign(np.sum(plan.q[:, 3:7] * q[:, 3:7], axis=1))
    plan.q[:, 3:7] *= sign[:, None]
    np.testing.assert_allclose(plan.q, q, atol=1e-10)
    assert solver().cost(problem, q, v, plan.acceleration) == pytest.approx(plan.cost, rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_gradient_vanishes_at_the_solution(seed):
    problem = random_problem(seed)
    subject = solver(max_iterations=200, tolerance=1e-14)
    plan = subject.solve(problem)
    directions = np.random.default_rng(seed).normal(size=(12, 10, 18))

    def cost_of(u):
        return subject.cost(problem, *rollout(problem, u), u)

    def steepest(u):
        """The largest slope at some accelerations, by central differences."""
        h = 1e-5
        slopes = [cost_of(u + h * way) - cost_of(u - h * way) for way in directions]
        return np.abs(slopes).max() / (2 * h)

    assert steepest(plan.acceleration) < 1e-7 * steepest(np.zeros((10, 18)))


def test_a_start_that_is_not_finite_has_a_cost_that_is_not_finite():
    problem = known_problem(0)
    for field in ("q0", "v0"):
        bad = getattr(problem, field).copy()
        bad[7] = np.nan
        plan = solver().solve(replace(problem, **{field: bad}))
        assert not np.isfinite(plan.cost)
        assert plan.iterations == 0
