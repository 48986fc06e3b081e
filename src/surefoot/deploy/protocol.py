"""The datagrams between the runtime and a bridge: fixed sizes, little-endian, checked by a CRC.

A datagram is a header, a body whose size depends on its kind, and the CRC-32 of both. The header
has the protocol and its version, the kind, the robot, the session, the sequence number, the
sender's clock, and the clock of the datagram that it answers. One with a wrong bit is refused.

The runtime says HELLO; the bridge answers with its DESCRIPTION and the number of a new session,
which every COMMAND and DAMP must carry, and sends a STATE every tick. The module needs only the
standard library: it is copied with `bridge.py` into a driver's own environment. Read `bridge` next.
"""

from __future__ import annotations

import hashlib
import operator
import struct
import zlib
from collections.abc import Sequence
from typing import NamedTuple

MAGIC = b"SFBR"
VERSION = 1
HELLO = 1
DESCRIPTION = 2
COMMAND = 3
DAMP = 4
STATE = 5

IDLE = 0
"""The bridge damps the joints and waits for a first command."""
DRIVING = 1
"""The bridge passes commands on."""
LATCHED = 2
"""The bridge damps the joints, whatever it receives in this session."""

NO_CAUSE = 0
SILENCE = 1
OLD_STATE = 2
BAD_COMMAND = 3
ASKED = 4
DRIVER = 5
CAUSES = (
    "none",
    "no command came in time",
    "the commands answered states that were too old",
    "a command was not finite, or had a negative gain",
    "the runtime asked for it",
    "the driver reported a fault",
)
"""Why a bridge is latched, in words."""

JOINTS = 12
_HEADER = struct.Struct("<4sBBHQQQQQ")
_CRC = struct.Struct("<I")
_COMMAND = struct.Struct("<60d")
_STATE = struct.Struct("<BBBxIIIIQ50d")
STATE_VALUES = struct.calcsize("<BBBxIIIIQ")
"""[B] Where the values of a STATE begin in its body."""
_MEASURED = {
    "joint_position": JOINTS,
    "joint_velocity": JOINTS,
    "joint_torque": JOINTS,
    "orientation": 4,
    "angular_velocity": 3,
    "acceleration": 3,
    "base": 4,
}
_NAME = 40
_DESCRIPTION = struct.Struct(f"<{_NAME}s{JOINTS * _NAME}sI4d48d")
_SIZES = {
    HELLO: 0,
    DESCRIPTION: _DESCRIPTION.size,
    COMMAND: _COMMAND.size,
    DAMP: 0,
    STATE: _STATE.size,
}
LONGEST = _HEADER.size + max(_SIZES.values()) + _CRC.size
"""[B] The length of the longest datagram."""


class Refused(ValueError):  # noqa: N818
    """Bytes that are no datagram of this protocol."""


class Packet(NamedTuple):
    """A datagram.

    Attributes:
        kind: HELLO, DESCRIPTION, COMMAND, DAMP or STATE.
        robot_id: The number that `robot_id` gives the robot; any number in a HELLO.
        session: The number of the session; 0 in a HELLO.
        sequence: The number of the datagram; it increases through a session, in each direction.
        time_ns: The sender's clock [ns].
        echo_ns: The other side's clock in the newest datagram that the sender had received [ns].
        body: The bytes that belong to the kind.
    """

    kind: int
    robot_id: int
    session: int
    sequence: int
    time_ns: int
    echo_ns: int
    body: bytes = b""


class Measurement(NamedTuple):
    """What a driver measures: joint values in the description's order, SI units.

    Attributes:
        joint_position: Twelve joint angles [rad].
        joint_velocity: Twelve joint rates [rad/s].
        joint_torque: Twelve joint torques [N m].
        orientation: Unit quaternion xyzw, base frame to world frame.
        angular_velocity: Angular velocity of the base, base frame [rad/s].
        acceleration: Specific force at the base, base frame [m/s^2].
        base: Height [m] and linear velocity in the base frame [m/s]; None if nothing measures them.
        faults: The driver's fault bits; any value but 0 latches the bridge for good.
    """

    joint_position: Sequence[float]
    joint_velocity: Sequence[float]
    joint_torque: Sequence[float]
    orientation: Sequence[float]
    angular_velocity: Sequence[float]
    acceleration: Sequence[float]
    base: Sequence[float] | None = None
    faults: int = 0


