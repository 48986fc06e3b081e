"""Contact-consistent perturbation: what must not move, what must, and what is refused."""

import itertools
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import TABLE_I, PerturbationConfig, RobotConfig, SafetyConfig
from surefoot.robots.geometry import lowest_points
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.perturbation import (
    acceptable,
    perturb,
    project,
    put_feet_back,
    stance_feet,
    stance_jacobian,
)

ROBOT = solo12()
DATA = ROBOT.model.createData()
STANDING = standing(ROBOT)
CONFIG = PerturbationConfig()
SAFETY = TABLE_I
ALL = np.ones(4, bool)
STANCES = [np.array(feet, bool) for feet in itertools.product([0, 1], repeat=4) if sum(feet) >= 2]


def foot_velocity(q, v):
    """``(4, 3)`` by differences, without any Jacobian."""
    ahead, behind = (
        stance_feet(ROBOT, DATA, pin.integrate(ROBOT.model, q, sign * 1e-6 * v), ALL)
        for sign in (1, -1)
    )
    return (ahead - behind) / 2e-6


def test_the_linear_velocity_of_the_base_may_deviate_by_its_own():
    def velocity(linear):
        config = PerturbationConfig(0.0, 0.0, 0.0, velocity=0.2, linear_velocity=linear)
        rng = np.random.default_rng(3)
        return perturb(ROBOT, lifted, np.zeros(18), ~ALL, config, SAFETY, rng)[1]

    lifted = STANDING.copy()
    lifted[2] += 0.1
    np.testing.assert_array_equal(velocity(0.2), velocity(None))
    np.testing.assert_allclose(velocity(0.3)[:3], 1.5 * velocity(None)[:3], atol=1e-12)
    np.testing.assert_allclose(velocity(0.3)[3:], velocity(None)[3:], atol=1e-12)


@pytest.mark.parametrize("stance", STANCES, ids=str)
def test_stance_feet_stay_and_stand_still_and_the_rest_changes(stance):
    rng = np.random.default_rng(5)
    before = stance_feet(ROBOT, DATA, STANDING, ALL)
    v = rng.normal(0.0, 0.3, 18)  # the feet of the state itself slip
    q, velocity = perturb(ROBOT, STANDING, v, stance, CONFIG, SAFETY, rng)
    moved = np.linalg.norm(stance_feet(ROBOT, DATA, q, ALL) - before, axis=1)
    assert moved[stance].max() < 1e-9
    assert moved[~stance].min(initial=1.0) > 1e-3
    J = stance_jacobian(ROBOT, DATA, q, stance)
    assert np.abs(J @ velocity).max() < 1e-9
    slip = np.linalg.norm(foot_velocity(q, velocity), axis=1)
    assert slip[stance].max() < 1e-8
    assert slip[~stance].min(initial=1.0) > 1e-3
    # Base and joints are somewhere else, and moving.
    assert np.linalg.norm(q[:3] - STANDING[:3]) > 1e-3
    assert np.linalg.norm(q[3:6]) > 1e-3
    assert np.abs(q[7:] - STANDING[7:]).min() > 1e-6
    assert np.linalg.norm(velocity[:6]) > 1e-2
    assert np.linalg.norm(q[3:7]) == pytest.approx(1.0, abs=1e-12)


def test_perturbed_states_are_acceptable():
    rng = np.random.default_rng(1)
    for stance in STANCES[:4]:
        q, _ = perturb(ROBOT, STANDING, np.zeros(18), stance, CONFIG, SAFETY, rng)
        assert acceptable(ROBOT, DATA, q, CONFIG, SAFETY)


def test_jacobian_is_the_derivative_of_the_feet():
    rng = np.random.default_rng(2)
    q = pin.integrate(ROBOT.model, STANDING, rng.normal(0, 0.3, 18))
    v = rng.normal(size=18)
    J = stance_jacobian(ROBOT, DATA, q, ALL)
    np.testing.assert_allclose((J @ v).reshape(4, 3), foot_velocity(q, v), atol=1e-8)
    two_feet = np.array([False, True, False, True])
    np.testing.assert_array_equal(
        stance_jacobian(ROBOT, DATA, q, two_feet), J.reshape(4, 3, 18)[two_feet].reshape(6, 18)
    )


def test_projection_is_the_orthogonal_one():
    J = stance_jacobian(ROBOT, DATA, STANDING, np.array([True, False, False, True]))
    rng = np.random.default_rng(0)
    change, other = rng.normal(size=(2, 18))
    kept = project(J, change)
    np.testing.assert_allclose(J @ kept, 0.0, atol=1e-12)
    np.testing.assert_allclose(project(J, kept), kept, atol=1e-12)
    assert (change - kept) @ project(J, other) == pytest.approx(0.0, abs=1e-12)


