"""A robot behind a bridge, as the runtime sees it: `RobotInterface` over datagrams.

`connect` asks the bridge for the description of its robot. From then on `read` takes the newest
STATE, and `write` sends a COMMAND that names the state it answers. Read `loop` next.
"""

from __future__ import annotations

import socket
from contextlib import suppress
from urllib.parse import urlsplit

import numpy as np

from surefoot.deploy import protocol
from surefoot.deploy.bridge import MOST_DATAGRAMS, Address, Channel, UdpChannel
from surefoot.deploy.interfaces import (
    BaseEstimate,
    Clock,
    JointCommand,
    Latched,
    Sensors,
    Stale,
    wall_clock,
)
from surefoot.deploy.protocol import Description, Packet, State

GREETING = 100_000_000
"""[ns] Interval between greetings until the first command; they keep other runtimes out."""
STATE_PATIENCE = 5.0
"""[s] Maximum time that a robot in lockstep may be silent: its time stands still meanwhile."""
RESTING = 0.3
"""[s] How long a robot in lockstep is watched before its first command: it must not move."""
NANOSECONDS = 1e9
NUMBERS = np.dtype("<f8")
"""The type of the numbers in datagrams."""


class UdpRobot:
    """A robot behind a bridge.

    Args:
        channel: Carries the datagrams.
        peer: The address of the bridge.
        clock: Gives the time [ns].
        lockstep: Whether the bridge ticks once for each command, so that `read` waits for it.

    Attributes:
        state: The newest state from the bridge; None before the first one.
        round_trip_ns: Time from sending the newest command that the bridge had received to the
            arrival of the newest state [ns]; it contains up to a tick of waiting at the bridge.
        lockstep: Whether the bridge ticks once for each command.
        heard_ns: When the newest state arrived [ns].
        refused: How many datagrams were not from the bridge, not of this session, or old.
    """

    def __init__(
        self, channel: Channel, peer: Address, clock: Clock = wall_clock, lockstep: bool = False
    ) -> None:
        self.state: State | None = None
        self.round_trip_ns = 0
        self.heard_ns = clock()
        self.refused = 0
        self._channel = channel
        self._peer = peer
        self._clock = clock
        self.lockstep = lockstep
        self._description: Description | None = None
        self._answered_from: Address | None = None  # a bridge at another address
        self._robot_id = 0
        self._session = 0
        self._sequence = 0
        self._newest = 0  # the sequence number of the newest state from the bridge
        self._read = 0  # that of the newest state that has been read
        self._bridges_clock = 0
        self._greeted_ns = 0
        self._sensors: Sensors | None = None
        self._commands = 0
        self._last_sent = b""
        self._damped = False

    @property
    def connected(self) -> bool:
        """Whether the bridge has described its robot and begun a session."""
        return self._description is not None

    @property
    def _has_begun(self) -> bool:
        """Whether the bridge has described its robot, and sent a first state."""
        return self.connected and self.state is not None

    @property
    def description(self) -> Description:
        """See `RobotInterface`.

        Raises:
            Stale: The bridge has not answered yet.
        """
        if self._description is None:
            raise Stale(f"no bridge answers at {address_text(self._peer)}; is it running?")
        return self._description

    def robot_clock(self) -> int:
        """The robot's clock in the newest state [ns]: a `Clock` that stops when the robot does."""
        return self._bridges_clock

    def connect(self, seconds: float = 2.0) -> Description:
        """Ask the bridge for its description, and wait for it and for a first measurement.

        Args:
            seconds: How long to wait.

        Raises:
            Stale: The bridge does not answer: there is none, or it serves another runtime.
        """
        begun = self._clock()
        while not self._has_begun and self._clock() - begun < seconds * NANOSECONDS:
            self.greet()
            self._channel.wait(0.02)
            self.take()
        if not self._has_begun:
            raise Stale(
                f"no bridge answers at {address_text(self._peer)} within {seconds:g} s: "
                f"{self._silence()}"
            )
        if self.lockstep:
            self._check_lockstep()
        return self.description

    def _check_lockstep(self) -> None:
        """Check that the robot's time stands still until a command comes.

        Raises:
            Stale: It does not, so nobody would notice a command that comes too late.
        """
        newest = self._newest
        time_ns = self._bridges_clock
        begun = self._clock()
        while self._newest == newest and self._clock() - begun < RESTING * NANOSECONDS:
            self._channel.wait(0.02)
            self.take()
        latched = self.state is not None and self.state.status == protocol.LATCHED
        if self._bridges_clock != time_ns and not latched:  # a latched robot may still be falling
            raise Stale(
                f"the robot at {address_text(self._peer)} does not wait for commands: leave out "
                "--lockstep, or start the twin with it, too"
            )

    def _silence(self) -> str:
        """Why the bridge may be silent."""
        if self._answered_from is None:
            return "it is not running, or it serves another runtime"
        return f"a bridge answers from {address_text(self._answered_from)} instead, so name that"

    def greet(self) -> None:
        """Say hello to the bridge; it answers with its description."""
        self._greeted_ns = self._clock()
        self._post(protocol.HELLO, b"")

    def read(self) -> Sensors:
        """See `RobotInterface`; waits for a new state, at most for a tick unless in lockstep."""
        self.take()
        if not self._commands and self._clock() - self._greeted_ns >= GREETING:
            self.greet()
        period = 1.0 / self.description.rate_hz
        if self.lockstep and self._commands:
            self._wait_for_the_tick()
        elif self._newest == self._read:
            self._channel.wait(period)
            self.take()
        self._read = self._newest
        silent = (self._clock() - self.heard_ns) / NANOSECONDS
        limit = STATE_PATIENCE if self.lockstep else self.description.state_timeout
        if silent >= limit or self._sensors is None or self.state is None:
            raise Stale(f"the bridge has been silent for {1e3 * silent:.1f} ms")
        if self.state.status == protocol.LATCHED:
            cause = protocol.CAUSES[min(self.state.cause, len(protocol.CAUSES) - 1)]
            bits = f" (bits {self._sensors.faults:#x})" if self._sensors.faults else ""
            raise Latched(f"the bridge is latched: {cause}{bits}")
        return self._sensors

    def write(self, command: JointCommand) -> None:
        """See `RobotInterface`."""
        if self._damped:
            return
        numbers = (command.position, command.velocity, command.kp, command.kd, command.torque)
        self._commands += 1
        self._post(protocol.COMMAND, np.concatenate(numbers, dtype=NUMBERS).tobytes())

    def damp(self) -> None:
        """See `RobotInterface`."""
        self._damped = True
        with suppress(Exception):
            self._post(protocol.DAMP, b"")

    def close(self) -> None:
        """See `RobotInterface`."""
        for _ in range(3):  # one may be lost
            self.damp()
        self._channel.close()

    def _wait_for_the_tick(self) -> None:
        """Wait for the state that answers the last command, and repeat the command if needed."""
        begun = self._clock()
        while not self._is_done() and self._clock() - begun < STATE_PATIENCE * NANOSECONDS:
            self._channel.wait(0.2)
            self.take()
            if self._commands and self._clock() - begun > 0.2 * NANOSECONDS:
                self._channel.send(self._last_sent, self._peer)

    def _is_done(self) -> bool:
        """Whether a state has come that accounts for all commands."""
        return self.state is not None and self.state.commands >= self._commands

    def _post(self, kind: int, body: bytes) -> None:
        """Send a datagram to the bridge."""
        self._sequence += 1
        now = self._clock()
        session = 0 if kind == protocol.HELLO else self._session
        packet = Packet(
            kind, self._robot_id, session, self._sequence, now, self._bridges_clock, body
        )
        self._last_sent = protocol.pack(packet)
        self._channel.send(self._last_sent, self._peer)

    def take(self) -> None:
        """Take the datagrams that have come, and keep the newest state.

        A flood of datagrams from anyone but the bridge does not delay a tick.
        """
        most = self.refused + MOST_DATAGRAMS
        while self.refused < most and (received := self._channel.receive()) is not None:
            data, sender = received
            try:
                packet = protocol.unpack(data)
                if sender != self._peer:
                    if packet.kind == protocol.DESCRIPTION:
                        self._answered_from = sender
                    raise protocol.Refused("a stranger")
                if packet.kind == protocol.DESCRIPTION:
                    self._meet(packet)
                elif packet.kind == protocol.STATE:
                    self._believe(packet)
                else:
                    raise protocol.Refused("no datagram of a bridge")
            except protocol.Refused:
                self.refused += 1

    def _meet(self, packet: Packet) -> None:
        """Begin the session that a bridge grants; later ones are ignored."""
        description = protocol.unpack_description(packet.body)
        number = protocol.robot_id(description.robot, description.joints, description.rate_hz)
        if number != packet.robot_id:
            raise protocol.Refused("the description of another robot")
        if self._description is not None:
            return
        self._description = description
        self._robot_id = number
        self._session = packet.session
        self._bridges_clock = packet.time_ns

    def _believe(self, packet: Packet) -> None:
        """Adopt a state, if it belongs to this session and is the newest."""
        if packet.session != self._session or packet.robot_id != self._robot_id:
            raise protocol.Refused("another session")
        if packet.sequence <= self._newest:
            raise protocol.Refused("an old state")
        state = protocol.unpack_state(packet.body)
        now = self._clock()
        self._newest = packet.sequence
        self._bridges_clock = packet.time_ns
        self.state = state
        self.heard_ns = now
        self.round_trip_ns = now - packet.echo_ns
        values = np.frombuffer(packet.body, NUMBERS, offset=protocol.STATE_VALUES).astype(float)
        base = BaseEstimate(float(values[46]), values[47:50]) if state.has_base else None
        self._sensors = Sensors(
            time_ns=packet.time_ns,
            sequence=packet.sequence,
            joint_position=values[:12],
            joint_velocity=values[12:24],
            joint_torque=values[24:36],
            orientation=values[36:40],
            angular_velocity=values[40:43],
            acceleration=values[43:46],
            base=base,
            faults=state.faults,
        )


