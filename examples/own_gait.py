"""Let the expert walk in a gait of your own: a gait is its timing."""

from dataclasses import replace

import numpy as np

import surefoot as sf
from surefoot.config import Gait

# Hind left, front left, hind right, front right, a quarter of the period apart.
gait = Gait(period=0.8, duty=0.7, offsets=(0.75, 0.25, 0.0, 0.5))
robot = sf.solo12()
# With command gains of 1: `surefoot prepare` measures those with which it is as fast as it is told.
config = sf.with_own_values(replace(sf.Config(), gait=gait), robot)

commands = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.2, 0.0, 0.0]])
starts = sf.at_rest(sf.standing(robot), commands)
simulator = sf.make_simulator(robot, batch=3)
expert = sf.make_expert(robot, config)
rollouts = sf.rollout(simulator, sf.Episodes(starts, duration=3.0), sf.ExpertOnly(), expert)

speed = (rollouts.q[:, -1, 0] - rollouts.q[:, 0, 0]) / 3.0
for command, reached in zip(commands[:, 0], speed, strict=True):
    print(f"told {command:.1f} m/s: {reached:.2f} m/s")
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])