def test_a_robot_in_the_air_is_perturbed_freely():
    q0 = STANDING.copy()
    q0[2] = 1.0
    rng = np.random.default_rng(4)
    draw = np.random.default_rng(4).standard_normal(36)
    q, v = perturb(
        ROBOT, q0, np.zeros(18), ~ALL, PerturbationConfig(base_orientation=0.1), SAFETY, rng
    )
    sigma = np.repeat([0.1, 0.1, 0.2], [3, 3, 12])
    np.testing.assert_allclose(pin.difference(ROBOT.model, q0, q), sigma * draw[:18], atol=1e-9)
    np.testing.assert_allclose(v, 0.2 * draw[18:], atol=1e-12)


class Recorder:
    """A source of randomness that keeps what it gave."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.draws = []

    def standard_normal(self, size):
        self.draws.append(self.rng.standard_normal(size))
        return self.draws[-1]


def test_sigmas_hold_before_the_projection(monkeypatch):
    """Every draw is white; sigmas multiply it group by group; only then comes the projection."""
    handed_over = []
    monkeypatch.setattr(
        "surefoot.scenarios.perturbation.project",
        lambda J, change: handed_over.append(change) or project(J, change),
    )
    config = PerturbationConfig(0.03, 0.05, 0.07, 0.11)
    recorder = Recorder(0)
    v = np.full(18, 0.5)
    for _ in range(60):
        perturb(ROBOT, STANDING, v, ALL, config, SAFETY, recorder)  # pyright: ignore[reportArgumentType]
    accepted = [change for change in handed_over if change.mean() > 0.25]
    tried = [change for change in handed_over if change.mean() <= 0.25]
    assert len(accepted) == 60
    assert len(tried) == len(recorder.draws) / 2 >= 60
    sigma = np.repeat([0.03, 0.05, 0.07], [3, 3, 12])
    np.testing.assert_allclose(tried, sigma * np.array(recorder.draws[::2]), atol=1e-15)
    deviation = (np.array(accepted) - v).std()
    assert deviation == pytest.approx(0.11, rel=0.1)


def test_the_same_seed_gives_the_same_state_and_another_does_not():
    stance = np.array([True, False, False, True])

    def perturbed(seed):
        rng = np.random.default_rng(seed)
        return np.concatenate(perturb(ROBOT, STANDING, np.zeros(18), stance, CONFIG, SAFETY, rng))

    np.testing.assert_array_equal(perturbed(3), perturbed(3))
    assert not np.allclose(perturbed(3), perturbed(4))


def test_the_state_that_is_perturbed_is_left_as_it_was():
    q = STANDING.copy()
    v = np.ones(18)
    perturb(ROBOT, q, v, ALL, CONFIG, SAFETY, np.random.default_rng(0))
    np.testing.assert_array_equal(q, STANDING)
    np.testing.assert_array_equal(v, 1.0)


def test_a_state_without_acceptable_neighbors_is_an_error(monkeypatch):
    monkeypatch.setattr("surefoot.scenarios.perturbation.ATTEMPTS", 20)
    with pytest.raises(
        ValueError, match=r"no acceptable initial state in 20 draws.*standard deviations"
    ):
        # Nothing is acceptable where the fall bounds are empty.
        never = SafetyConfig(fall_height=(0.5, 0.5))
        perturb(ROBOT, STANDING, np.zeros(18), ALL, CONFIG, never, np.random.default_rng(0))


def rolled(roll=0.0, pitch=0.0, z=0.0):
    q = STANDING.copy()
    q[2] += z
    R = pin.rpy.rpyToMatrix(np.radians(roll), np.radians(pitch), 0.7)
    q[3:7] = pin.Quaternion(R).coeffs()
    return q


def test_feet_may_sink_two_millimeters_into_the_ground_and_no_deeper():
    assert acceptable(ROBOT, DATA, rolled(z=-0.0019), CONFIG, SAFETY)
    assert not acceptable(ROBOT, DATA, rolled(z=-0.0021), CONFIG, SAFETY)
    deep = PerturbationConfig(max_penetration=0.01)
    assert acceptable(ROBOT, DATA, rolled(z=-0.009), deep, SAFETY)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
@pytest.mark.parametrize("sign", [-1, 1])
def test_a_fallen_robot_is_not_acceptable(axis, sign):
    assert acceptable(ROBOT, DATA, rolled(**{axis: sign * 29.5}, z=0.5), CONFIG, SAFETY)
    assert not acceptable(ROBOT, DATA, rolled(**{axis: sign * 30.5}, z=0.5), CONFIG, SAFETY)


def test_base_heights_outside_the_fall_bounds_are_not_acceptable():
    assert acceptable(ROBOT, DATA, rolled(z=1.99 - STANDING[2]), CONFIG, SAFETY)
    assert not acceptable(ROBOT, DATA, rolled(z=2.01 - STANDING[2]), CONFIG, SAFETY)
    folded = STANDING.copy()
    folded[7:] = np.tile([0.0, 1.4, -2.8], 4) * np.repeat([1, 1, -1, -1], 3)
    folded[2] = 0.09
    loose = PerturbationConfig(max_penetration=1.0)
    feet, rest = lowest_points(ROBOT, DATA, folded)
    assert rest.min() > 0  # the height alone is what is wrong
    assert not acceptable(ROBOT, DATA, folded, loose, SAFETY)
    assert acceptable(ROBOT, DATA, folded, loose, SafetyConfig(fall_height=(0.08, 2.0)))
    assert feet.min() < rest.min()


def test_nothing_but_feet_may_touch_the_ground():
    kneeling = STANDING.copy()
    kneeling[7 + 1 : 7 + 3] = [np.pi / 2, -np.pi / 2 - 1.2]  # a front leg with its knee low
    loose = PerturbationConfig(max_penetration=1.0)
    kneeling[2] = 0.3
    _, rest = lowest_points(ROBOT, DATA, kneeling)
    kneeling[2] += 1e-4 - rest.min()
    assert acceptable(ROBOT, DATA, kneeling, loose, SafetyConfig(fall_height=(0.0, 2.0)))
    kneeling[2] -= 2e-4
    assert not acceptable(ROBOT, DATA, kneeling, loose, SafetyConfig(fall_height=(0.0, 2.0)))


def test_feet_that_cannot_come_back_are_given_up():
    contacts = stance_feet(ROBOT, DATA, STANDING, ALL)
    contacts[0, 0] += 2.0  # out of reach of any leg while the others hold the base
    assert put_feet_back(ROBOT, DATA, STANDING, contacts, ALL) is None


def test_a_foot_that_touched_down_deep_does_not_forbid_all_neighbors():
    """The simulation had put it there, and it stays there whatever is drawn."""
    q = rolled(z=-0.0025)
    assert not acceptable(ROBOT, DATA, q, CONFIG, SAFETY)
    assert acceptable(ROBOT, DATA, q, CONFIG, SAFETY, np.ones(4, bool))
    assert not acceptable(ROBOT, DATA, q, CONFIG, SAFETY, np.array([True, True, True, False]))
    rng = np.random.default_rng(0)
    moved, _ = perturb(ROBOT, q, np.zeros(18), np.ones(4, bool), CONFIG, SAFETY, rng)
    assert (moved[7:] != q[7:]).all()


def test_joints_within_their_limits_stay_there():
    """Where the state itself is beyond them, its neighbors may be, too."""
    limit = np.full((12, 2), (-np.inf, np.inf))
    limit[1] = STANDING[8] - 0.05, STANDING[8] + 0.05
    limited = replace(ROBOT, position_limit=limit)
    rng = np.random.default_rng(3)
    in_the_air = STANDING.copy()
    in_the_air[2] += 0.2

    def bent(q):
        return np.array(
            [perturb(limited, q, np.zeros(18), ~ALL, CONFIG, SAFETY, rng)[0][8] for _ in range(30)]
        )

    assert np.abs(bent(in_the_air) - STANDING[8]).max() <= 0.05
    beyond = in_the_air.copy()
    beyond[8] += 0.06
    assert np.abs(bent(beyond) - STANDING[8]).max() > 0.05


def test_with_a_hardware_profile_joints_beyond_its_ranges_are_not_acceptable():
    limited = load_robot(RobotConfig(profile="odri"))
    inside = STANDING.copy()
    inside[2] += 0.1
    beyond = inside.copy()
    beyond[7] = 0.95  # ODRI allows 0.9 rad
    for robot, q, expected in (
        (ROBOT, inside, True),
        (ROBOT, beyond, True),
        (limited, inside, True),
        (limited, beyond, False),
    ):
        assert acceptable(robot, DATA, q, CONFIG, SAFETY) == expected
