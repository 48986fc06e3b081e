"""Chunks over processes: order, dead workers, errors, and no process left after Ctrl-C."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from surefoot.workers import (
    ONE_THREAD,
    PROCESSES_PER_CORE,
    RETRIES,
    Workers,
    _join,
    _listed,
    default_workers,
    each_chunk,
    map_chunks,
)


def square(number):
    return number**2


def slow_first(number):
    time.sleep(0.3 if number == 0 else 0.0)
    return number, os.getpid()


def count_and_die(argument):
    """Leaves a mark for every try, and dies in the first ``deaths`` of them."""
    number, folder, deaths = argument
    tries = len(list(folder.glob(f"{number}.*")))
    (folder / f"{number}.{tries}").touch()
    if tries < deaths:
        os._exit(3)
    return 10 * number


def refuse(number):
    if number == 3:
        raise LookupError(f"no chunk {number}")
    return number


@pytest.mark.parametrize("workers", [1, 2])
def test_results_come_in_the_order_of_the_chunks(workers):
    squares = map_chunks(square, list(range(7)), Workers(workers), "squares")
    assert squares == [0, 1, 4, 9, 16, 25, 36]
    results = map_chunks(slow_first, list(range(6)), Workers(workers), "slow")
    assert [number for number, _ in results] == list(range(6))
    assert (os.getpid() in {pid for _, pid in results}) == (workers == 1)


@pytest.mark.parametrize("workers", [1, 2])
def test_no_chunks_give_no_results(workers):
    assert map_chunks(square, [], Workers(workers), "nothing") == []


def test_a_single_chunk_stays_in_this_process():
    assert map_chunks(slow_first, [5], Workers(4), "one") == [(5, os.getpid())]


def test_a_chunk_whose_process_dies_is_run_again(tmp_path):
    chunks = [(number, tmp_path, 1 if number == 2 else 0) for number in range(5)]
    assert map_chunks(count_and_die, chunks, Workers(2), "dies once") == [0, 10, 20, 30, 40]
    assert len(list(tmp_path.glob("2.*"))) == 2
    # And the next call has a pool that works.
    assert map_chunks(square, [1, 2, 3], Workers(2), "after") == [1, 4, 9]


def test_a_worker_that_dies_is_logged(tmp_path, caplog):
    chunks = [(number, tmp_path, 1 if number == 2 else 0) for number in range(5)]
    map_chunks(count_and_die, chunks, Workers(2), "dies once")
    assert re.search(r"dies once: a worker died; run again: chunks? .*2", caplog.text)
    assert {record.name for record in caplog.records} == {"surefoot.workers"}


def test_chunks_are_listed_in_order_with_their_number():
    assert _listed([3]) == "chunk 3"
    assert _listed([12, 1, 3]) == "chunks 1, 3, 12"


def test_no_chunk_is_lost_when_its_pool_breaks_between_two_results(tmp_path):
    """The next chunk is handed to a pool that broke while a result was being stored."""
    chunks = [(number, tmp_path, 1 if number == 1 else 0) for number in range(8)]
    results = each_chunk(count_and_die, chunks, Workers(2), "breaks")
    arrived = dict([next(results)])
    while not list(tmp_path.glob("1.*")):
        time.sleep(0.01)
    time.sleep(1.0)  # for the executor to notice
    arrived.update(results)
    assert arrived == {number: 10 * number for number in range(8)}


def die_beside_others(argument):
    number, folder = argument
    if number == 1:
        (folder / f"{time.monotonic_ns()}.tried").touch()
        time.sleep(0.1)
        os._exit(3)
    time.sleep(0.5)
    return number


def test_a_chunk_that_always_dies_is_an_error_that_names_it(tmp_path):
    """The others that were in progress are not blamed."""
    chunks = [(number, tmp_path) for number in range(3)]
    with pytest.raises(RuntimeError, match="always: a worker died 3 times while chunk 1 was in p"):
        map_chunks(die_beside_others, chunks, Workers(2), "always")
    assert len(list(tmp_path.glob("*.tried"))) == RETRIES + 1


def test_results_before_an_error_are_handed_over(tmp_path):
    chunks = [(number, tmp_path, 100 if number == 5 else 0) for number in range(6)]
    stored = []
    with pytest.raises(RuntimeError, match="while chunk 5 was in progress"):
        for number, result in each_chunk(count_and_die, chunks, Workers(2), "stored"):
            assert result == 10 * number
            stored.append(number)
    assert sorted(stored) == [0, 1, 2, 3, 4]


class TwoWordsError(Exception):
    """Cannot be unpickled: its arguments are not those of its constructor."""

    def __init__(self, first, second):
        super().__init__(first)


def refuse_in_two_words(folder):
    (folder / f"{time.monotonic_ns()}.tried").touch()
    raise TwoWordsError("one", "two")


def test_an_error_that_cannot_be_unpickled_is_no_death(tmp_path):
    with pytest.raises(RuntimeError, match="picklable"):
        map_chunks(refuse_in_two_words, [tmp_path] * 2, Workers(2), "two words")
    assert len(list(tmp_path.glob("*.tried"))) <= 2


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_in_a_chunk_is_passed_on(workers):
    with pytest.raises(LookupError, match="no chunk 3"):
        map_chunks(refuse, list(range(6)), Workers(workers), "refuses")
    assert map_chunks(square, [4, 5], Workers(workers), "after") == [16, 25]


def first_waits_for_others(argument):
    """The first chunk ends only after all others, however slow the machine is."""
    number, folder = argument
    while number == 0 and len(list(folder.iterdir())) < 3:
        time.sleep(0.01)
    if number:
        (folder / str(number)).touch()
    return number


def test_results_are_handed_over_as_they_arrive(tmp_path):
    """The others do not wait for the first chunk."""
    chunks = [(number, tmp_path) for number in range(4)]
    results = each_chunk(first_waits_for_others, chunks, Workers(2), "any order")
    arrived = [number for number, _ in results]
    assert sorted(arrived) == [0, 1, 2, 3]
    assert arrived[0] != 0


def mark(argument):
    number, folder = argument
    (folder / str(number)).touch()
    return number


def test_few_chunks_are_in_progress_at_a_time(tmp_path):
    """However slowly the results are taken."""
    chunks = [(number, tmp_path) for number in range(20)]
    for taken, _ in enumerate(each_chunk(mark, chunks, Workers(2), "few"), 1):
        time.sleep(0.02)
        assert len(list(tmp_path.iterdir())) <= taken + 4
    assert taken == 20


def threads(_):
    return {name: os.environ.get(name) for name in ONE_THREAD}


def test_workers_have_one_thread_each():
    assert set(ONE_THREAD.values()) == {"1"}
    assert map_chunks(threads, [0, 1], Workers(2), "threads") == [ONE_THREAD] * 2


def test_no_workers_is_an_error():
    with pytest.raises(ValueError, match="0 workers; use at least 1"):
        Workers(0)


def test_the_default_is_one_worker_for_each_core_that_may_be_used():
    assert default_workers() == len(os.sched_getaffinity(0)) >= 1


SCRIPT = """
import os, signal, sys, time
from pathlib import Path

