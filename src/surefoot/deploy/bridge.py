"""The bridge: connects a robot's driver to the runtime by datagrams, with its own watchdog.

It runs in the driver's own environment and needs Python 3.8 or later, and `protocol.py` in the same
folder; copy both files. The bridge damps the joints until a first command comes. It damps them
again, for the rest of the session, once the commands stop, are broken or answer states that are too
old, or the runtime requests it (`Bridge` says what ends a session). A driver's fault latches for
good. Read `protocol` first.

    serve(Bridge(MyDriver(), UdpChannel(), description))
"""

from __future__ import annotations

import logging
import math
import secrets
import select
import signal
import socket
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from threading import current_thread, main_thread
from typing import Any, Protocol, Tuple  # noqa: UP035

if __package__:
    from surefoot.deploy import protocol
else:  # copied, with protocol.py in the same folder
    import protocol  # pyright: ignore

logger = logging.getLogger("bridge")
Measurement = protocol.Measurement
"""What a driver's `read` returns."""
Address = Tuple[str, int]  # noqa: UP006 - Python 3.8 has no tuple[]
"""A host and a port."""
MOST_DATAGRAMS = 64
"""Maximum number of datagrams read per tick, so that a flood does not delay the driver."""
LAST_WRITES = 20
"""How often the joints are damped when the bridge ends, one tick apart."""
ENDINGS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
"""Signals that end a bridge once the joints are damped."""
RELEASE = 1.0
"""[s] Silence of the former runtime after which an idle or latched bridge greets a new one."""


class Driver(Protocol):
    """What a bridge needs from a robot's driver; neither method may wait for long."""

    def read(self) -> Measurement:
        """What the robot measures now; it raises an error once the robot has gone silent."""
        ...

    def write(self, command: Sequence[float]) -> None:
        """Command the motors: tau = torque + kp (position - q) + kd (velocity - dq).

        Args:
            command: Sixty numbers: positions, velocities, kp, kd and torques of the twelve joints.
        """
        ...


class Channel(Protocol):
    """Carries datagrams; only `wait` waits."""

    def receive(self) -> tuple[bytes, Address] | None:
        """A datagram and its sender; None if there is none."""
        ...

    def send(self, data: bytes, to: Address) -> None:
        """Send a datagram, which may get lost."""
        ...

    def wait(self, seconds: float) -> None:
        """Wait until there may be a datagram, or for this time [s]."""
        ...

    def close(self) -> None:
        """Close the channel."""
        ...


class UdpChannel:
    """A channel over UDP, on the loopback interface by default.

    Args:
        host: The address of the interface to listen on.
        port: The port to listen on; 0 takes any free one.
    """

    def __init__(self, host: str = "127.0.0.1", port: int = 0) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._socket.bind((host, port))
        self.address: Address = self._socket.getsockname()

    def receive(self) -> tuple[bytes, Address] | None:
        """See `Channel`."""
        try:
            return self._socket.recvfrom(protocol.LONGEST + 1)
        except OSError:  # there is none, or an earlier one could not be delivered
            return None

    def send(self, data: bytes, to: Address) -> None:
        """See `Channel`."""
        with suppress(OSError):
            self._socket.sendto(data, to)

    def wait(self, seconds: float) -> None:
        """See `Channel`."""
        select.select([self._socket], [], [], seconds)

    def close(self) -> None:
        """See `Channel`."""
        self._socket.close()


