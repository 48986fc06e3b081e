"""Let the expert walk on a robot of your own: a URDF, and a few lines that it does not say."""

from pathlib import Path

import numpy as np

import surefoot as sf
from surefoot.config import RobotConfig

config = sf.Config(robot=RobotConfig(model=str(Path(__file__).with_name("own_robot.toml"))))
robot = sf.load_robot(config.robot)
config = sf.with_own_values(config, robot)  # gains, heights and bounds follow from its size
print(f"{robot.name}: {robot.mass:.1f} kg, kp {config.expert.kp:.0f} N m/rad")

commands = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]])
starts = sf.at_rest(sf.standing(robot), commands)
simulator = sf.make_simulator(robot, batch=2, config=config.simulation)
episodes = sf.Episodes(starts, duration=2.0)
expert = sf.make_expert(robot, config)
rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), expert, safety=config.safety)
print(f"it went {rollouts.q[1, -1, 0] - rollouts.q[1, 0, 0]:.2f} m in 2 s")
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])