def robot_at(peer: Address, lockstep: bool) -> UdpRobot:
    """The robot behind a bridge, over a channel of its own.

    Args:
        peer: The address of the bridge.
        lockstep: Whether the bridge ticks once for each command.
    """
    # Any local address is heard from the loopback interface only if the bridge is there too.
    local = "127.0.0.1" if peer[0].startswith("127.") else "0.0.0.0"
    return UdpRobot(UdpChannel(local), peer, lockstep=lockstep)


def address_text(address: Address) -> str:
    """An address as `parse_address` takes it.

    Args:
        address: Host and port.
    """
    return f"udp://{address[0]}:{address[1]}"


def parse_address(text: str) -> Address:
    """The host and the port of a bridge; a host name is resolved, since senders are IP addresses.

    Args:
        text: The address, such as udp://127.0.0.1:5151.

    Raises:
        ValueError: It is not such an address, or the host name cannot be resolved.
    """
    parts = urlsplit(text)
    try:
        port = parts.port
    except ValueError:
        port = None
    if parts.scheme != "udp" or not parts.hostname or not port or parts.path:
        raise ValueError(f"{text!r} is no address of a bridge; use udp://127.0.0.1:PORT")
    try:
        return socket.gethostbyname(parts.hostname), port
    except (OSError, UnicodeError) as error:
        raise ValueError(
            f"{text!r}: the host {parts.hostname!r} has no IPv4 address ({error}); give the number "
            f"of the bridge's machine, such as udp://192.168.123.10:{port}"
        ) from error