class Bridge:
    """Passes commands on to a driver, and damps the joints as soon as that is not safe.

    The first runtime that says hello is pinned as the peer: datagrams from others are counted and
    ignored. A session ends when another hello is granted. A bridge that is idle or latched grants
    one after its peer has been silent for `RELEASE`. A latch by the driver stays in all sessions.

    Args:
        driver: The robot's driver.
        channel: Carries the datagrams.
        description: The robot, and the timeouts.
        clock: Gives the time [ns]; it never runs backwards.

    Raises:
        ValueError: The description's limits or timeouts cannot keep a robot safe.
    """

    def __init__(
        self,
        driver: Driver,
        channel: Channel,
        description: protocol.Description,
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        protocol.check_description(description)
        self.description = description
        self.status = protocol.IDLE
        self.cause = protocol.NO_CAUSE
        self.refused = 0
        self.foreign = 0
        self.old = 0
        self.commands = 0
        self.accepted = 0
        self.heard = 0  # datagrams from the peer, repeated ones and greetings included
        self.turned_away = 0  # greetings from other runtimes
        self.peer: Address | None = None
        self._driver = driver
        self._channel = channel
        self._clock = clock
        self._robot_id = protocol.robot_id(
            description.robot, description.joints, description.rate_hz
        )
        self._session = 0
        self._sequence = 0  # the number of the newest datagram from the peer
        self._sent = 0
        self._heard_at = 0
        self._commanded_at = 0
        self._answered = 0  # the clock in the state that the newest command answers
        self._peers_clock = 0
        self._damping = (0.0,) * 36 + (description.damping,) * 12 + (0.0,) * 12
        self._command: Sequence[float] = self._damping
        self._measured = self._read()

    def tick(self) -> None:
        """Read the datagrams, watch over the commands, serve the driver, and send a state."""
        self.receive()
        self.advance()

    def receive(self) -> None:
        """Read the datagrams that have come."""
        now = self._clock()
        for _ in range(MOST_DATAGRAMS):
            received = self._channel.receive()
            if received is None:
                return
            self._take(*received, now)

    def advance(self) -> None:
        """Watch over the commands, serve the driver, and send a state.

        Raises:
            KeyboardInterrupt: The tick was interrupted, even if the driver hides that.
        """
        self._watch(self._clock())
        driving = self.status == protocol.DRIVING
        # Whatever the driver raises, the joints are damped, as far as it still obeys.
        try:
            self._driver.write(self._command if driving else self._damping)
        except Exception as error:
            self._fail(error)
        try:
            self._measured = self._read()
        except Exception as error:
            self._fail(error)
        if self._measured.faults:
            self._latch(protocol.DRIVER)
        self.report()

    def report(self) -> None:
        """Send the peer the last measurement, and the status of the bridge."""
        if self.peer is None:
            return
        measured = self._measured
        values = [value for part in measured[:6] for value in part]
        values += (0.0,) * 4 if measured.base is None else list(measured.base)
        state = protocol.State(
            self.status,
            self.cause,
            int(measured.base is not None),
            measured.faults & 0xFFFFFFFF,
            self.refused & 0xFFFFFFFF,
            self.foreign & 0xFFFFFFFF,
            self.old & 0xFFFFFFFF,
            self.commands,
            values,
        )
        self._send(protocol.STATE, protocol.pack_state(state))

    def release(self) -> None:
        """Give up a peer that has gone: damp the joints, and grant the next hello."""
        self._latch(protocol.SILENCE)
        self.peer = None

    def close(self) -> None:
        """Damp the joints, often, as a write may fail or get lost, and close the channel."""
        self._latch(protocol.DRIVER)
        for _ in range(LAST_WRITES):
            with suppress(Exception):
                self._driver.write(self._damping)
            time.sleep(1.0 / self.description.rate_hz)
        self._channel.close()

    def _read(self) -> Measurement:
        """What the driver measures; a part of a wrong length is an error of the driver."""
        measured = self._driver.read()
        protocol.check_measurement(measured)
        return measured

    def _take(self, data: bytes, sender: Address, now: int) -> None:
        """Do what a datagram says, if it is valid."""
        try:
            packet = protocol.unpack(data)
        except protocol.Refused:
            self.refused += 1
            return
        if packet.kind == protocol.HELLO:
            self._greet(sender, packet, now)
        elif sender != self.peer:
            self.foreign += 1
        elif packet.session != self._session or packet.sequence <= self._sequence:
            self.old += 1
        elif packet.robot_id != self._robot_id or packet.echo_ns > now:
            self.refused += 1
        elif packet.kind == protocol.COMMAND:
            self._obey(packet, now)
        elif packet.kind == protocol.DAMP:
            self._accept(packet, now)
            self._latch(protocol.ASKED)
        else:
            self.refused += 1
        self.heard += sender == self.peer

    def _greet(self, sender: Address, hello: protocol.Packet, now: int) -> None:
        """Answer a hello, perhaps a repeated one, and begin a session if another may begin."""
        silent = now - self._heard_at >= RELEASE * 1e9
        fresh = sender == self.peer and self.status == protocol.IDLE and self._sequence == 0
        if not fresh and (self.peer is None or (silent and self.status != protocol.DRIVING)):
            self.peer = sender
            self._session = secrets.randbits(64) | 1
            self._sequence = 0
            self.commands = 0
            if self.cause != protocol.DRIVER:
                self.status = protocol.IDLE
                self.cause = protocol.NO_CAUSE
        elif not fresh:
            self.foreign += sender != self.peer
            self.turned_away += sender != self.peer
            self.old += sender == self.peer
            return
        self._heard_at = now
        self._peers_clock = hello.time_ns
        self._send(protocol.DESCRIPTION, protocol.pack_description(self.description))

    def _accept(self, packet: protocol.Packet, now: int) -> None:
        """Note that the peer is alive."""
        self.accepted += 1
        self._sequence = packet.sequence
        self._heard_at = now
        self._peers_clock = packet.time_ns

    def _obey(self, packet: protocol.Packet, now: int) -> None:
        """Adopt a command, unless it is broken."""
        self._accept(packet, now)
        if self.status == protocol.LATCHED:
            return
        command = protocol.unpack_command(packet.body)
        if not all(map(math.isfinite, command)) or min(command[24:48]) < 0.0:
            self._latch(protocol.BAD_COMMAND)
            return
        self.commands += 1
        self.status = protocol.DRIVING
        self._command = command
        self._commanded_at = now
        self._answered = packet.echo_ns

    def _watch(self, now: int) -> None:
        """Latch if the commands have stopped, or answer states that are too old."""
        if self.status != protocol.DRIVING:
            return
        next_tick = now + round(1e9 / self.description.rate_hz)  # too late to latch
        if next_tick - self._commanded_at > self.description.command_timeout * 1e9:
            self._latch(protocol.SILENCE)
        elif next_tick - self._answered > self.description.command_age * 1e9:
            self._latch(protocol.OLD_STATE)

    def _fail(self, error: Exception) -> None:
        """Latch for good after an error of the driver, and raise an interrupt that it hides."""
        if self.cause != protocol.DRIVER:  # only the first one: a line takes time
            logger.error(f"the driver has failed: {error!r}")
        self._latch(protocol.DRIVER)
        if _hides_interrupt(error):
            raise KeyboardInterrupt from error

    def _latch(self, cause: int) -> None:
        """Damp the joints from now on; a driver's fault replaces any other cause."""
        if self.status != protocol.LATCHED or cause == protocol.DRIVER:
            self.status = protocol.LATCHED
            self.cause = cause

    def _send(self, kind: int, body: bytes) -> None:
        """Send a datagram to the peer."""
        if self.peer is None:
            return
        self._sent += 1
        times = (self._clock(), self._peers_clock)
        packet = protocol.Packet(kind, self._robot_id, self._session, self._sent, *times, body)
        self._channel.send(protocol.pack(packet), self.peer)


def _hides_interrupt(error: BaseException | None) -> bool:
    """Whether Ctrl-C is behind an error: compiled code turns it into an error of its own."""
    for _ in range(99):  # causes may form a circle
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error and (error.__cause__ or error.__context__)
    return False


def _let_interrupt() -> dict[signal.Signals, Any]:
    """Let the `ENDINGS` interrupt as Ctrl-C does; return the former actions of the signals."""
    main = current_thread() is main_thread()
    if not main:
        warnings.warn(
            "serve runs in a thread, which no signal reaches: Ctrl-C or a kill ends the process "
            "and leaves the last command in the motors; call serve in the main thread",
            RuntimeWarning,
            stacklevel=3,
        )
    answered: dict[signal.Signals, Any] = {}
    for each in ENDINGS if main else ():
        before = signal.getsignal(each)
        if before in (signal.SIG_DFL, signal.default_int_handler):
            answered[each] = before
            signal.signal(each, signal.default_int_handler)
    return answered


def _answer(signals: dict[signal.Signals, Any]) -> None:
    """Set the actions of signals."""
    for each, answer in signals.items():
        signal.signal(each, answer)


def serve(bridge: Bridge, running: Callable[[], bool] = lambda: True) -> None:
    """Tick at the robot's rate until told to stop, or until a signal of `ENDINGS`; then damp.

    Call it in the main thread: signals reach no other one.

    Args:
        bridge: The bridge.
        running: Called before every tick; False ends the loop.
    """
    period = 1.0 / bridge.description.rate_hz
    due = time.monotonic()
    with ExitStack() as ending:  # runs the callbacks from last to first, whatever is raised
        answered = _let_interrupt()
        ending.callback(_answer, answered)
        ending.callback(bridge.close)
        ending.callback(_answer, dict.fromkeys(answered, signal.SIG_IGN))
        while running():
            bridge.tick()
            due = max(due + period, time.monotonic() - period)  # lost time is not made up
            time.sleep(max(due - time.monotonic(), 0.0))
