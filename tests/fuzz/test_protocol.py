"""Bytes from strangers and from a damaged peer: no crash, and nothing moves.

A driven bridge gets damaged copies of everything that its own runtime has sent, and of what it has
sent itself, from a stranger and from the runtime's own address. Whatever comes, the bridge's driver
gets finite commands of the runtime, or damping.
"""

import math

import numpy as np
import pytest
from hypothesis import strategies as st

from surefoot.deploy import protocol
from surefoot.deploy.protocol import Packet, Refused
from tests.fakes.bridge_world import BRIDGE, RUNTIME, STRANGER, TOY, World
from tests.fuzz.mutations import byte_mutations, fuzz

BODIES = {
    protocol.HELLO: b"",
    protocol.DAMP: b"",
    protocol.COMMAND: protocol.pack_command([0.1] * 60),
    protocol.DESCRIPTION: protocol.pack_description(TOY),
    protocol.STATE: protocol.pack_state(protocol.State(0, 0, 1, 0, 0, 0, 0, 0, [0.0] * 50)),
}
"""A body of each kind."""
READERS = {
    protocol.COMMAND: protocol.unpack_command,
    protocol.DESCRIPTION: protocol.unpack_description,
    protocol.STATE: protocol.unpack_state,
}
"""What reads them."""
NUMBERS = st.one_of(st.integers(0, 2**64 - 1), st.sampled_from([0, 1, 2**63, 2**64 - 1]))


def datagram(kind: int, **fields: int) -> bytes:
    packet = Packet(kind, robot_id=1, session=2, sequence=3, time_ns=4, echo_ns=5)
    return protocol.pack(packet._replace(body=BODIES[kind], **fields))


def read(data: bytes) -> None:
    """Read bytes as each side would; only `Refused` may come of it."""
    try:
        packet = protocol.unpack(data)
        if packet.kind in READERS:
            READERS[packet.kind](packet.body)
    except Refused:
        pass


@pytest.mark.parametrize("kind", BODIES)
def test_damaged_datagrams_are_refused(kind):
    whole = datagram(kind)

    def check(damaged: bytes) -> None:
        read(damaged)
        if damaged != whole:
            with pytest.raises(Refused):
                protocol.unpack(damaged)

    fuzz(byte_mutations(whole), check, 200)


def test_any_bytes_are_refused():
    def check(data: bytes) -> None:
        with pytest.raises(Refused):
            protocol.unpack(data)

    fuzz(st.binary(max_size=1500), check, 300)


@st.composite
def sealed(draw: st.DrawFn) -> bytes:
    """A datagram with a valid checksum, whose numbers and body are anything."""
    kind = draw(st.sampled_from(sorted(BODIES)))
    size = len(BODIES[kind])
    body = draw(st.one_of(st.just(BODIES[kind]), st.binary(min_size=size, max_size=size)))
    if kind == protocol.COMMAND:
        special = st.sampled_from([math.nan, math.inf, -math.inf, -1.0, 0.0, 1e308])
        values = draw(st.lists(st.one_of(special, st.floats()), min_size=60, max_size=60))
        body = draw(st.one_of(st.just(body), st.just(protocol.pack_command(values))))
    names = ("robot_id", "session", "sequence", "time_ns", "echo_ns")
    return protocol.pack(Packet(kind=kind, body=body, **{name: draw(NUMBERS) for name in names}))


def test_sealed_datagrams_of_any_content_are_read_or_refused():
    fuzz(sealed(), read, 300)


@pytest.fixture(scope="module")
def heard() -> list[bytes]:
    """Everything that a runtime has sent to another bridge."""
    world = World()
    sent: list[bytes] = []
    send = world.robot._channel.send

    def record(data: bytes, to) -> None:
        sent.append(data)
        send(data, to)

    world.robot._channel.send = record
    world.drive(20)
    return sent


@st.composite
def attacks(draw: st.DrawFn, heard: list[bytes]) -> list[tuple[bool, bytes]]:
    """Datagrams, and whether each comes from the runtime's own address."""
    known = st.sampled_from(heard)
    content = st.one_of(st.binary(max_size=600), sealed(), known, known.flatmap(byte_mutations))
    return draw(st.lists(st.tuples(st.booleans(), content), min_size=1, max_size=20))


def test_a_driven_bridge_obeys_its_runtime_or_damps(heard):
    def check(attack: list[tuple[bool, bytes]]) -> None:
        world = World()
        world.drive(5)
        senders = {True: RUNTIME, False: STRANGER}
        world.network.endpoint(STRANGER)
        for is_own, data in attack:
            world.network.boxes[BRIDGE].append((data, senders[is_own]))
            world.network.boxes[RUNTIME].append((data, BRIDGE if is_own else STRANGER))
            world.tick()
        world.run(30)
        check_written(world)
        assert world.bridge.peer == RUNTIME

    fuzz(attacks(heard), check, 25)


def test_an_idle_bridge_does_not_move_for_anybody(heard):
    def check(attack: list[tuple[bool, bytes]]) -> None:
        world = World()
        world.runtime_runs = False
        world.network.endpoint(STRANGER)
        for is_own, data in attack:
            world.network.boxes[BRIDGE].append((data, RUNTIME if is_own else STRANGER))
            world.tick()
        assert not world.driver.commanded

    fuzz(attacks(heard), check, 25)


def test_a_runtime_that_sends_any_numbers_is_obeyed_only_where_they_are_sound():
    special = st.sampled_from([math.nan, math.inf, -math.inf, -1.0, -0.0, 0.0, 1.0, 1e308])
    numbers = st.one_of(special, st.floats(0.0, 10.0))

    def check(commands: list[list[float]]) -> None:
        world = World()
        world.drive(5)
        for values in commands:
            world.robot._post(protocol.COMMAND, protocol.pack_command(values))
            world.bridge.tick()
            written = world.driver.written[-1]
            assert all(map(math.isfinite, written))
            assert min(written[24:48]) >= 0.0

    command = st.lists(numbers, min_size=60, max_size=60)
    sound = st.just([0.5] * 60)
    fuzz(st.lists(st.one_of(command, sound), min_size=1, max_size=5), check, 25)


def check_written(world: World) -> None:
    """All commands of the driver are finite, and those that move something are the runtime's."""
    nominal = world.policy.nominal
    for command in world.driver.written:
        values = np.array(command)
        assert np.isfinite(values).all()
        if values[24:36].any():
            np.testing.assert_allclose(values[:12], nominal, atol=0.011)
