"""What is said of a motion beyond the limits of a robot's joints; nothing of one within them."""

import numpy as np

from surefoot.robots.limits_used import range_remark, speed_remark, speed_shares
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing

GO2 = load_robot("go2")
SOLO12 = load_robot("solo12")


def test_a_motion_within_the_limits_or_without_any_is_not_remarked():
    for robot in (GO2, SOLO12):
        assert range_remark(robot, standing(robot)) == ""
        assert speed_remark(robot, np.ones((5, 18))) == ""
    assert speed_remark(SOLO12, np.full((5, 18), 1e3)) == ""
    assert not speed_shares(SOLO12, np.full((5, 18), 1e3)).any()


def test_the_joint_farthest_beyond_its_limits_is_named():
    q = np.tile(standing(GO2), (4, 2, 1))
    q[0, 0, 7] = 1.2
    q[1, 1, 7 + 2] = 1.44  # a wrong sign
    said = range_remark(GO2, q)
    assert said.startswith("in 25 % of the time a joint is beyond its position limits")
    assert "FL_KFE ('FL_calf_joint' in the URDF) at 1.44 rad, where -2.72 to -0.84 are" in said
    v = np.zeros((4, 2, 18))
    v[2, 1, 6] = 33.0
    v[3, 0, 6 + 5] = -2 * 15.7
    assert speed_shares(GO2, v).max() == 2.0
    assert speed_remark(GO2, v).startswith(
        "FR_KFE ('FR_calf_joint' in the URDF) turns at up to 200"
    )
