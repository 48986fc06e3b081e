"""An MPC in another process: what is sent arrives to the bit, and failures say what to do."""

import os
import pickle
import re
import socket
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from surefoot.interop.socket_plan import (
    HEADER,
    PlanServerError,
    SocketPlan,
    answer,
    question,
    read_question,
    serve_plan,
)
from surefoot.methods import METHODS
from surefoot.runs.run import create
from surefoot.types import Command, GaitCommand, MotionPlan, State
from surefoot.workers import Workers
from tests.fakes import toy
from tests.fakes.toy_runs import CONFIG, SMALL_METHODS

RNG = np.random.default_rng(0)
STATE = State(
    RNG.normal(size=19),
    RNG.normal(size=18),
    RNG.normal(size=3),
    RNG.normal(size=(4, 3)),
    np.array([True, False, False, True]),
)
COMMAND = Command(0.1, -0.2, 0.3)
PLAN = MotionPlan(*RNG.normal(size=(3, 100, 12)))
LONG = np.zeros((10_001, 12))


@pytest.fixture
def served():
    """A function that serves a plan function; the plan function that asks it."""
    servers = []

    def serve(plan):
        server = serve_plan(plan)
        servers.append(server)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        return SocketPlan(server.server_address[1], timeout=5.0)

    yield serve
    for server in servers:
        server.shutdown()
        server.server_close()


def test_question_and_answer_arrive_to_the_bit(served):
    asked = []

    def plan(state, tick, command):
        asked.append((state, tick, command))
        return PLAN

    remote = served(plan)
    for _ in range(2):  # over one connection
        got = remote(STATE, 1234, COMMAND)
        assert (got.joint_position == PLAN.joint_position).all()
        assert (got.joint_velocity == PLAN.joint_velocity).all()
        assert (got.torque == PLAN.torque).all()
        assert got.valid
    state, tick, command = asked[1]
    assert (tick, command) == (1234, COMMAND)
    for name in ("q", "v", "com", "feet", "contacts"):
        assert (getattr(state, name) == getattr(STATE, name)).all()


def test_the_layout_is_the_one_that_servers_are_written_for():
    numbers = np.frombuffer(question(STATE, 7, COMMAND), "<f8")
    assert numbers.shape == (60,)
    assert numbers[:4].tolist() == [7.0, 0.1, -0.2, 0.3]
    assert (numbers[4:23] == STATE.q).all()
    assert numbers[56:].tolist() == [1.0, 0.0, 0.0, 1.0]
    content = answer(PLAN)
    assert HEADER.unpack(content[:4]) == (100,)
    rows = np.frombuffer(content[4:], "<f8").reshape(100, 36)
    assert (rows[:, 24:] == PLAN.torque).all()


def test_an_invalid_plan_stays_invalid(served):
    remote = served(lambda *_: MotionPlan(*np.zeros((3, 1, 12)), valid=False))
    assert not remote(STATE, 0, COMMAND).valid


def test_a_copy_in_another_process_has_a_connection_of_its_own(served, monkeypatch):
    remote = served(lambda *_: PLAN)
    remote(STATE, 0, COMMAND)
    copy = pickle.loads(pickle.dumps(remote))
    assert copy._connection is None
    assert copy(STATE, 0, COMMAND).valid

    class Mine(SocketPlan):
        pass

    monkeypatch.setattr(sys.modules[__name__], "Mine", Mine, raising=False)
    Mine.__qualname__ = "Mine"
    assert type(pickle.loads(pickle.dumps(Mine(5)))) is Mine


def test_no_question_gets_the_answer_of_an_interrupted_one(served, monkeypatch):
    """Ctrl-C while it waits, in a notebook that goes on."""

    def numbered(state, tick, command):
        return MotionPlan(*np.full((3, 1, 12), float(tick)), valid=True)

    def interrupt(connection):
        raise KeyboardInterrupt

    remote = served(numbered)
    with monkeypatch.context() as patch:
        patch.setattr("surefoot.interop.socket_plan.read_answer", interrupt)
        with pytest.raises(KeyboardInterrupt):
            remote(STATE, 1, COMMAND)
    assert remote(STATE, 2, COMMAND).torque[0, 0] == 2.0


def test_threads_get_their_own_answers(served):
    remote = served(lambda _, tick, __: MotionPlan(*np.full((3, 1, 12), float(tick)), valid=True))
    with ThreadPoolExecutor(4) as pool:
        plans = list(pool.map(lambda tick: remote(STATE, tick, COMMAND), range(100)))
    assert [plan.torque[0, 0] for plan in plans] == list(range(100))


def test_a_forked_process_has_a_connection_of_its_own(served, monkeypatch):
    remote = served(lambda *_: PLAN)
    remote(STATE, 0, COMMAND)
    first = remote._connection
    monkeypatch.setattr(os, "getpid", lambda: -1)
    remote(STATE, 0, COMMAND)
    assert remote._connection is not first
    assert first is not None and first.fileno() >= 0  # the other process still has it
    first.close()


