"""A bridge, or a runtime, of the toy robot as a process of its own, over real UDP.

    python -m tests.fakes.bridge_process bridge [FILE] prints its port, and serves
    python -m tests.fakes.bridge_process runtime PORT  drives, until it is killed

Timeouts are long: the machine that runs the tests may be busy.
"""

import os
import signal
import struct
import sys
from pathlib import Path

from surefoot.config.deploy import RuntimeConfig
from surefoot.deploy.bridge import Bridge, UdpChannel, serve
from surefoot.deploy.drive import drive
from surefoot.deploy.loop import Runtime
from surefoot.deploy.udp_robot import UdpRobot
from tests.fakes.bridge_world import TOY, Clock, ToyDriver, ToyOperator, ToyPolicy

PATIENT = TOY._replace(command_timeout=1.0, command_age=1.0, state_timeout=1.0)
"""The toy, on a busy machine."""
CONFIG = RuntimeConfig(stand=0.05, missed_deadlines=1000)


class LastingDriver(ToyDriver):
    """A toy whose last command stays in a file, as it stays with the motors of a robot."""

    def __init__(self, file: Path) -> None:
        super().__init__(Clock())
        self._file = file.open("wb", buffering=0)

    def write(self, command) -> None:
        super().write(command)
        os.pwrite(self._file.fileno(), struct.pack("<60d", *command), 0)


def make_runtime(port: int) -> Runtime:
    """A runtime that is connected."""
    robot = UdpRobot(UdpChannel(), ("127.0.0.1", port))
    robot.connect(30.0)
    return Runtime(robot, ToyPolicy(), ToyOperator(), CONFIG)


def main() -> None:
    # As in a terminal, whatever those who run the tests ignore, such as nohup.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    if sys.argv[1] == "bridge":
        channel = UdpChannel()
        print(channel.address[1], flush=True)
        driver = LastingDriver(Path(sys.argv[2])) if sys.argv[2:] else ToyDriver(Clock())
        serve(Bridge(driver, channel, PATIENT))
    else:
        drive(make_runtime(int(sys.argv[2])), None)


if __name__ == "__main__":
    main()
