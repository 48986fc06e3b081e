"""The doctor survives what kills a process, and tells a broken part from a missing picture."""

import surefoot.cli.doctor as doctor
from surefoot.cli.doctor import Check, examine, run_check


def test_a_check_that_works_gives_its_last_line():
    assert run_check(Check("toy", "print('first')\nprint('last')", "")) == (True, "last")


def test_a_check_that_raises_gives_the_error():
    assert run_check(Check("toy", "raise ValueError('bad wheel')", "")) == (
        False,
        "ValueError: bad wheel",
    )


def test_a_crash_of_compiled_code_is_reported_not_shared():
    crash = "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)"
    assert run_check(Check("toy", crash, "")) == (False, "the process was killed by signal 11")


def test_only_essential_checks_decide(monkeypatch, capsys):
    fine = Check("fine", "print('ok')", "")
    picture = Check("render", "raise RuntimeError('no EGL')", "install EGL", essential=False)
    monkeypatch.setattr(doctor, "CHECKS", (fine, picture))
    assert examine()
    assert examine("bullet")
    report = capsys.readouterr().out
    assert "no EGL" in report and "mend: install EGL" in report
    broken = Check("plan", "raise ImportError('no pin')", "pip install pin")
    monkeypatch.setattr(doctor, "CHECKS", (fine, broken))
    assert not examine()
    assert "pip install pin" in capsys.readouterr().out


def test_the_second_simulator_is_essential_to_who_asks_for_it(monkeypatch, capsys):
    missing = Check("bullet", "raise ImportError('no wheel')", "use MuJoCo", essential=False)
    monkeypatch.setattr(doctor, "CHECKS", (missing,))
    assert examine()
    assert not examine("bullet")
    assert "no wheel" in capsys.readouterr().out