class State(NamedTuple):
    """The body of a STATE.

    Attributes:
        status: IDLE, DRIVING or LATCHED.
        cause: Why it is latched: an index of `CAUSES`.
        has_base: 1 if height and linear velocity of the base are measured, else 0.
        faults: The driver's fault bits.
        refused: How many datagrams were not of this protocol, or not for this robot.
        foreign: How many came from someone other than the pinned peer.
        old: How many had an old session or sequence number.
        commands: How many commands were accepted in this session.
        values: ``(50,)`` joint positions, velocities, torques (12 each), orientation xyzw (4),
            angular velocity (3), acceleration (3), height and linear velocity of the base (4).
    """

    status: int
    cause: int
    has_base: int
    faults: int
    refused: int
    foreign: int
    old: int
    commands: int
    values: Sequence[float]


class Description(NamedTuple):
    """What a bridge says about its robot.

    Attributes:
        robot: The name of the robot.
        joints: The names of its twelve joints, in the order of all messages.
        rate_hz: How often the bridge reads and writes its driver [Hz].
        command_timeout: How long the runtime may be silent [s].
        command_age: How old the state that a command answers may be [s].
        state_timeout: How long the bridge may be silent [s].
        damping: The damping of the joints when the bridge damps them [N m s/rad].
        position_low: ``(12,)`` smallest joint angles [rad].
        position_high: ``(12,)`` largest joint angles [rad].
        speed: ``(12,)`` largest joint rates [rad/s].
        torque: ``(12,)`` largest joint torques [N m].
    """

    robot: str
    joints: tuple[str, ...]
    rate_hz: int
    command_timeout: float
    command_age: float
    state_timeout: float
    damping: float
    position_low: tuple[float, ...]
    position_high: tuple[float, ...]
    speed: tuple[float, ...]
    torque: tuple[float, ...]


LONGEST_TIMEOUT = 1.0
"""[s] Nothing on the way may be silent, or late, for longer: a robot has fallen by then."""


def check_measurement(measured: Measurement) -> None:
    """Check that a driver's measurement can be sent, so that a wrong part is named.

    Args:
        measured: What the driver measured.

    Raises:
        ValueError: A part has the wrong length.
        TypeError: A part is no sequence, or the fault bits are no whole number.
    """
    for name, length in _MEASURED.items():
        if name == "base" and measured.base is None:
            continue
        found = len(getattr(measured, name))
        if found != length:
            raise ValueError(f"the driver's {name} has {found} numbers, and needs {length}")
    operator.index(measured.faults)


def check_description(description: Description) -> None:
    """Check that a description can be sent, and that limits and times can keep the robot safe.

    Args:
        description: What a bridge says about its robot.

    Raises:
        ValueError: It cannot be sent (see `pack_description`), the rate is below 1 Hz, every
            command would be too late at that rate, one of the three times is more than
            `LONGEST_TIMEOUT`, a range of angles is empty, or a time, another limit or the damping
            is not positive; NaN is refused, too.
    """
    pack_description(description)
    if description.rate_hz < 1:
        raise ValueError(f"the bridge's rate_hz is {description.rate_hz}; use a number from 1 on")
    for name in ("command_timeout", "command_age", "state_timeout"):
        value = getattr(description, name)
        if value > LONGEST_TIMEOUT:
            raise ValueError(
                f"the bridge's {name} is {value} s; use at most {LONGEST_TIMEOUT}, in seconds"
            )
    for name in ("command_timeout", "command_age", "state_timeout", "damping"):
        value = getattr(description, name)
        if not value > 0.0:
            raise ValueError(f"the bridge's {name} is {value}; use a number above 0")
    # A command answers the state of the previous tick, and must not be late until the next tick.
    for name, ticks in (("command_timeout", 1), ("command_age", 2)):
        least = ticks / description.rate_hz
        if getattr(description, name) < 1.001 * least:
            raise ValueError(
                f"the bridge's {name} is {getattr(description, name)} s, so that every command at "
                f"{description.rate_hz} Hz would be too late; use more than {least:g} s"
            )
    for joint in range(JOINTS):
        low = description.position_low[joint]
        high = description.position_high[joint]
        if not low < high:
            raise ValueError(
                f"the bridge's limits of joint {joint} are {low} to {high} rad; give the smaller "
                "one first, and infinite ones where there are none"
            )
    for name in ("speed", "torque"):
        if not all(limit > 0.0 for limit in getattr(description, name)):
            raise ValueError(
                f"the bridge's {name} limits are {getattr(description, name)}; use numbers above 0"
            )


def robot_id(robot: str, joints: Sequence[str], rate_hz: int) -> int:
    """The number of a robot, which follows from names, joint order and rate.

    Args:
        robot: The name of the robot.
        joints: The names of its joints, in order.
        rate_hz: The rate of its commands [Hz].
    """
    text = "\n".join([robot, *joints, str(rate_hz)])
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8], "little")


