"""States of a standing robot, turned and lifted by hand, for tests of gates."""

import numpy as np
import pinocchio as pin

from surefoot.types import State
from tests.fakes.robots import STANDING


def state_of(q, com_height: float | np.ndarray = 0.2):
    """States of robots at rest with these configurations, and a center of mass of that height."""
    q = np.atleast_2d(q)
    B = len(q)
    com = np.zeros((B, 3))
    com[:, 2] = com_height
    return State(q, np.zeros((B, 18)), com, np.zeros((B, 4, 3)), np.ones((B, 4), bool))


def turned_robot(roll=0.0, pitch=0.0, yaw=0.0, z=0.25):
    """The configuration of a robot turned by these angles [deg], its base at height z [m]."""
    q = STANDING.copy()
    R = pin.rpy.rpyToMatrix(*np.radians([roll, pitch, yaw]))
    q[2] = z
    q[3:7] = pin.Quaternion(R).coeffs()
    return q
