"""Datagrams: what is packed comes back, and one wrong bit is refused."""

import numpy as np
import pytest

from surefoot.deploy import protocol
from surefoot.deploy.protocol import Packet, Refused, State
from tests.fakes.bridge_world import TOY

BIG = 2**64 - 1
STATE = State(1, 2, 1, 0xFFFFFFFF, 3, 4, 5, BIG, tuple(np.linspace(-1e300, 1e300, 50)))
BODIES = {
    protocol.HELLO: b"",
    protocol.DESCRIPTION: protocol.pack_description(TOY),
    protocol.COMMAND: protocol.pack_command(np.linspace(-1.0, 1.0, 60).tolist()),
    protocol.DAMP: b"",
    protocol.STATE: protocol.pack_state(STATE),
}


@pytest.mark.parametrize("kind", BODIES)
def test_a_datagram_comes_back_to_the_bit(kind):
    packet = Packet(kind, BIG, BIG - 1, BIG - 2, BIG - 3, BIG - 4, BODIES[kind])
    assert protocol.unpack(protocol.pack(packet)) == packet


@pytest.mark.parametrize("kind", BODIES)
def test_every_wrong_bit_is_refused(kind):
    data = protocol.pack(Packet(kind, 1, 2, 3, 4, 5, BODIES[kind]))
    for bit in range(8 * len(data)):
        damaged = bytearray(data)
        damaged[bit // 8] ^= 1 << (bit % 8)
        with pytest.raises(Refused):
            protocol.unpack(bytes(damaged))


def test_bodies_come_back():
    assert protocol.unpack_state(BODIES[protocol.STATE]) == STATE
    assert protocol.unpack_description(BODIES[protocol.DESCRIPTION]) == TOY
    command = protocol.unpack_command(BODIES[protocol.COMMAND])
    assert command == tuple(np.linspace(-1.0, 1.0, 60))


def test_limits_that_are_infinite_come_back():
    free = TOY._replace(position_low=(-np.inf,) * 12, speed=(np.inf,) * 12)
    assert protocol.unpack_description(protocol.pack_description(free)) == free


def test_datagrams_fit_into_one_frame_of_ethernet():
    assert protocol.LONGEST + 28 <= 1500


def test_names_and_order_and_rate_make_the_number_of_a_robot():
    own = protocol.robot_id(TOY.robot, TOY.joints, TOY.rate_hz)
    permuted = (TOY.joints[1], TOY.joints[0], *TOY.joints[2:])
    others = [
        protocol.robot_id("other", TOY.joints, TOY.rate_hz),
        protocol.robot_id(TOY.robot, permuted, TOY.rate_hz),
        protocol.robot_id(TOY.robot, TOY.joints, 500),
    ]
    assert len({own, *others}) == 4
    assert own == protocol.robot_id("toy", list(TOY.joints), 1000)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"joints": TOY.joints[:11]}, "toy has 11 joints, not 12"),
        ({"robot": "x" * 41}, "is longer than 40 bytes"),
    ],
)
def test_a_description_that_does_not_fit_is_an_error(change, message):
    with pytest.raises(ValueError, match=message):
        protocol.pack_description(TOY._replace(**change))


def test_a_body_of_another_size_is_an_error():
    with pytest.raises(ValueError, match="a datagram of kind 3 has a body of 8 bytes"):
        protocol.pack(Packet(protocol.COMMAND, 0, 0, 0, 0, 0, b"12345678"))


def test_a_name_that_is_no_text_is_refused():
    with pytest.raises(Refused, match="a name that is no text"):
        protocol.unpack_description(b"\xff" * len(BODIES[protocol.DESCRIPTION]))
