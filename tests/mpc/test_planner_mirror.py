"""The planner has no preference for a side: the plan of the mirror image is the mirrored plan."""

import numpy as np
import pinocchio as pin
import pytest

from surefoot.config import Config
from surefoot.evaluation.mirrors import make_mirror
from surefoot.robots.model import standing
from surefoot.types import Command
from tests.fakes.plans import MODEL, PLANNER, ROBOT, state_of


def thrown(seed):
    """A state away from rest, a tick, and a command."""
    rng = np.random.default_rng(seed)
    sigma = np.concatenate([[0, 0, 0.02], np.full(3, 0.15), np.full(12, 0.1)])
    q = pin.integrate(MODEL, standing(ROBOT), sigma * rng.normal(size=18))
    v = 0.2 * rng.normal(size=18)
    command = Command(*rng.uniform((-0.1, -0.1, -0.3), (0.3, 0.1, 0.3)))
    return state_of(q, v), 50 * int(rng.integers(0, 10)), command


@pytest.mark.parametrize(("name", "tolerance"), [("left_right", 1e-3), ("front_hind", 2e-2)])
@pytest.mark.parametrize("seed", range(8))
def test_the_plan_of_the_image_is_the_mirrored_plan(name, tolerance, seed):
    mirror = make_mirror(Config(), name)
    state, tick, command = thrown(seed)
    plan = PLANNER.plan(state, tick, command)
    image = PLANNER.plan(
        mirror.state(state), tick + mirror.shift, Command(*mirror.command(np.array(command)))
    )
    assert plan.valid and image.valid
    # [N m] on the first 50 ticks, after which a new plan replaces it; [rad] and [rad/s] beside it.
    torque = mirror.joint_values(plan.torque)[:50]
    np.testing.assert_allclose(image.torque[:50], torque, atol=tolerance, rtol=0)
    position = mirror.joint_values(plan.joint_position)[:50]
    np.testing.assert_allclose(image.joint_position[:50], position, atol=tolerance, rtol=0)
    # It is no accident of small torques: the unmirrored plan is another one.
    assert np.abs(image.torque[:50] - plan.torque[:50]).max() > 0.1
