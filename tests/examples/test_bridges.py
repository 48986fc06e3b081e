"""The bridges of the examples, with fakes in the place of the vendors' drivers."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

from surefoot.deploy import bridge, protocol

FOLDER = Path(__file__).parents[2] / "examples" / "bridges"
SDK = {
    "unitree_sdk2py.core.channel": (
        "ChannelFactoryInitialize",
        "ChannelPublisher",
        "ChannelSubscriber",
    ),
    "unitree_sdk2py.idl.default": ("unitree_go_msg_dds__LowCmd_",),
    "unitree_sdk2py.idl.unitree_go.msg.dds_": ("LowCmd_", "LowState_"),
    "unitree_sdk2py.utils.crc": ("CRC",),
}
"""What the example imports of Unitree's SDK."""


class Anything:
    """Stands for a class or a function of the SDK: it takes everything, and keeps what it sends."""

    def __init__(self, *args):
        self.head = [0, 0]
        self.motor_cmd = [SimpleNamespace() for _ in range(20)]
        self.sent = []

    def Init(self, *args):
        pass

    def Crc(self, command):
        return 7

    def Write(self, command):
        self.sent.append(command)


@pytest.fixture
def go2(monkeypatch):
    """The names of the example for Go2, its driver made without a robot."""
    monkeypatch.setitem(sys.modules, "bridge", bridge)
    monkeypatch.setitem(sys.modules, "protocol", protocol)
    for name, members in SDK.items():
        module = ModuleType(name)
        vars(module).update(dict.fromkeys(members, Anything))
        monkeypatch.setitem(sys.modules, name, module)
    return SimpleNamespace(**runpy.run_path(str(FOLDER / "go2_unitree.py"), run_name="go2"))


class Odri:
    """Stands for ODRI's robot; what is set is kept by the name of its setter."""

    def __init__(self):
        self.sent = {}
        self.has_error = False
        self.joints = self
        self.positions = np.arange(12.0)
        self.velocities = np.zeros(12)
        self.measured_torques = np.zeros(12)
        self.imu = SimpleNamespace(
            attitude_quaternion=np.array([0.0, 0.0, 0.0, 1.0]),
            gyroscope=np.zeros(3),
            accelerometer=np.array([0.0, 0.0, 9.81]),
        )

    def __getattr__(self, name):
        return lambda *values: self.sent.__setitem__(name, [list(value) for value in values])


@pytest.fixture
def solo12(monkeypatch):
    """The names of the example for Solo12, and the robot that its driver finds."""
    robot = Odri()
    monkeypatch.setitem(sys.modules, "bridge", bridge)
    monkeypatch.setitem(sys.modules, "protocol", protocol)
    module = ModuleType("libodri_control_interface_pywrap")
    vars(module)["robot_from_yaml_file"] = lambda file: robot
    monkeypatch.setitem(sys.modules, module.__name__, module)
    return robot, SimpleNamespace(
        **runpy.run_path(str(FOLDER / "solo12_odri.py"), run_name="solo12")
    )


def low_state():
    """A state of Go2 that stands."""
    motor = SimpleNamespace(q=0.1, dq=0.0, tau_est=0.0)
    imu = SimpleNamespace(
        quaternion=(1.0, 0.0, 0.0, 0.0), gyroscope=[0.0] * 3, accelerometer=[0.0, 0.0, 9.81]
    )
    return SimpleNamespace(motor_state=[motor] * 12, imu_state=imu)


def test_a_go2_that_has_gone_silent_is_an_error_and_not_its_last_state(go2, monkeypatch):
    now = [50.0]
    monkeypatch.setattr("time.monotonic", lambda: now[0])
    driver = go2.Driver("eth0")
    with pytest.raises(OSError, match="no state yet"):
        driver.read()
    driver.receive(low_state())
    now[0] += 0.5 * go2.SILENT
    assert driver.read().orientation == (0.0, 0.0, 0.0, 1.0)
    now[0] += 0.6 * go2.SILENT
    with pytest.raises(OSError, match="no state for 22 ms"):
        driver.read()
    driver.receive(low_state())
    assert driver.read().joint_position == [0.1] * 12


def test_every_motor_of_a_go2_gets_the_command_of_its_joint(go2):
    driver = go2.Driver("eth0")
    driver.write(range(60))
    assert driver.publisher.sent == [driver.command]
    assert driver.command.crc == 7
    for joint, name in enumerate(go2.JOINTS):
        leg = ("FR", "FL", "HR", "HL").index(name[:2])  # as Unitree counts
        motor = driver.command.motor_cmd[3 * leg + joint % 3]
        values = [motor.q, motor.dq, motor.kp, motor.kd, motor.tau]
        assert values == [joint, 12 + joint, 24 + joint, 36 + joint, 48 + joint]


def test_a_solo12_behind_a_bridge_is_read_and_damped(solo12):
    robot, names = solo12
    served = bridge.Bridge(names.Driver("solo12.yaml"), bridge.UdpChannel(), names.DESCRIPTION)
    robot.sent.clear()
    served.tick()
    served.close()
    assert robot.sent["set_position_gains"][-1] == [0.0] * 12
    assert robot.sent["set_velocity_gains"][-1] == [0.2] * 12
    assert robot.sent["set_torques"][-1] == [0.0] * 12
    assert "send_command" in robot.sent
    assert names.Driver("solo12.yaml").read().joint_position == list(range(12))
