"""What tests of the planner share: one planner of the default configuration, states, plans."""

import numpy as np
import pinocchio as pin

from surefoot.config import ExpertConfig, Gait, SimulationConfig
from surefoot.mpc.planner import Planner
from surefoot.robots.solo12 import solo12
from surefoot.types import Command, State

ROBOT = solo12()
MODEL = ROBOT.model
FRICTION = SimulationConfig().friction
FORWARD = Command(0.2, 0.05, 0.1)


def planner(robot=ROBOT) -> Planner:
    return Planner(robot, Gait(), ExpertConfig(), FRICTION)


PLANNER = planner()


def state_of(q, v) -> State:
    data = MODEL.createData()
    com = pin.centerOfMass(MODEL, data, q).copy()
    pin.framesForwardKinematics(MODEL, data, q)
    feet = np.array([data.oMf[foot].translation for foot in ROBOT.feet])
    return State(q, v, com, feet, np.ones(4, bool))


def arrays(plan):
    return plan.joint_position, plan.joint_velocity, plan.torque


def same_bits(plan, other) -> bool:
    return plan.valid == other.valid and all(
        a.tobytes() == b.tobytes() for a, b in zip(arrays(plan), arrays(other), strict=True)
    )
