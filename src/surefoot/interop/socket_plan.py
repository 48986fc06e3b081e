"""An MPC in another process: `SocketPlan` is a plan function that asks a server over TCP.

This makes an MPC in C++, or one behind ROS, an expert like any other. All numbers are
little-endian, and messages have a fixed layout, so that a server needs no library:

- A question is 60 doubles: gait clock [ms]; command vx, vy, yaw rate; q (19); v (18); center of
  mass (3); feet (4 x 3); contacts (4, 0 or 1). `surefoot.types` says what they mean.
- The answer is a 4-byte unsigned integer T, then T rows of 36 doubles, one per millisecond: joint
  positions, joint velocities, torques. T = 0 means that there is no valid plan.

A question does not name a gait: an MPC with several needs a server for each, see `SocketPlan`.
`serve_plan` is such a server in Python. Nothing that is received is executed.
"""

from __future__ import annotations

import os
import select
import socket
import struct
import threading
from collections.abc import Callable
from socketserver import BaseRequestHandler, ThreadingTCPServer

import numpy as np

from surefoot.types import Array, Command, MotionPlan, PlanFunction, State, plan_rows

DOUBLE = np.dtype("<f8")
"""A number of a question or an answer."""
SIZES = {"q": (19,), "v": (18,), "com": (3,), "feet": (4, 3), "contacts": (4,)}
"""The parts of a state, in the order of a question."""
NUMBERS = 60
"""The count of numbers in a question."""
COLUMNS = 36
"""The count of numbers in a row of an answer."""
_OF_A_PROCESS = ("_connection", "_process", "_turn")
"""The attributes of a `SocketPlan` that belong to one process."""
MOST_TICKS = 10_000
"""[ms] No answer is longer; a plan's ticks beyond 100 are not used."""
HEADER = struct.Struct("<I")
"""The beginning of an answer."""


class PlanServerError(RuntimeError):
    """The server of an MPC cannot be reached, or does not answer as it should."""


class SocketPlan:
    """A plan function that asks a server.

    Each process that uses it, even a forked one, opens its own connection with its first question,
    so that `Workers` may have copies; threads take turns. It asks for the first gait only. If
    robots walk several gaits, have the plan function choose among servers:
    ``plans[command.gait](state, tick, Command(*command))``.

    Args:
        port: The server's port.
        host: The server's address; the default is this machine.
        timeout: How long to wait for an answer [s].
    """

    def __init__(self, port: int, host: str = "127.0.0.1", timeout: float = 10.0) -> None:
        self.port = port
        self.host = host
        self.timeout = timeout
        self._begin_anew()

    def _begin_anew(self) -> None:
        """Set what belongs to one process: no connection yet, the process, and its lock."""
        self._connection: socket.socket | None = None
        self._turn = threading.Lock()
        self._process = os.getpid()  # last: another thread that sees it has the new lock

    def __getstate__(self) -> dict[str, str | int | float | None]:
        """What other processes get: everything except the connection, the process and the lock."""
        return {name: value for name, value in vars(self).items() if name not in _OF_A_PROCESS}

    def __setstate__(self, state: dict[str, str | int | float | None]) -> None:
        """Start in another process, without a connection."""
        vars(self).update(state)
        self._begin_anew()

    def __call__(self, state: State, tick: int, command: Command) -> MotionPlan:
        """Ask for the plan of one robot.

        Args:
            state: The state of one robot.
            tick: The gait clock [ms].
            command: vx, vy [m/s], yaw rate [rad/s].

        Raises:
            PlanServerError: There is no server, it is silent, or its answer is not a plan.
            ValueError: The command is for another gait than the first one.
        """
        asked = question(state, tick, command)
        if self._process != os.getpid():  # after a fork, connection and lock are the parent's
            self._begin_anew()
        try:
            with self._turn:
                return self._ask(asked)
        except (OSError, EOFError) as error:
            raise PlanServerError(
                f"the MPC at {self.host}:{self.port} does not answer ({error}): start its server "
                "first, and look at what it prints"
            ) from error

    def _ask(self, asked: bytes) -> MotionPlan:
        """Send a question, and wait for its answer."""
        try:
            if self._connection is not None and _has_ended(self._connection):
                self.close()  # a server that was started again answers a new connection
            if self._connection is None:
                self._connection = socket.create_connection((self.host, self.port), self.timeout)
                self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._connection.sendall(asked)
            return read_answer(self._connection)
        except BaseException:  # Ctrl-C too: the rest of this answer is not the next one
            self.close()
            raise

    def close(self) -> None:
        """Close the connection, if there is one; the next question opens another."""
        if self._connection is not None:
            self._connection.close()
            self._connection = None


