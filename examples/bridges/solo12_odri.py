"""A bridge for Solo12 with ODRI's driver. NOT RUN: there was no robot and no driver here.

Copy this file, `bridge.py` and `protocol.py` (from src/surefoot/deploy) into one folder of the
driver's environment; the driver is `libodri_control_interface_pywrap`. Run it as root:

    python solo12_odri.py config_solo12.yaml

Check before the motors are on: names, order, signs and zero of the joints; that the orientation is
xyzw and turns base into world; that the gyroscope is in the base frame.
"""

from __future__ import annotations  # for Python 3.8

import sys
from collections.abc import Sequence

import bridge  # pyright: ignore
import libodri_control_interface_pywrap as oci  # pyright: ignore
import numpy as np
import protocol  # pyright: ignore

JOINTS = tuple(
    f"{leg}_{joint}" for leg in ("FL", "FR", "HL", "HR") for joint in ("HAA", "HFE", "KFE")
)
"""surefoot's order, which is that of ODRI's configuration of Solo12."""
DESCRIPTION = protocol.Description(
    robot="solo12",
    joints=JOINTS,
    rate_hz=1000,
    command_timeout=0.005,  # the motor boards switch off after 5 ms
    command_age=0.02,
    state_timeout=0.02,
    damping=0.2,
    position_low=(-0.9, -1.45, -2.8) * 4,
    position_high=(0.9, 1.45, 2.8) * 4,
    speed=(80.0,) * 12,
    torque=(1.8,) * 12,
)


class Driver:
    """All calls into ODRI's driver."""

    def __init__(self, configuration: str) -> None:
        self.robot = oci.robot_from_yaml_file(configuration)
        self.robot.initialize(np.zeros(12))  # calibrates; the legs move

    def read(self) -> bridge.Measurement:
        """What the robot measures; a fault of the driver is the bridge's fault too.

        The driver also counts it as an error that the master board has gone silent.
        """
        self.robot.parse_sensor_data()
        joints = self.robot.joints
        imu = self.robot.imu
        return bridge.Measurement(
            joint_position=joints.positions.tolist(),
            joint_velocity=joints.velocities.tolist(),
            joint_torque=joints.measured_torques.tolist(),
            orientation=imu.attitude_quaternion.tolist(),  # check: xyzw
            angular_velocity=imu.gyroscope.tolist(),
            acceleration=imu.accelerometer.tolist(),
            faults=int(self.robot.has_error),
        )

    def write(self, command: Sequence[float]) -> None:
        """Send positions, velocities, gains and torques in one message."""
        position, velocity, kp, kd, torque = np.array(command).reshape(5, 12)
        joints = self.robot.joints
        joints.set_position_gains(kp)
        joints.set_velocity_gains(kd)
        joints.set_desired_positions(position)
        joints.set_desired_velocities(velocity)
        joints.set_torques(torque)
        self.robot.send_command()


if __name__ == "__main__":
    channel = bridge.UdpChannel(port=5151)
    print(f"udp://{channel.address[0]}:{channel.address[1]}", flush=True)
    bridge.serve(bridge.Bridge(Driver(sys.argv[1]), channel, DESCRIPTION))
