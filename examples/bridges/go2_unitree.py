"""A bridge for Go2 with unitree_sdk2py. NOT RUN: there was no robot and no driver here.

Copy this file, `bridge.py` and `protocol.py` (from src/surefoot/deploy) into one folder of the
SDK's environment. Switch the robot's own motion service off first, or two programs command the
motors. Run it with the name of the interface that leads to the robot:

    python go2_unitree.py eth0

Check before the motors are on: names, order, signs and zero of the joints; that the orientation is
xyzw and turns base into world; that the gyroscope is in the base frame.
"""

from __future__ import annotations  # for Python 3.8

import sys
import time
from collections.abc import Sequence

import bridge  # pyright: ignore
import protocol  # pyright: ignore
from unitree_sdk2py.core.channel import (  # pyright: ignore
    ChannelFactoryInitialize,
    ChannelPublisher,
    ChannelSubscriber,
)
from unitree_sdk2py.idl.default import unitree_go_msg_dds__LowCmd_  # pyright: ignore
from unitree_sdk2py.idl.unitree_go.msg.dds_ import LowCmd_, LowState_  # pyright: ignore
from unitree_sdk2py.utils.crc import CRC  # pyright: ignore

JOINTS = tuple(
    f"{leg}_{joint}" for leg in ("FL", "FR", "HL", "HR") for joint in ("HAA", "HFE", "KFE")
)
"""surefoot's order."""
MOTORS = (3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8)
"""The motor of each of these joints: Unitree counts FR, FL, RR, RL."""
SILENT = 0.02
"""[s] Maximum time without a state, of which the robot sends 500 a second."""
DESCRIPTION = protocol.Description(
    robot="go2",
    joints=JOINTS,
    rate_hz=1000,
    command_timeout=0.02,
    command_age=0.02,
    state_timeout=0.02,
    damping=3.0,
    # The limits of the robot's URDF.
    position_low=(-1.0472, -1.5708, -2.7227) * 2 + (-1.0472, -0.5236, -2.7227) * 2,
    position_high=(1.0472, 3.4907, -0.83776) * 2 + (1.0472, 4.5379, -0.83776) * 2,
    speed=(30.1, 30.1, 15.7) * 4,
    torque=(23.7, 23.7, 45.43) * 4,
)


class Driver:
    """All calls into Unitree's SDK."""

    def __init__(self, interface: str) -> None:
        ChannelFactoryInitialize(0, interface)
        self.newest = None
        self.command = unitree_go_msg_dds__LowCmd_()
        self.command.head[0] = 0xFE
        self.command.head[1] = 0xEF
        self.command.level_flag = 0xFF
        self.crc = CRC()
        self.publisher = ChannelPublisher("rt/lowcmd", LowCmd_)
        self.publisher.Init()
        subscriber = ChannelSubscriber("rt/lowstate", LowState_)
        subscriber.Init(self.receive, 1)
        self.subscriber = subscriber

    def receive(self, state: LowState_) -> None:
        """Keep the newest state and its time; the SDK calls this in a thread of its own."""
        self.newest = (state, time.monotonic())

    def read(self) -> bridge.Measurement:
        """What the robot measures; a robot that has gone silent is a fault, not its last state."""
        if self.newest is None:
            raise OSError("the robot has sent no state yet")
        state, received = self.newest
        silent = time.monotonic() - received
        if silent > SILENT:
            raise OSError(f"the robot has sent no state for {1e3 * silent:.0f} ms")
        motors = [state.motor_state[number] for number in MOTORS]
        w, x, y, z = state.imu_state.quaternion
        return bridge.Measurement(
            joint_position=[motor.q for motor in motors],
            joint_velocity=[motor.dq for motor in motors],
            joint_torque=[motor.tau_est for motor in motors],
            orientation=(x, y, z, w),
            angular_velocity=list(state.imu_state.gyroscope),
            acceleration=list(state.imu_state.accelerometer),
        )

    def write(self, command: Sequence[float]) -> None:
        """Publish a command for the twelve motors."""
        for joint, number in enumerate(MOTORS):
            motor = self.command.motor_cmd[number]
            motor.mode = 0x01
            motor.q, motor.dq, motor.kp, motor.kd, motor.tau = command[joint::12]
        self.command.crc = self.crc.Crc(self.command)
        self.publisher.Write(self.command)


if __name__ == "__main__":
    driver = Driver(sys.argv[1])
    while driver.newest is None:
        input("no state yet; switch the robot on, and press enter")
    channel = bridge.UdpChannel(port=5151)
    print(f"udp://{channel.address[0]}:{channel.address[1]}", flush=True)
    bridge.serve(bridge.Bridge(driver, channel, DESCRIPTION))