def pack(packet: Packet) -> bytes:
    """The bytes of a datagram.

    Args:
        packet: The datagram.

    Raises:
        ValueError: The body does not have the size that belongs to the kind.
    """
    kind, number, session, sequence, time_ns, echo_ns, body = packet
    if _SIZES.get(kind) != len(body):
        raise ValueError(f"a datagram of kind {kind} has a body of {len(body)} bytes")
    header = _HEADER.pack(MAGIC, VERSION, kind, 0, number, session, sequence, time_ns, echo_ns)
    content = header + body
    return content + _CRC.pack(zlib.crc32(content))


def unpack(data: bytes) -> Packet:
    """The datagram in some bytes.

    Args:
        data: The bytes, of any length and origin.

    Raises:
        Refused: They are not a datagram of this protocol and version.
    """
    if len(data) < _HEADER.size + _CRC.size:
        raise Refused("too short")
    magic, version, kind, zero, *numbers = _HEADER.unpack_from(data)
    if magic != MAGIC or version != VERSION or zero != 0:
        raise Refused("another protocol or version")
    size = _SIZES.get(kind)
    if size is None or len(data) != _HEADER.size + size + _CRC.size:
        raise Refused("another size than its kind has")
    end = _HEADER.size + size
    if zlib.crc32(data[:end]) != _CRC.unpack_from(data, end)[0]:
        raise Refused("a wrong checksum")
    number, session, sequence, time_ns, echo_ns = numbers
    body = data[_HEADER.size : end]
    return Packet(kind, number, session, sequence, time_ns, echo_ns, body)


def pack_command(values: Sequence[float]) -> bytes:
    """The body of a COMMAND.

    Args:
        values: ``(60,)`` positions, velocities, kp, kd and torques of the twelve joints.
    """
    return _COMMAND.pack(*values)


def unpack_command(body: bytes) -> tuple[float, ...]:
    """The sixty numbers of a COMMAND; undoes `pack_command`.

    Args:
        body: The body of a COMMAND.
    """
    return _COMMAND.unpack(body)


def pack_state(state: State) -> bytes:
    """The body of a STATE.

    Args:
        state: What the bridge reports.
    """
    return _STATE.pack(*state[:-1], *state.values)


def unpack_state(body: bytes) -> State:
    """What a bridge reported; undoes `pack_state`.

    Args:
        body: The body of a STATE.
    """
    numbers = _STATE.unpack(body)
    return State(*numbers[:8], values=numbers[8:])


def pack_description(description: Description) -> bytes:
    """The body of a DESCRIPTION.

    Args:
        description: What a bridge says about its robot.

    Raises:
        ValueError: A name is longer than 40 bytes, there are not twelve joints or not as many
            limits, or the rate is not a whole number.
    """
    if len(description.joints) != JOINTS:
        raise ValueError(f"{description.robot} has {len(description.joints)} joints, not {JOINTS}")
    names = [name.encode() for name in (description.robot, *description.joints)]
    long = [name for name in names if len(name) > _NAME]
    if long:
        raise ValueError(f"the name {long[0]!r} is longer than {_NAME} bytes")
    joints = b"".join(name.ljust(_NAME, b"\0") for name in names[1:])
    numbers = [*description[3:7]]
    for field in description._fields[7:]:
        values = getattr(description, field)
        if len(values) != JOINTS:
            raise ValueError(f"the bridge's {field} has {len(values)} values, not {JOINTS}")
        numbers += values
    try:
        return _DESCRIPTION.pack(names[0], joints, description.rate_hz, *numbers)
    except struct.error as error:
        raise ValueError(f"the bridge's description cannot be sent: {error}") from error


def unpack_description(body: bytes) -> Description:
    """What a bridge said about its robot; undoes `pack_description`.

    Args:
        body: The body of a DESCRIPTION.

    Raises:
        Refused: A name is not text.
    """
    robot, joints, rate_hz, *numbers = _DESCRIPTION.unpack(body)
    try:
        names = tuple(
            joints[start : start + _NAME].rstrip(b"\0").decode()
            for start in range(0, JOINTS * _NAME, _NAME)
        )
        name = robot.rstrip(b"\0").decode()
    except UnicodeDecodeError as error:
        raise Refused("a name that is no text") from error
    limits = [tuple(numbers[start : start + JOINTS]) for start in range(4, 52, JOINTS)]
    return Description(name, names, rate_hz, *numbers[:4], *limits)
