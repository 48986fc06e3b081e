"""Contact-consistent perturbation of a robot's state (paper, III-B; Khadiv et al., 2023).

A random change of configuration is projected onto the null space of the stance feet's Jacobian and
corrected until those feet are back in place; a random change of velocity is projected at the new
configuration, so that no stance foot moves. States that touch the ground with anything but the
feet, have fallen already, or bend a joint beyond its limits are drawn again. Next:
`surefoot.scenarios.make`, which perturbs whole sets.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from surefoot.config import PerturbationConfig, SafetyConfig
from surefoot.robots.bounds import fallen
from surefoot.robots.geometry import lowest_points
from surefoot.robots.model import RobotModel
from surefoot.robots.profile import beyond_range, position_limits
from surefoot.scenarios.walking import GaitError
from surefoot.types import Array, BoolArray

ATTEMPTS = 1000
"""The number of draws after which a state is given up."""


def perturb(
    robot: RobotModel,
    q: Array,
    v: Array,
    stance: BoolArray,
    config: PerturbationConfig,
    safety: SafetyConfig,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """A random neighbor of a state, with the stance feet in place and at rest.

    Args:
        robot: The model of the robot.
        q: ``(19,)`` configuration [m, unit quaternion, rad].
        v: ``(18,)`` velocity [m/s, rad/s].
        stance: ``(4,)`` True for the feet that are on the ground.
        config: Standard deviations before the projection.
        safety: The fall bounds; a neighbor beyond them is drawn again. One with a joint beyond the
            robot's limits is drawn again, too, if the state itself is within the limits.
        rng: The source of randomness.

    Returns:
        ``(19,)`` configuration and ``(18,)`` velocity.

    Raises:
        GaitError: No draw was acceptable; the perturbation is too large for this state.
    """
    sigma = np.concatenate(
        [
            np.full(3, config.base_position),
            np.full(3, config.base_orientation),
            np.full(12, config.joint_position),
        ]
    )
    linear = config.velocity if config.linear_velocity is None else config.linear_velocity
    velocity_sigma = np.concatenate([np.full(3, linear), np.full(15, config.velocity)])
    data = robot.model.createData()
    contacts = stance_feet(robot, data, q, stance)
    was_within = not beyond_range(robot.position_limit, q)
    J = stance_jacobian(robot, data, q, stance)
    for _ in range(ATTEMPTS):
        change = project(J, sigma * rng.standard_normal(18))
        moved = pin.integrate(robot.model, q, change)
        velocity = v + velocity_sigma * rng.standard_normal(18)
        moved = put_feet_back(robot, data, moved, contacts, stance)
        if moved is None or not acceptable(robot, data, moved, config, safety, stance):
            continue
        if was_within and beyond_range(robot.position_limit, moved):
            continue
        return moved, project(stance_jacobian(robot, data, moved, stance), velocity)
    raise GaitError(
        f"no acceptable initial state in {ATTEMPTS} draws: each one had fallen, touched the ground "
        "with more than its feet, or bent a joint beyond its limits"
        f"{'' if robot.profile is None else ' or those of the hardware profile'}; lower the "
        f"standard deviations ({config})"
    )


def stance_jacobian(robot: RobotModel, data: pin.Data, q: Array, stance: BoolArray) -> Array:
    """``(3 n, 18)`` translational Jacobian of the n stance feet, world axes."""
    pin.computeJointJacobians(robot.model, data, q)
    rows = []
    for foot in np.array(robot.feet)[stance]:
        pin.updateFramePlacement(robot.model, data, int(foot))
        rows.append(pin.getFrameJacobian(robot.model, data, int(foot), pin.LOCAL_WORLD_ALIGNED)[:3])
    return np.concatenate([np.empty((0, 18)), *rows])


def stance_feet(robot: RobotModel, data: pin.Data, q: Array, stance: BoolArray) -> Array:
    """``(n, 3)`` positions of the n stance feet [m]."""
    pin.framesForwardKinematics(robot.model, data, q)
    feet = np.array([data.oMf[foot].translation for foot in robot.feet])
    return feet[stance]


def project(J: Array, change: Array) -> Array:
    """``(18,)`` part of a tangent vector that does not move the feet: (I - J^+ J) change."""
    return change - np.linalg.pinv(J) @ (J @ change)


def put_feet_back(
    robot: RobotModel, data: pin.Data, q: Array, contacts: Array, stance: BoolArray
) -> Array | None:
    """The configuration with the stance feet back at ``(n, 3)`` contacts [m], by Newton steps.

    It is None if the steps do not converge.
    """
    for _ in range(20):
        error = (contacts - stance_feet(robot, data, q, stance)).ravel()
        if np.linalg.norm(error) < 1e-10:
            return q
        J = stance_jacobian(robot, data, q, stance)
        q = pin.integrate(robot.model, q, np.linalg.pinv(J) @ error)
    return None


def acceptable(
    robot: RobotModel,
    data: pin.Data,
    q: Array,
    config: PerturbationConfig,
    safety: SafetyConfig,
    stance: BoolArray | None = None,
) -> bool:
    """True if only feet meet the ground, not too deep, and the robot has not fallen.

    Args:
        robot: The model of the robot; with a hardware profile, joints have to be within its ranges.
        data: Its data.
        q: ``(19,)`` configuration [m, unit quaternion, rad].
        config: How deep a foot may be in the ground.
        safety: The fall bounds.
        stance: ``(4,)`` True for feet whose depth is not checked: those that are still where the
            simulation put them, which is deeper at a touchdown.
    """
    feet, rest = lowest_points(robot, data, q)
    if stance is not None:
        feet = feet[~stance]
    if robot.profile is not None and beyond_range(position_limits(robot.profile), q):
        return False
    return bool(
        feet.min(initial=np.inf) >= -config.max_penetration
        and rest.min() > 0.0
        and not fallen(q[None], safety)[0]
    )
