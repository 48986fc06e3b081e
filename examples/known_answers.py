"""Print known answers: compare your installation, or your own implementation, with them."""

import numpy as np

import surefoot as sf
from surefoot.mpc.expert import make_planner
from surefoot.robots.geometry import state_of

robot = sf.solo12()
config = sf.with_own_values(sf.Config(), robot)
starts = sf.load_starts()
print("initial states:", starts.hash)

row = starts["test"][:1]
state = state_of(robot, row.q, row.v)[0]
command = sf.Command(*row.command[0].tolist())
plan = make_planner(robot, config).plan(state, int(row.tick[0]), command)
np.set_printoptions(precision=4, suppress=True)
print("torque [N m], first tick:", plan.torque[0])
print("joint angles [rad], tick 50:", plan.joint_position[50])