def question(state: State, tick: int, command: Command) -> bytes:
    """The bytes of a question.

    Raises:
        ValueError: The command is for another gait than the first, which a question cannot name.
    """
    if command.gait != 0:
        raise ValueError(
            f"the command is of gait number {command.gait}, but a question to a server has no "
            "gait: start a server for each gait, and plan with "
            "plans[command.gait](state, tick, Command(*command)), where plans has a SocketPlan of "
            "each"
        )
    parts = [[tick], command, *(np.ravel(getattr(state, name)) for name in SIZES)]
    return np.concatenate(parts).astype(DOUBLE).tobytes()


def read_question(connection: socket.socket) -> tuple[State, int, Command]:
    """Wait for a question: state, gait clock [ms] and command of one robot.

    Raises:
        EOFError: The connection has been closed.
    """
    numbers = np.frombuffer(_receive(connection, NUMBERS * 8), DOUBLE)
    parts = {}
    start = 4
    for name, shape in SIZES.items():
        size = int(np.prod(shape))
        parts[name] = numbers[start : start + size].reshape(shape)
        start += size
    parts["contacts"] = parts["contacts"] > 0.5
    vx, vy, yaw_rate = numbers[1:4].tolist()
    return State(**parts), int(numbers[0]), Command(vx, vy, yaw_rate)


def answer(plan: MotionPlan) -> bytes:
    """The bytes of an answer.

    Args:
        plan: The plan, with at most `MOST_TICKS` rows.

    Raises:
        ValueError: The plan's arrays are not ``(T, 12)`` numbers, or have too many rows.
        TypeError: The plan is not a `MotionPlan`.
    """
    rows, valid = plan_rows(plan)
    if not valid:
        return HEADER.pack(0)
    if len(rows) > MOST_TICKS:
        raise ValueError(f"a plan of {len(rows)} ticks; use at most {MOST_TICKS}")
    return HEADER.pack(len(rows)) + rows.astype(DOUBLE).tobytes()


def read_answer(connection: socket.socket) -> MotionPlan:
    """Wait for an answer.

    Raises:
        EOFError: The connection has been closed.
        PlanServerError: The answer is longer than any plan.
    """
    (ticks,) = HEADER.unpack(_receive(connection, HEADER.size))
    if ticks == 0:
        return MotionPlan(*(np.zeros((1, 12)) for _ in range(3)), valid=False)
    if ticks > MOST_TICKS:
        raise PlanServerError(
            f"an answer of {ticks} ticks; use at most {MOST_TICKS}, and begin it with their number "
            "as a 4-byte little-endian integer"
        )
    rows: Array = np.frombuffer(_receive(connection, ticks * COLUMNS * 8), DOUBLE)
    position, velocity, torque = np.split(rows.reshape(ticks, COLUMNS), 3, axis=1)
    return MotionPlan(position, velocity, torque)


def _has_ended(connection: socket.socket) -> bool:
    """Whether the server has closed a connection on which nothing is asked.

    Raises:
        PlanServerError: Something followed the last answer; it would be taken for the next one.
    """
    readable, _, _ = select.select([connection], [], [], 0)
    if not readable:
        return False
    try:
        follows = connection.recv(1, socket.MSG_PEEK)
    except ConnectionError:
        return True
    if follows:
        raise PlanServerError(
            "the last answer was longer than the number of ticks that it began with; each tick has "
            f"{COLUMNS} doubles: 12 joint positions, 12 joint velocities, 12 torques"
        )
    return True


def serve_plan(plan: PlanFunction, port: int = 0, host: str = "127.0.0.1") -> ThreadingTCPServer:
    """Make a server of a plan function; its ``serve_forever`` answers until its ``shutdown``.

    If the function fails, or does not return a plan, the server prints why and closes the
    connection.

    Args:
        plan: The plan function, called from a thread for each connection.
        port: The port; 0 takes a free one, which is then ``server_address[1]``.
        host: The address to listen on; the default can only be reached from this machine.
    """

    class Handler(BaseRequestHandler):
        def handle(self) -> None:
            self.request.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            _answer_all(self.request, plan)

    class Server(ThreadingTCPServer):
        daemon_threads = True
        allow_reuse_address = True

    return Server((host, port), Handler)


def _answer_all(connection: socket.socket, plan: Callable[..., MotionPlan]) -> None:
    """Answer the questions of a connection until it is closed.

    Raises:
        ValueError: The function did not return a usable plan; see `answer`.
        TypeError: See `answer`.
    """
    while True:
        try:
            asked = read_question(connection)
        except EOFError:
            return
        connection.sendall(answer(plan(*asked)))


def _receive(connection: socket.socket, size: int) -> bytes:
    """Receive exactly this number of bytes.

    Raises:
        EOFError: The connection was closed before that.
    """
    content = bytearray()
    while len(content) < size:
        part = connection.recv(min(size - len(content), 1 << 16))
        if not part:
            raise EOFError("the connection was closed")
        content += part
    return bytes(content)