def test_without_a_server_the_error_says_to_start_it():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with pytest.raises(PlanServerError, match=rf"127.0.0.1:{port} .* start its server"):
        SocketPlan(port)(STATE, 0, COMMAND)


def test_a_server_that_was_started_again_is_asked_over_a_new_connection():
    listener = socket.create_server(("127.0.0.1", 0))
    closed = threading.Event()

    def answer_once_each():
        for _ in range(2):
            connection, _ = listener.accept()
            with connection:
                read_question(connection)
                connection.sendall(answer(PLAN))
            closed.set()

    threading.Thread(target=answer_once_each, daemon=True).start()
    remote = SocketPlan(listener.getsockname()[1], timeout=5.0)
    with listener:
        assert remote(STATE, 0, COMMAND).valid
        assert closed.wait(5.0)
        assert remote(STATE, 0, COMMAND).valid


def test_a_server_that_fails_is_an_error_and_the_next_question_asks_again(served, capsys):
    fails = [True]

    def plan(*_):
        if fails.pop() if fails else False:
            raise ArithmeticError("the solver failed")
        return PLAN

    remote = served(plan)
    with pytest.raises(PlanServerError, match="does not answer"):
        remote(STATE, 0, COMMAND)
    assert remote(STATE, 0, COMMAND).valid


@pytest.mark.parametrize(
    ("planned", "message"),
    [
        (
            replace(PLAN, joint_position=np.zeros((100, 19))),
            r"arrays are \[\(100, 19\), .*expected",
        ),
        (replace(PLAN, torque=np.zeros((99, 12))), r"\(99, 12\)\], expected \(ticks, 12\) each"),
        (replace(PLAN, torque=np.full((100, 12), "1")), "torque is .* real numbers"),
        (MotionPlan(LONG, LONG, LONG), "a plan of 10001 ticks; use at most 10000"),
        (None, "returned NoneType, expected a surefoot.MotionPlan"),
    ],
)
def test_what_is_no_plan_is_not_sent(served, capsys, planned, message):
    remote = served(lambda *_: planned)
    with pytest.raises(PlanServerError, match="look at what it prints"):
        remote(STATE, 1234, COMMAND)
    assert re.search(message, capsys.readouterr().err)


@pytest.mark.parametrize("content", [HEADER.pack(4_000_000_000), b"HTTP/1.1 200 OK"])
def test_an_answer_that_is_no_plan_takes_no_memory(content):
    with socket.create_server(("127.0.0.1", 0)) as server:
        remote = SocketPlan(server.getsockname()[1], timeout=5.0)

        def reply():
            connection, _ = server.accept()
            connection.recv(480)
            connection.sendall(content)

        threading.Thread(target=reply, daemon=True).start()
        with pytest.raises(PlanServerError, match="use at most 10000"):
            remote(STATE, 0, COMMAND)
        assert remote._connection is None  # what is left in it is no beginning of an answer


def test_what_is_left_of_an_answer_is_not_taken_for_the_next_one():
    with socket.create_server(("127.0.0.1", 0)) as server:
        remote = SocketPlan(server.getsockname()[1], timeout=5.0)
        sent = threading.Event()
        asked_again = threading.Event()

        def reply():
            connection, _ = server.accept()
            connection.recv(480)
            connection.sendall(HEADER.pack(1) + bytes(8 * 43))  # 19 positions instead of 12
            sent.set()
            asked_again.wait(5.0)

        threading.Thread(target=reply, daemon=True).start()
        assert remote(STATE, 0, COMMAND).valid
        assert sent.wait(5.0)
        with pytest.raises(PlanServerError, match="longer than the number of ticks"):
            remote(STATE, 0, COMMAND)
        asked_again.set()
        assert remote._connection is None


def test_a_method_learns_the_same_bits_from_an_mpc_behind_a_socket(toys, served, tmp_path):
    config = replace(CONFIG, method=SMALL_METHODS["behavior_cloning"])
    hashes = []
    for name, plan in (("here", toy.plan), ("there", served(toy.plan))):
        run = create(tmp_path / name, config)
        METHODS[run.method].train(run, Workers(1), plan)
        hashes.append(run.dataset.hash)
    assert hashes[0] == hashes[1]


def test_another_gait_is_refused_instead_of_dropped_and_has_a_server_of_its_own(served):
    plans = [served(lambda *_: PLAN), served(lambda *_: replace(PLAN, torque=2.0 * PLAN.torque))]
    command = GaitCommand(0.1, gait=1)
    with pytest.raises(ValueError, match=r"gait number 1, .* has no gait: start a server for each"):
        plans[0](STATE, 0, command)
    # As the message says.
    got = plans[command.gait](STATE, 0, Command(*command))
    assert (got.torque == 2.0 * PLAN.torque).all()
    assert (plans[0](STATE, 0, GaitCommand(0.1)).torque == PLAN.torque).all()
