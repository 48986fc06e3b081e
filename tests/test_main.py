"""The entry point: one thread before anything heavy is loaded, and Ctrl-C while it loads."""

import os
import subprocess
import sys
from ast import literal_eval

import surefoot.__main__
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


def test_ctrl_c_while_the_command_line_is_loaded_ends_quietly(monkeypatch, capsys):
    class Interrupted:
        """Stands for the module, whose import is interrupted."""

        @property
        def main(self):
            raise KeyboardInterrupt

    monkeypatch.setitem(sys.modules, "surefoot.cli.main", Interrupted())
    assert surefoot.__main__.main() == 130
    assert capsys.readouterr() == ("", "")
