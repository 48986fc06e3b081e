"""Let your own MPC drive twenty robots: it is a function that returns arrays."""

import numpy as np

import surefoot as sf

robot = sf.solo12()


def plan(state: sf.State, tick: int, command: sf.Command) -> sf.MotionPlan:
    """Plan 100 ticks of 1 ms for one robot: q (19,), v (18,), com (3,), feet (4, 3), contacts (4,).

    Called every 50 ms and at takeovers; tick [ms] is the gait clock, command vx, vy, yaw_rate.
    """
    angles = np.tile(robot.nominal[7:], (100, 1))  # [rad]; yours come from a solver
    rates = np.zeros((100, 12))  # [rad/s]
    torques = np.zeros((100, 12))  # feed-forward [N m]
    return sf.MotionPlan(angles, rates, torques, valid=True)


simulator = sf.make_simulator(robot, batch=20)
episodes = sf.Episodes(sf.load_starts()["nominal"][:20], duration=2.0)
expert = sf.Expert(plan, kp=3.0, kd=0.05)  # torques + kp (angles - q) + kd (rates - v)
rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), expert)
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])  # STALLED: it only stands
