"""The entry point: one thread before anything heavy is loaded, and Ctrl-C while it loads."""

import os
import signal
import subprocess
import sys
from ast import literal_eval

import pytest

import surefoot.__main__
from surefoot.__main__ import PATIENCE, Interrupt
from surefoot.errors import HangUp
from surefoot.workers import ONE_THREAD


def test_the_command_line_has_one_thread_before_numpy_is_loaded():
    code = "import sys, surefoot.__main__, os; print('numpy' in sys.modules, dict(os.environ))"
    environment = {name: value for name, value in os.environ.items() if name not in ONE_THREAD}
    run = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    loaded, variables = run.stdout.split(" ", 1)
    assert loaded == "False"
    assert literal_eval(variables).items() >= ONE_THREAD.items()


def test_python_m_surefoot_is_the_command_line():
    command = [sys.executable, "-m", "surefoot", "--help"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0
    assert "surefoot" in run.stdout


@pytest.mark.parametrize("hidden", [False, True])
def test_ctrl_c_while_the_command_line_is_loaded_ends_quietly(monkeypatch, capsys, hidden):
    class Interrupted:
        """Stands for the module, whose import is interrupted."""

        @property
        def main(self):
            if hidden:  # as by an extension whose loading it ends
                raise ImportError("initialization failed") from KeyboardInterrupt()
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "surefoot.cli.main", Interrupted())
    monkeypatch.setattr(signal, "signal", lambda number, answer: None)
    assert surefoot.__main__.main() == 130
    assert capsys.readouterr() == ("", "")


def test_only_the_first_interrupt_is_heard_while_the_command_ends(monkeypatch):
    """The one after a while ends a process that hangs."""
    now = [100.0]
    ended = []
    monkeypatch.setattr(surefoot.__main__, "monotonic", lambda: now[0])
    monkeypatch.setattr(os, "_exit", ended.append)
    with pytest.raises(HangUp):
        Interrupt()(signal.SIGHUP, None)
    interrupt = Interrupt()
    with pytest.raises(KeyboardInterrupt) as raised:
        interrupt(signal.SIGINT, None)
    assert raised.type is KeyboardInterrupt
    interrupt(signal.SIGTERM, None)
    now[0] += PATIENCE
    interrupt(signal.SIGINT, None)
    assert ended == []
    now[0] += 0.1
    interrupt(signal.SIGINT, None)
    assert ended == [130]


LATE = """
import os, signal, sys
import surefoot.__main__ as entry
import surefoot.cli.main as command_line
command_line.main = lambda: 0
settle = entry.leave_signals
def late(status):
    entry.leave_signals = settle
    os.kill(os.getpid(), signal.SIGTERM)
    signal.getsignal(signal.SIGTERM)  # where Python answers it
    settle(status)
entry.leave_signals = late
sys.exit(entry.main())
"""


def test_an_interrupt_just_after_the_command_has_ended_changes_nothing():
    run = subprocess.run([sys.executable, "-c", LATE], capture_output=True, text=True)
    assert (run.returncode, run.stdout, run.stderr) == (0, "", "")


TWICE = """
import os, signal, sys, threading
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)
import surefoot.__main__ as entry
import surefoot.cli.main as command_line

def command():
    # Python waits for this thread when it ends, as it does for those of processes.
    threading.Thread(target=lambda: (ending.wait(), again())).start()
    try:
        os.kill(os.getpid(), signal.{first})
        threading.Event().wait(10)
    finally:
        again()

def again():
    os.kill(os.getpid(), signal.{second})

ending = threading.Event()
command_line.parse = lambda args: command
sys.argv = ["surefoot", "walk"]
status = entry.main()
ending.set()
sys.exit(status)
"""


@pytest.mark.parametrize("first", ["SIGINT", "SIGTERM", "SIGHUP"])
@pytest.mark.parametrize("second", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_a_second_interrupt_changes_neither_words_nor_status(first, second):
    code = TWICE.format(first=first, second=second)
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (child.returncode, child.stderr) == (130, "\ninterrupted\n")


@pytest.mark.parametrize("name", ["SIGINT", "SIGHUP"])
def test_a_process_in_the_background_ignores_ctrl_c_and_one_of_nohup_its_end(name):
    code = "import signal, surefoot.__main__ as entry\n"
    code += f"signal.signal(signal.{name}, signal.SIG_IGN)\n"
    code += "for step in (entry.answer_signals, lambda: entry.leave_signals(0)):\n"
    code += "    step()\n"
    code += f"    assert signal.getsignal(signal.{name}) == signal.SIG_IGN"
    subprocess.run([sys.executable, "-c", code], check=True)
