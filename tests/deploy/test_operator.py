"""The operator: lines of text, the end of the input, signs of life."""

import errno
import os
import sys

import pytest

from surefoot.deploy.operator import Scripted, Terminal, Vocabulary, Wish, obey
from surefoot.types import Command
from tests.fakes.bridge_world import Clock

HERE = Wish(False, Command(0.1))
TWO_GAITS = Vocabulary(gaits=("trot", "bound"))
UNSTEERED = Vocabulary(steers=False, gaits=("trot", "bound"))


@pytest.mark.parametrize(
    ("line", "wish"),
    [
        ("start", HERE._replace(go=True)),
        (" START ", HERE._replace(go=True)),
        ("vx 0.25", HERE._replace(command=Command(0.25))),
        ("vy -0.1", HERE._replace(command=Command(0.1, -0.1))),
        ("yaw 1", HERE._replace(command=Command(0.1, 0.0, 1.0))),
        ("", HERE),
        ("vx", HERE),
        ("vx fast", HERE),
        ("vx nan", HERE),
        ("vx inf", HERE),
        ("start now", HERE),
        ("vz 1", HERE),
        ("gait bound", HERE._replace(gait=1)),
        (" Gait TROT ", HERE._replace(gait=0)),
        ("gait", HERE),
        ("gait pronk", HERE),
        ("gait 1", HERE),
    ],
)
def test_a_line_changes_what_it_says_or_nothing(line, wish):
    assert obey(HERE, line, TWO_GAITS) == wish


def test_a_line_that_means_nothing_is_named_and_an_empty_one_is_not(caplog):
    obey(HERE, "stpo\n", Vocabulary())
    assert "'stpo' means nothing; type start, stop" in caplog.text
    assert "gait" not in caplog.text
    caplog.clear()
    obey(HERE, "", Vocabulary())
    assert not caplog.text


def test_who_does_not_steer_changes_no_command_and_is_told_so(caplog):
    for line in ("vx 0.25", "vy -0.1", "yaw 1", "gait bound"):
        assert obey(HERE, line, UNSTEERED) == HERE
        assert f"'{line}' means nothing; type start, stop, stand or walk; the velo" in caplog.text
    assert obey(HERE, "start", UNSTEERED).go


def test_a_gait_that_the_policy_does_not_walk_is_named_with_those_that_it_does(caplog):
    assert obey(HERE, "gait pronk", TWO_GAITS) == HERE
    assert "'gait pronk' means nothing" in caplog.text
    assert "gait NAME, which is one of trot, bound" in caplog.text


def test_stop_is_obeyed():
    for line in ("stop", "stop!", "stop now", "\x1b[Astop", "STOP"):
        assert obey(Wish(True, Command()), line, Vocabulary()).go is False


def test_a_stop_of_a_damped_robot_says_what_ends_the_program(caplog):
    obey(Wish(False, Command()), "stop", Vocabulary())
    assert caplog.messages == ["the robot is damped already; Ctrl-C ends the program"]


def test_of_a_stop_and_a_start_that_come_together_the_stop_counts(pipe):
    operator = Terminal(Command(), descriptor=pipe[0])
    os.write(pipe[1], b"stop\nstart\n")
    assert not operator.wish().go
    os.write(pipe[1], b"start\n")
    assert operator.wish().go


@pytest.fixture
def pipe():
    reader, writer = os.pipe()
    yield reader, writer
    os.close(reader)


def test_at_a_terminal_that_does_not_steer_a_command_changes_nothing(pipe):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader, vocabulary=UNSTEERED)
    os.write(writer, b"vx 0.1\nstart\n")
    assert operator.wish() == Wish(True, Command())


def test_a_terminal_is_read_as_it_comes(pipe):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader)
    assert operator.wish() == Wish(False, Command())
    os.write(writer, b"sta")
    assert not operator.wish().go
    os.write(writer, b"rt\nvx 0.1\nvx ")
    assert operator.wish() == Wish(True, Command(0.1))
    os.write(writer, b"0.2\n")
    assert operator.wish().command == Command(0.2)
    os.close(writer)
    assert operator.wish() == Wish(False, Command(0.2), "the operator's input has ended")
    assert operator.wish().lost


def test_a_terminal_without_any_input_is_refused(monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    with pytest.raises(ValueError, match=r"no standard input.*use a descriptor"):
        Terminal(Command())


def test_a_terminal_of_several_gaits_begins_in_one_and_asks_for_another(pipe):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader, vocabulary=TWO_GAITS, gait=1)
    assert operator.wish() == Wish(False, Command(), gait=1)
    os.write(writer, b"start\ngait trot\nvx 0.1\n")
    assert operator.wish() == Wish(True, Command(0.1), gait=0)


