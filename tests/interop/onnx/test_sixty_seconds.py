"""A minute in the simulator: the exported pipeline walks as the policy that it was made of."""

import numpy as np
import pytest

from surefoot.config import Config
from surefoot.deploy.export_file import read_export
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.interop.onnx.runner import PipelineRunner
from surefoot.learning.policy import load, pd
from surefoot.runs.policies import PACKAGED_POLICY
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from surefoot.types import Command
from tests.fakes.exports import exported, robot_of

SECONDS = 60
WARM_UP = 1_000  # ticks that are not counted: the robots begin in the gait of the expert


@pytest.fixture(scope="module")
def starts():
    """Two speeds of the settled gait."""
    nominal = load_starts()["nominal"]
    return nominal[np.linspace(10, len(nominal) - 1, 2).astype(int)]


def walk(torques, starts):
    """Speeds in the forward direction ``(ticks, B)`` [m/s], and the smallest height of each base.

    Args:
        torques: What gives the torques ``(B, 12)`` for a state and a tick.
        starts: Where the robots begin.
    """
    simulator = make_simulator(robot_of(), len(starts), Config().simulation)
    simulator.reset(starts.q, starts.v)
    speed = []
    lowest = np.full(len(starts), np.inf)
    for tick in range(SECONDS * 1000):
        state = simulator.state
        simulator.step(torques(state, starts.tick + tick))
        speed.append(state.v[:, 0].copy())
        lowest = np.minimum(lowest, state.q[:, 2])
    return np.array(speed), lowest


def sensors_of(state, row, tick):
    """What a robot would measure that also knows height and velocity of its base."""
    return Sensors(
        time_ns=tick * 1_000_000,
        sequence=tick,
        joint_position=state.q[row, 7:],
        joint_velocity=state.v[row, 6:],
        joint_torque=np.zeros(12),
        orientation=state.q[row, 3:7],
        angular_velocity=state.v[row, 3:6],
        acceleration=np.zeros(3),
        base=BaseEstimate(float(state.q[row, 2]), state.v[row, :3]),
    )


@pytest.mark.slow
def test_a_minute_of_the_pipeline_has_the_outcome_and_the_speed_of_the_policy(tmp_path, starts):
    policy = load(PACKAGED_POLICY)
    path, _ = exported(tmp_path, kind="pipeline", policy=policy)
    runners = [PipelineRunner(read_export(path)) for _ in range(len(starts))]
    limit = robot_of().torque_limit

    def from_policy(state, tick):
        target = policy.target(state, tick, starts.command)
        return np.clip(pd(target, state.q, state.v, policy.spec), -limit, limit)

    def from_pipeline(state, tick):
        target = np.empty((len(starts), 12))
        for row, runner in enumerate(runners):
            command = Command(*starts.command[row].tolist())
            target[row] = runner.run(
                sensors_of(state, row, int(tick[row])), int(tick[row]), command
            )[0]
        return np.clip(pd(target, state.q, state.v, policy.spec), -limit, limit)

    policy.reset(len(starts))
    speed, lowest = walk(from_policy, starts)
    speed_too, lowest_too = walk(from_pipeline, starts)
    assert (lowest > 0.15).all() and (lowest_too > 0.15).all()  # nobody fell
    mean = speed[WARM_UP:].mean(0)
    mean_too = speed_too[WARM_UP:].mean(0)
    np.testing.assert_allclose(mean_too, mean, rtol=0.01)