def sleep(folder):
    (Path(folder) / f"{os.getpid()}.pid").touch()
    time.sleep(120)

if __name__ == "__main__":
    from surefoot.workers import Workers, map_chunks
    # Tests that are started in the background have children that ignore Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        map_chunks(sleep, [sys.argv[1]] * 4, Workers(2), "asleep")
    except KeyboardInterrupt:
        (Path(sys.argv[1]) / "interrupted").touch()
        raise
"""


def alive(pid: int) -> bool:
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except FileNotFoundError:
        return False


def holds_back_ctrl_c(pid: int) -> bool:
    blocked = Path(f"/proc/{pid}/status").read_text().split("SigBlk:")[1].split()[0]
    return bool(int(blocked, 16) & 1 << (signal.SIGINT - 1))


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_no_worker_outlives_the_parent_after_ctrl_c_or_a_kill(tmp_path, ending):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)

    def until(condition):
        for _ in range(600):
            if condition():
                return True
            time.sleep(0.1)
        return False

    process = subprocess.Popen(
        [sys.executable, str(script), str(tmp_path)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        assert until(lambda: len(list(tmp_path.glob("*.pid"))) == 2)
        pids = [int(path.stem) for path in tmp_path.glob("*.pid")]
        assert process.pid not in pids
        assert all(alive(pid) for pid in pids)
        # A terminal sends Ctrl-C to all; only the parent answers.
        assert all(holds_back_ctrl_c(pid) for pid in pids)
        assert not holds_back_ctrl_c(process.pid)
        process.send_signal(ending)
        # The chunks sleep for two minutes: a worker that is gone before was ended.
        assert process.wait(timeout=60) != 0
        assert (tmp_path / "interrupted").exists() == (ending == signal.SIGINT)
        assert until(lambda: not any(alive(pid) for pid in pids))
    finally:
        process.kill()
        process.wait()


def mark_and_sleep(argument):
    number, folder = argument
    (folder / f"{number}.{os.getpid()}").touch()
    time.sleep(0.0 if number == 0 else 2.0)
    return number


def test_workers_outlive_the_thread_that_started_them(tmp_path, caplog):
    """The processes of a thread are its own: another thread takes over what they have begun."""
    chunks = [(number, tmp_path) for number in range(3)]
    results = each_chunk(mark_and_sleep, chunks, Workers(2), "taken over")
    first = []
    thread = threading.Thread(target=lambda: first.append(next(results)))
    thread.start()
    thread.join()
    assert dict([*first, *results]) == {0: 0, 1: 1, 2: 2}
    assert len(list(tmp_path.iterdir())) == 3  # none was run twice
    assert "died" not in caplog.text


def test_a_number_of_workers_far_above_the_cores_is_not_started(monkeypatch):
    assert Workers(1).started == 1
    assert Workers(100_000).started == PROCESSES_PER_CORE * default_workers()
    monkeypatch.setattr("surefoot.workers.default_workers", lambda: 1)
    results = map_chunks(slow_first, list(range(8)), Workers(100_000), "many")
    assert len({pid for _, pid in results}) <= PROCESSES_PER_CORE


@pytest.mark.parametrize(
    ("address", "reason"), [("127.0.0.1:1", "Connection refused"), ("127.0.0.1:99999", "Port")]
)
def test_an_address_where_nothing_listens_is_refused_at_once(address, reason):
    with pytest.raises(ValueError, match=rf"no Ray cluster at '{address}' \(.*{reason}.*start"):
        _join(address, pytest.fail)


def test_a_cluster_that_does_not_answer_is_given_up(monkeypatch):
    monkeypatch.setattr("surefoot.workers.RAY_TIMEOUT", 0.1)
    silent = threading.Event()
    with pytest.raises(ValueError, match=r"no Ray cluster at 'auto' \(no answer within 0 s\)"):
        _join("auto", lambda address: silent.wait())
    silent.set()


def test_what_connecting_raises_is_passed_on():
    def connect(address):
        raise RuntimeError(f"{address} has another version")

    with pytest.raises(RuntimeError, match="auto has another version"):
        _join("auto", connect)
    _join("auto", str)  # and what works, works


def test_whoever_has_enough_leaves_the_processes_to_others():
    results = each_chunk(square, list(range(20)), Workers(2), "enough")
    next(results)
    results.close()
    assert map_chunks(square, [4, 5], Workers(2), "after") == [16, 25]