def test_after_a_halt_only_another_start_starts(pipe):
    reader, writer = pipe
    clock = Clock()
    operator = Terminal(Command(), heartbeat=1.0, clock=clock, descriptor=reader)
    os.write(writer, b"start\n")
    assert operator.wish().go
    # The robot is damped for long; what is typed meanwhile is old when it can be started again.
    clock.advance(60_000)
    os.write(writer, b"start\nvx 0.2\nsta")
    operator.halt()
    assert operator.wish() == Wish(False, Command(0.2))
    os.write(writer, b"rt\n")
    assert not operator.wish().go
    os.write(writer, b"start\n")
    assert operator.wish().go
    os.close(writer)


def test_a_robot_is_told_to_stand_and_to_walk_on(pipe):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader)
    os.write(writer, b"start\nstand\n")
    assert operator.wish() == Wish(True, Command(), rest=True)
    os.write(writer, b"walk\n")
    assert operator.wish() == Wish(True, Command())
    os.close(writer)


@pytest.mark.parametrize("ending", ["stop", "fault"])
def test_a_robot_that_was_to_stand_walks_after_the_next_start(pipe, ending):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader)
    os.write(writer, b"start\nstand\n")
    assert operator.wish().rest
    os.write(writer, b"stop\n" if ending == "stop" else b"stand\n")
    if ending == "fault":
        operator.halt()
    assert operator.wish() == Wish(False, Command())
    os.write(writer, b"start\n")
    assert operator.wish() == Wish(True, Command())
    os.close(writer)


def test_bytes_that_are_no_text_start_nothing_and_take_no_memory(pipe):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader)
    for _ in range(20):
        os.write(writer, bytes(range(128, 256)))
        assert operator.wish() == Wish(False, Command())
    assert len(operator._text) <= 200
    os.close(writer)


def test_a_sign_of_life_that_does_not_come_is_a_loss_once_the_robot_is_driven(pipe):
    reader, writer = pipe
    clock = Clock()
    operator = Terminal(Command(), heartbeat=0.5, clock=clock, descriptor=reader)
    clock.advance(5000)
    assert not operator.wish().lost
    os.write(writer, b"start\n")
    assert operator.wish().go
    clock.advance(400)
    os.write(writer, b"\n")
    assert operator.wish().go
    clock.advance(500)
    assert operator.wish().go
    clock.advance(1)
    assert operator.wish().lost == "the operator has given no sign of life for 0.50 s"
    os.close(writer)


def test_a_script_starts_at_once_and_stops_in_time():
    clock = Clock()
    operator = Scripted(Command(0.3), 2.0, clock, gait=1)
    assert operator.wish() == Wish(True, Command(0.3), gait=1)
    clock.advance(1999)
    assert operator.wish().go
    clock.advance(1)
    assert operator.wish() == Wish(False, Command(0.3), gait=1, over=True)


def test_a_writer_that_never_stops_does_not_delay_a_tick(pipe, monkeypatch):
    reader, writer = pipe
    reads = []

    def read(descriptor, size):
        reads.append(size)
        assert len(reads) < 1000, "it reads for ever"
        return b"\n" * size

    operator = Terminal(Command(), descriptor=reader)
    os.write(writer, b"\n")
    monkeypatch.setattr(os, "read", read)
    operator.wish()
    assert len(reads) == 1


def test_a_halt_forgets_much_that_was_typed(pipe):
    reader, writer = pipe
    operator = Terminal(Command(), descriptor=reader)
    os.write(writer, b"start\n" * 500)
    operator.halt()
    assert not any(operator.wish().go for _ in range(10))


def test_a_terminal_that_has_been_closed_is_a_lost_operator(pipe, monkeypatch):
    reader, writer = pipe

    def read(descriptor, size):
        raise OSError(errno.EIO, "Input/output error")

    operator = Terminal(Command(), descriptor=reader)
    os.close(writer)
    monkeypatch.setattr(os, "read", read)
    assert operator.wish().lost == "the operator's input has ended"


@pytest.mark.parametrize("word", ["stop", "STOP"])
@pytest.mark.parametrize("before", [b"", b"x" * 150])
def test_a_stop_is_heard_however_long_its_line_becomes(pipe, word, before):
    reader, writer = pipe
    terminal = Terminal(Command(), descriptor=reader, clock=Clock())
    os.write(writer, b"start\n")
    assert terminal.wish().go
    os.write(writer, before + word.encode())
    for _ in range(20):
        os.write(writer, b" " * 100)
        terminal.wish()
    os.write(writer, b"\n")
    for _ in range(20):
        terminal.wish()
    assert not terminal.wish().go
