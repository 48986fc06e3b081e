"""The gate of one robot: the same table as that of the simulated ones."""

import numpy as np
import pytest

from surefoot.config import TABLE_I
from surefoot.deploy.gate import BoundsGate, GateSwitch
from surefoot.deploy.interfaces import BaseEstimate, Sensors
from surefoot.robots.bounds import table_bounds
from surefoot.robots.geometry import state_of
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.robots.rigid import center_of_mass, legs_of, masses_of
from surefoot.safety.gates import unsafe
from surefoot.types import Command


def test_it_calls_unsafe_what_the_table_of_the_simulation_does():
    robot = load_robot("solo12")
    config = TABLE_I
    rng = np.random.default_rng(0)
    q = np.tile(standing(robot), (500, 1))
    q[:, 2] += rng.normal(0.0, 0.05, 500)
    quat = np.concatenate([rng.normal(0.0, 0.15, (500, 3)), np.ones((500, 1))], axis=1)
    q[:, 3:7] = quat / np.linalg.norm(quat, axis=1)[:, None]
    q[:, 7:] += rng.normal(0.0, 0.1, (500, 12))
    expected = unsafe(state_of(robot, q, np.zeros((500, 18))), config)
    assert 0.2 < expected.mean() < 0.8

    def com_in_base(joints: np.ndarray) -> np.ndarray:
        placed = np.zeros((len(joints), 19))
        placed[:, 6] = 1.0
        placed[:, 7:] = joints
        return center_of_mass(placed, legs_of(robot), masses_of(robot))

    gate = BoundsGate(*table_bounds(config), com_in_base)
    assert [gate.unsafe(sensors_of(row)) for row in q] == expected.tolist()


@pytest.mark.parametrize("base", [None, BaseEstimate(0.0, np.zeros(3))])
def test_the_height_counts_where_something_measures_it(base):
    robot = load_robot("solo12")
    gate = BoundsGate(*table_bounds(TABLE_I), lambda joints: np.zeros((len(joints), 3)))
    sensors = sensors_of(standing(robot))._replace(base=base)
    assert gate.unsafe(sensors) == (base is not None)


def test_a_height_that_is_lost_is_warned_of_once(caplog):
    robot = load_robot("solo12")
    gate = BoundsGate(*table_bounds(TABLE_I), lambda joints: np.zeros((len(joints), 3)))
    switch = GateSwitch(gate, block=100)
    measured = sensors_of(standing(robot))
    switch.expert_drives(measured, 0, Command())
    assert caplog.text == ""
    for tick in range(3):
        switch.expert_drives(measured._replace(base=None), tick, Command())
        switch.reset()
    text = "the height of the base is not measured: while it is not"
    assert caplog.text.count(text) == 1
    switch.expert_drives(measured, 3, Command())
    switch.expert_drives(measured._replace(base=None), 4, Command())
    assert caplog.text.count(text) == 1


def sensors_of(q: np.ndarray) -> Sensors:
    """What a robot measures that stands still like this."""
    return Sensors(
        time_ns=0,
        sequence=0,
        joint_position=q[7:],
        joint_velocity=np.zeros(12),
        joint_torque=np.zeros(12),
        orientation=q[3:7],
        angular_velocity=np.zeros(3),
        acceleration=np.zeros(3),
        base=BaseEstimate(float(q[2]), np.zeros(3)),
    )
