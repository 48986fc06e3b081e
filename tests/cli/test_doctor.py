"""The doctor survives what kills a process, and tells a broken part from a missing picture."""

import subprocess
import sys

import numpy
import pytest

import surefoot.cli.doctor as doctor
from surefoot.cli.doctor import (
    CHECKS,
    Check,
    Finding,
    check_cache,
    examine_machine,
    main,
    run_check,
    run_child,
)
from surefoot.cli.extras import Extra
from surefoot.config.json_io import read_json


def run_code(code: str) -> Finding:
    return run_child([sys.executable, "-c", code])


def test_a_child_that_works_gives_its_last_line():
    assert run_code("print('first')\nprint('last')") == Finding(True, "last")


def test_a_child_that_raises_gives_the_error():
    assert run_code("raise ValueError('bad wheel')") == Finding(False, "ValueError: bad wheel")


def test_a_child_without_output_is_told():
    assert run_code("import os; os._exit(1)") == Finding(False, "no output")


def test_a_crash_of_compiled_code_is_reported_not_shared():
    crash = "import os, signal\nos.kill(os.getpid(), signal.SIGSEGV)"
    assert run_code(crash) == Finding(False, "the process was killed by signal 11")


def test_a_child_that_hangs_is_given_up(monkeypatch):
    monkeypatch.setattr(doctor, "TIMEOUT", 0.2)
    assert run_code("import time; time.sleep(60)") == Finding(False, "no answer within 0 s")


def test_a_check_runs_in_a_child_that_ignores_files_of_the_current_folder(monkeypatch, tmp_path):
    (tmp_path / "queue.py").write_text("raise ImportError('of another program')")
    monkeypatch.chdir(tmp_path)
    [check] = [check for check in CHECKS if check.name == "train"]
    finding = run_check(check)
    assert finding.works
    assert finding.line.startswith("torch ")


def test_a_check_that_does_not_exist_lists_those_that_do():
    finding = run_check(Check("trian", lambda: "", ""))
    assert not finding.works
    assert "did you mean 'train'" in finding.line and "render" in finding.line


@pytest.mark.parametrize("name", ["plan", "mujoco", "train"])
def test_each_essential_check_works_here(name, capsys):
    main(name)
    assert len(capsys.readouterr().out.splitlines()) == 1


def test_the_command_line_imports_nothing_that_may_crash():
    code = "import sys, surefoot.cli.main\n"
    code += "compiled = {'pinocchio', 'numba', 'mujoco', 'torch', 'h5py', 'scipy', 'pybullet'}\n"
    code += "print(sorted(compiled & set(sys.modules)))"
    child = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert child.stdout.strip() == "[]"


@pytest.fixture
def findings(monkeypatch) -> dict[str, Finding]:
    """What the checks find, by name; the others work, and no extra is known."""
    monkeypatch.setattr(doctor, "extras", list)
    by_name: dict[str, Finding] = {}
    fine = Finding(True, "fine")
    monkeypatch.setattr(doctor, "run_check", lambda check: by_name.get(check.name, fine))
    return by_name


def test_a_machine_that_works_is_ready(findings, capsys):
    assert examine_machine().ready
    report = capsys.readouterr().out.splitlines()
    for check in CHECKS:
        assert f"ok    {check.name:<9} fine" in report
    assert report[-1] == "surefoot is ready"


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.name)
def test_only_essential_checks_decide(findings, capsys, check):
    findings[check.name] = Finding(False, "no wheel")
    assert examine_machine().ready is not check.essential
    report = capsys.readouterr().out
    assert f"FAIL  {check.name:<9} no wheel\n      fix: {check.remedy}\n" in report


def test_the_report_is_written_for_machines(findings, surefoot, tmp_path, monkeypatch):
    monkeypatch.setattr(doctor, "extras", lambda: [Extra("pybullet", "it", ("pybullet",))])
    findings["render"] = Finding(False, "no driver")
    assert surefoot("doctor", "--json", str(tmp_path / "report.json")) == 0
    report = read_json(tmp_path / "report.json")
    assert report["ready"] is True
    assert report["packages"]["numpy"] == numpy.__version__
    assert report["extras"][0]["missing"] == ["pybullet"]
    states = {part["name"]: part["state"] for part in report["parts"]}
    assert list(states) == [check.name for check in CHECKS]
    assert states == dict.fromkeys(states, "works") | {"bullet": "absent", "render": "fails"}
    assert "apt-get install" in report["parts"][-1]["fix"]
    findings["train"] = Finding(False, "no wheel")
    assert surefoot("doctor", "--json", str(tmp_path / "report.json")) == 1
    assert read_json(tmp_path / "report.json")["ready"] is False


def test_the_simulator_that_is_asked_for_is_essential(findings, surefoot):
    findings["bullet"] = Finding(False, "no wheel")
    assert surefoot("doctor") == 0
    assert surefoot("doctor", "--sim", "bullet") == 1


@pytest.mark.parametrize(
    ("extra", "state"),
    [
        (Extra("pybullet", "", (), available=False), "not made for this Python"),
        (Extra("pybullet", "", ("pybullet",)), "missing: pip install 'surefoot[pybullet]'"),
    ],
)
def test_an_extra_that_is_not_here_is_no_failure(
    findings, surefoot, capsys, monkeypatch, extra, state
):
    """It is optional: only who asks for it is told that it fails."""
    findings["bullet"] = Finding(False, "no wheel")
    monkeypatch.setattr(doctor, "extras", lambda: [extra])
    assert surefoot("doctor") == 0
    report = capsys.readouterr().out
    assert f"none  bullet    {state}\n" in report
    assert "FAIL" not in report and "fix" not in report
    assert surefoot("doctor", "--sim", "bullet") == 1
    assert "FAIL  bullet    no wheel\n" in capsys.readouterr().out


def test_a_missing_library_of_the_system_is_no_reason_to_reinstall(findings, capsys):
    text = "ImportError: libgomp.so.1: cannot open shared object file: No such file or directory"
    findings["plan"] = Finding(False, text)
    assert not examine_machine().ready
    report = capsys.readouterr().out
    assert (
        "fix: a library of the system is missing; on Debian: apt-get install libgomp1\n" in report
    )
    assert "reinstall" not in report


def test_without_a_cache_nothing_else_is_blamed(findings, capsys):
    """All other checks would fail, and advise to reinstall what is in order."""
    findings["cache"] = Finding(False, "no folder")
    findings["plan"] = Finding(False, "no locator available")
    assert not examine_machine().ready
    report = capsys.readouterr().out
    assert "fix: set NUMBA_CACHE_DIR to a folder that you may write to" in report
    assert "reinstall" not in report and "plan" not in report
    assert report.endswith("surefoot cannot work here yet: see above\n")


def test_the_cache_is_named_or_missing(monkeypatch):
    assert check_cache().startswith("compiled functions are kept in ")
    monkeypatch.setattr(doctor, "numba_folder", lambda: None)
    with pytest.raises(RuntimeError, match="no folder that numba tries can be written to"):
        check_cache()
