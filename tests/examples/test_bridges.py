"""The bridges of the examples, with fakes in the place of the vendors' drivers."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

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
    """Stands for a class or a function of the SDK: it takes everything, and has a head."""

    def __init__(self, *args):
        self.head = [0, 0]

    def Init(self, *args):
        pass


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
