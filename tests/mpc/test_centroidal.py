"""The centroidal solver against IPOPT, dense linear algebra and the laws of mechanics."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from surefoot.config import CentroidalConfig
from surefoot.mpc import centroidal, centroidal_steps
from surefoot.mpc.centroidal import CentroidalProblem, solve_centroidal
from surefoot.mpc.footholds import ContactPlan

CONFIG = CentroidalConfig()
MASS = 2.5
FRICTION = 0.5
NODES = 20
HIPS = np.array([[0.19, 0.14, 0.0], [0.19, -0.14, 0.0], [-0.19, 0.14, 0.0], [-0.19, -0.14, 0.0]])
WEIGHT = np.vstack(
    (
        np.tile(np.ravel((CONFIG.position, CONFIG.velocity, CONFIG.angular_momentum)), (NODES, 1)),
        np.ravel(
            (
                CONFIG.terminal_position,
                CONFIG.terminal_velocity,
                CONFIG.terminal_angular_momentum,
            )
        ),
    )
)
SEEDS = range(24)


def instance(seed):
    """A trot (two- and four-foot stance) at a random phase, from a random disturbed state."""
    rng = np.random.default_rng(seed)
    scale = 3.0 if seed % 3 == 0 else 1.0  # every third is thrown hard enough to reach the cone
    velocity = np.array([rng.uniform(0, 0.3), rng.uniform(-0.1, 0.1), 0.0])
    dt = np.full(NODES, 0.05)
    dt[0] = rng.integers(10, 60) / 1000
    start = np.cumsum(dt) - dt
    phase = (np.arange(NODES)[:, None] + rng.integers(10) + np.array([0, 5, 5, 0])) % 10
    active = phase < 6
    landing = start[:, None] - 0.05 * phase
    travel = np.where(landing > 0, landing + 0.15, 0.0)
    position = HIPS + travel[..., None] * velocity + rng.normal(0, 0.005, (1, 4, 3))
    x0 = np.concatenate(
        (
            [0.0, 0.0, 0.2] + scale * rng.normal(0, (0.02, 0.02, 0.014)),
            velocity + scale * rng.normal(0, 0.1, 3),
            scale * rng.normal(0, 0.015, 3),
        )
    )
    reference = np.zeros((NODES + 1, 9))
    reference[:, 0:2] = x0[0:2] + np.append(start, dt.sum())[:, None] * velocity[0:2]
    reference[:, 2] = 0.2
    reference[:, 3:6] = velocity
    reference[:, 6:9] = scale * rng.normal(0, 0.01, 3)
    return ContactPlan(active, position, dt, ~active), x0, reference


def solve(contacts, x0, reference, config=CONFIG, guess=None):
    problem = CentroidalProblem(contacts, x0, reference, MASS, FRICTION)
    return solve_centroidal(problem, config, guess)


def violation(X, F, contacts, x0):
    """The dynamics in plain numpy, per unit mass; the last row is the start."""
    R = []
    for t, h in enumerate(contacts.dt):
        c, v, k = np.split(X[t], 3)
        v1 = v + h * (F[t].sum(axis=0) - [0, 0, 9.81])
        k1 = k + h * np.cross(contacts.position[t] - c, F[t]).sum(axis=0)
        R.append(X[t + 1] - np.concatenate((c + h * X[t + 1, 3:6], v1, k1)))
    return np.array([*R, X[0] - x0])


def integrate(F, contacts, x0):
    X = np.zeros((NODES + 1, 9))
    X[0] = x0
    for t in range(NODES):
        X[t + 1, 3:9] = -violation(X, F, contacts, x0)[t, 3:9]
        X[t + 1, 0:3] = X[t, 0:3] + contacts.dt[t] * X[t + 1, 3:6]
    return X


def cost(X, F, reference):
    return np.sum(WEIGHT * (X - reference) ** 2) + np.sum(np.array(CONFIG.force) * F**2)


def states(plan):
    return np.hstack((plan.com, plan.com_velocity, plan.angular_momentum / MASS))


@pytest.fixture(scope="module")
def ipopt():
    """The nonconvex problem as a whole, by an interior-point method from the standing start.

    The value gives the states and the forces of the instance of a seed.
    """
    ca = pytest.importorskip("casadi")
    X = ca.SX.sym("X", 9, NODES + 1)
    F = ca.SX.sym("F", 12, NODES)
    position = ca.SX.sym("p", 12, NODES)
    dt = ca.SX.sym("dt", NODES)
    x0 = ca.SX.sym("x0", 9)
    reference = ca.SX.sym("ref", 9, NODES + 1)
    objective = ca.sum1(ca.sum2(ca.DM(WEIGHT.T) * (X - reference) ** 2))
    objective += ca.sum1(ca.sum2(ca.repmat(ca.DM(CONFIG.force), 4, NODES) * F**2))
    dynamics = [X[:, 0] - x0]
    cones = []
    for t in range(NODES):
        feet = [F[3 * j : 3 * j + 3, t] for j in range(4)]
        moments = [ca.cross(position[3 * j : 3 * j + 3, t] - X[0:3, t], feet[j]) for j in range(4)]
        v1 = X[3:6, t] + dt[t] * (sum(feet) - ca.DM([0, 0, 9.81]))
        k1 = X[6:9, t] + dt[t] * sum(moments)
        dynamics.append(X[:, t + 1] - ca.vertcat(X[0:3, t] + dt[t] * v1, v1, k1))
        cones += [FRICTION**2 * f[2] ** 2 - f[0] ** 2 - f[1] ** 2 for f in feet]
    parameters = ca.vertcat(*(ca.vec(a) for a in (position, dt, x0, reference)))
    problem = {
        "x": ca.vertcat(ca.vec(X), ca.vec(F)),
        "f": objective,
        "g": ca.vertcat(*dynamics, *cones),
        "p": parameters,
    }
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-9}}
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    equalities = 9 * (NODES + 1)
    free = np.full(9 * (NODES + 1), np.inf)

    @cache
    def solution(seed):
        contacts, x0, reference = instance(seed)
        stance = np.repeat(contacts.active[..., None], 3, axis=2)
        lower = np.where(stance, [-np.inf, -np.inf, 0.0], 0.0).ravel()
        guess = np.where(stance, [0, 0, 9.81], 0.0) / contacts.active.sum(axis=1)[:, None, None]
        result = solver(
            x0=np.concatenate((np.tile(x0, NODES + 1), guess.ravel())),
            lbx=np.concatenate((-free, lower)),
            ubx=np.concatenate((free, np.where(stance, np.inf, 0.0).ravel())),
            lbg=0.0,
            ubg=np.concatenate((np.zeros(equalities), np.full(4 * NODES, np.inf))),
            p=np.concatenate((contacts.position.ravel(), contacts.dt, x0, reference.ravel())),
        )
        assert solver.stats()["success"]
        z = np.asarray(result["x"]).ravel()
        return z[:equalities].reshape(-1, 9), z[equalities:].reshape(NODES, 4, 3)

    return solution


@pytest.mark.parametrize("start", ["cold", "the plan of another instance"])
@pytest.mark.parametrize("seed", SEEDS)
def test_cost_is_that_of_the_true_optimum(seed, start, ipopt):
    """The plan's states violate the dynamics a little, so its own cost may lie below the optimum.

    The honest number is the cost of what the forces do: states integrated from them without any
    violation. With the forces in their cones that is a feasible point, which cannot beat a global
    optimum. Most of the cost is carrying the weight, so a small share can hide a lot: the forces
    are compared too.
    """
    contacts, x0, reference = instance(seed)
    guess = None if start == "cold" else solve(*instance(seed + 1))
    plan = solve(contacts, x0, reference, guess=guess)
    best_states, best_forces = ipopt(seed)
    best = cost(best_states, best_forces, reference)
    F = plan.forces / MASS
    assert plan.residual < 1e-3
    assert -1e-6 < cost(integrate(F, contacts, x0), F, reference) / best - 1 < 1e-2
    assert abs(cost(states(plan), F, reference) / best - 1) < 1e-2
    assert np.abs(F - best_forces).max() < 0.1  # [N/kg], of 4.9 for a foot in a trot


@pytest.mark.parametrize("seed", [0, 1, 3])
def test_converges_to_the_true_optimum(seed, ipopt):
    contacts, x0, reference = instance(seed)
    tight = replace(CONFIG, tolerance=1e-8, max_iterations=2000)
    plan = solve(contacts, x0, reference, tight)
    best_states, best_forces = ipopt(seed)
    assert plan.residual < 1e-8
    np.testing.assert_allclose(plan.forces / MASS, best_forces, atol=1e-3)
    np.testing.assert_allclose(states(plan), best_states, atol=1e-4)


def test_instances_reach_the_cone():
    """Else the tests above would not see it."""
    saturated = 0
    for seed in SEEDS:
        F = solve(*instance(seed)).forces
        ratio = np.hypot(F[..., 0], F[..., 1]) / np.maximum(F[..., 2], 1e-3)
        saturated += np.any(ratio > FRICTION - 1e-6)
    assert 4 <= saturated < len(SEEDS)


@pytest.mark.parametrize("seed", SEEDS)
def test_its_own_plan_is_a_guess_that_needs_one_iteration(seed):
    plan = solve(*instance(seed))
    again = solve(*instance(seed), guess=plan)
    assert again.iterations == 1
    assert again.residual < plan.residual
    np.testing.assert_allclose(again.forces / MASS, plan.forces / MASS, atol=0.02)


@pytest.mark.parametrize("spoil", [np.nan, 1e4])
def test_a_guess_that_leads_nowhere_is_followed_by_a_cold_start(spoil):
    cold = solve(*instance(0))
    guess = replace(cold, dual=cold.dual + spoil)
    plan = solve(*instance(0), guess=guess)
    assert np.array_equal(plan.forces, cold.forces)
    assert np.array_equal(states(plan), states(cold))
    assert plan.iterations > cold.iterations


@pytest.mark.parametrize("seed", SEEDS)
def test_plan_obeys_mechanics_and_contact(seed):
    """Momentum balance by differences of the plan; its norm is the residual reported."""
    contacts, x0, reference = instance(seed)
    plan = solve(contacts, x0, reference)
    c = plan.com
    v = plan.com_velocity
    L = plan.angular_momentum
    F = plan.forces
    h = contacts.dt[:, None]
    weight = MASS * np.array([0, 0, -9.81])
    linear = MASS * np.diff(v, axis=0) - h * (F.sum(axis=1) + weight)
    arm = contacts.position - c[:-1, None]
    angular = np.diff(L, axis=0) - h * np.cross(arm, F).sum(axis=1)
    motion = np.diff(c, axis=0) - h * v[1:]
    start = np.concatenate((c[0], v[0], L[0] / MASS)) - x0
    R = np.concatenate([a.ravel() for a in (linear / MASS, angular / MASS, motion, start)])
    assert np.linalg.norm(R) == pytest.approx(plan.residual, rel=1e-6)
    assert np.linalg.norm(R) < CONFIG.tolerance
    assert np.all(np.hypot(F[..., 0], F[..., 1]) <= FRICTION * F[..., 2] + 1e-6)
    assert np.all(F[~contacts.active] == 0.0)
    assert plan.iterations <= 30


def test_mirror_symmetry():
    """Left and right exchanged in the problem are exchanged in the plan."""
    flip = np.array([1, -1, 1])
    legs = [1, 0, 3, 2]
    state = np.concatenate((flip, flip, -flip))  # angular momentum is a pseudovector
    for seed in range(4):
        contacts, x0, reference = instance(seed)
        mirrored = ContactPlan(
            contacts.active[:, legs],
            contacts.position[:, legs] * flip,
            contacts.dt,
            contacts.via[:, legs],
        )
        plan = solve(contacts, x0, reference)
        other = solve(mirrored, x0 * state, reference * state)
        np.testing.assert_allclose(states(other), states(plan) * state, atol=1e-8)
        np.testing.assert_allclose(other.forces, plan.forces[:, legs] * flip, atol=1e-6)


def test_same_bits_whatever_was_solved_before():
    first = [solve(*instance(seed)) for seed in range(6)]
    again = [solve(*instance(seed)) for seed in reversed(range(6))][::-1]
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(states(a), states(b))
        assert np.array_equal(a.forces, b.forces)
        assert (a.residual, a.iterations) == (b.residual, b.iterations)


def test_flight():
    """Without stance feet there are no forces, and the robot falls; for long, that is no plan."""
    contacts, x0, reference = instance(1)
    active = contacts.active.copy()
    active[5:8] = False
    plan = solve(replace(contacts, active=active), x0, reference)
    assert plan.residual < 1e-3
    assert np.all(plan.forces[5:8] == 0.0)
    np.testing.assert_allclose(np.diff(plan.com_velocity[5:9, 2]), -9.81 * 0.05, atol=1e-3)
    plan = solve(replace(contacts, active=np.zeros_like(active)), x0, reference)
    assert np.all(plan.forces == 0.0)
    assert plan.residual > 1e-3  # a second of free fall is far from the reference: not converged
    assert np.all(np.isfinite(states(plan)))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("field", ["x0", "reference", "position", "dt", "mass", "friction"])
def test_input_that_is_not_finite(field, bad):
    contacts, x0, reference = instance(2)
    mass = MASS
    friction = FRICTION
    position = contacts.position.copy()
    dt = contacts.dt.copy()
    stance = np.argwhere(contacts.active)[4]
    if field == "mass":
        mass = bad
    elif field == "friction":
        friction = bad
    else:
        foot = position[*stance]  # a view
        {"x0": x0, "reference": reference, "position": foot, "dt": dt}[field].flat[2] = bad
    contacts = replace(contacts, position=position, dt=dt)
    problem = CentroidalProblem(contacts, x0, reference, mass, friction)
    plan = solve_centroidal(problem, CONFIG)
    if field == "friction" and bad > 0:
        assert np.all(np.isfinite(plan.forces))  # no friction limit is a problem like any other
    else:
        assert plan.residual == np.inf
        assert np.all(plan.forces == 0.0)


def test_wrong_shapes_are_named():
    contacts, x0, reference = instance(0)
    with pytest.raises(ValueError, match=r"\(21, 9\)"):
        solve(contacts, x0, reference[1:])


# The parts, against what they should equal.


def arrays_of(seed):
    contacts, x0, reference = instance(seed)
    rho = CONFIG.rho * np.repeat(centroidal.PENALTY, 3)
    return contacts, centroidal_steps.CentroidalArrays(
        contacts.active,
        FRICTION,
        contacts.position,
        contacts.dt,
        x0,
        reference,
        WEIGHT,
        np.array(CONFIG.force),
        rho,
    )


@pytest.mark.parametrize("seed", range(3))
def test_state_step_is_the_dense_least_squares_solution(seed):
    contacts, p = arrays_of(seed)
    rng = np.random.default_rng(seed)
    F = rng.normal(0, 4, (NODES, 4, 3)) * contacts.active[..., None]
    P = rng.normal(0, 0.01, (NODES + 1, 9))
    wrench = np.hstack((F.sum(axis=1), np.cross(contacts.position, F).sum(axis=1)))
    X = np.empty((NODES + 1, 9))
    centroidal_steps.state_step(X, wrench, P, p)

    # The violation is affine in the states: J X + r.
    size = X.size
    r = violation(np.zeros_like(X), F, contacts, p.x0).ravel()
    J = np.array(
        [violation(e.reshape(X.shape), F, contacts, p.x0).ravel() - r for e in np.eye(size)]
    ).T
    rho = np.tile(p.rho, NODES + 1)
    rho[-9:] = p.rho[0]  # the start is as stiff as the positions
    W = WEIGHT.ravel()
    rows = np.vstack((np.diag(np.sqrt(W)), np.sqrt(rho)[:, None] * J))
    right = np.concatenate((np.sqrt(W) * p.reference.ravel(), -np.sqrt(rho) * (r + P.ravel())))
    dense = np.linalg.lstsq(rows, right, rcond=None)[0]
    np.testing.assert_allclose(X.ravel(), dense, atol=1e-8)
    dual = P.copy()
    norm = centroidal_steps.dual_step(dual, X, wrench, 0.6, p)
    R = violation(X, F, contacts, p.x0)
    np.testing.assert_allclose(dual, P + 0.6 * R, atol=1e-12)
    assert norm == pytest.approx(np.linalg.norm(R))


@pytest.mark.parametrize("push", [0.0, 0.05, 0.5])
def test_force_step_is_the_constrained_least_squares_solution(push):
    """Node by node against SLSQP; a sideways dual pushes forces onto their cones."""
    contacts, p = arrays_of(1)
    X = np.tile(p.x0, (NODES + 1, 1))
    P = np.random.default_rng(0).normal(0, 0.02, (NODES + 1, 9))
    P[:, 3] += push
    F = np.zeros((NODES, 4, 3))
    wrench = np.empty((NODES, 6))
    centroidal_steps.force_step(F, wrench, X, P, p)
    np.testing.assert_allclose(wrench[:, 0:3], F.sum(axis=1), atol=1e-12)
    np.testing.assert_allclose(
        wrench[:, 3:6], np.cross(contacts.position, F).sum(axis=1), atol=1e-12
    )
    for t in (0, 4, 9):
        feet = np.flatnonzero(contacts.active[t])

        one = slice(t, t + 1)
        node = ContactPlan(
            active=contacts.active[one],
            position=contacts.position[one],
            dt=contacts.dt[one],
            via=contacts.via[one],
        )

        def objective(z, t=t, feet=feet, node=node):
            trial = np.zeros((1, 4, 3))
            trial[0, feet] = z.reshape(-1, 3)
            R = violation(X[t : t + 2], trial, node, p.x0)[0] + P[t]
            return (10.0 * z @ z + p.rho[3:] @ R[3:] ** 2) / 1e3

        def cones(z):
            f = z.reshape(-1, 3)
            square = (FRICTION * f[:, 2]) ** 2 - f[:, 0] ** 2 - f[:, 1] ** 2
            return np.concatenate((square, f[:, 2]))

        z = F[t, feet].ravel()
        assert np.all(cones(z) >= -1e-8)
        start = np.tile([0.0, 0.0, 5.0], len(feet))
        best = minimize(
            objective,
            start,
            method="SLSQP",
            constraints={"type": "ineq", "fun": cones},
            options={"ftol": 1e-14, "maxiter": 500},
        )
        assert objective(z) <= best.fun * (1 + 1e-7) + 1e-9
        np.testing.assert_allclose(z, best.x, atol=2e-2)


vectors = st.tuples(*(st.floats(-100, 100) for _ in range(3))).map(np.array)


@given(vectors, vectors, st.floats(0.05, 2.0))
def test_cone_projection_is_exact(f, g, mu):
    """Moreau: p in the cone and f - p in its polar, at right angles, make p the nearest point."""

    def project(x):
        x = x.copy()
        centroidal_steps.project_cones(x, mu)
        return x

    p = project(f)
    q = project(g)
    assert np.hypot(p[0], p[1]) <= mu * p[2] + 1e-9
    rest = f - p
    assert mu * np.hypot(rest[0], rest[1]) <= -rest[2] + 1e-9
    assert abs(p @ rest) < 1e-8
    np.testing.assert_allclose(project(p), p, atol=1e-9)
    assert np.linalg.norm(p - q) <= np.linalg.norm(f - g) + 1e-9
    inside = np.array([f[0], f[1], np.hypot(f[0], f[1]) / mu * 1.001 + 0.001])
    assert np.array_equal(project(inside), inside)


def test_cone_projection_known_points():
    z = np.array([3.0, 4.0, 0.0, 0.0, 0.0, -1.0, 0.1, 0.0, 1.0])
    centroidal_steps.project_cones(z, 1.0)
    np.testing.assert_allclose(z, [1.5, 2.0, 2.5, 0, 0, 0, 0.1, 0, 1.0])
