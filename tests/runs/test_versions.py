"""Versions that are written into a run: what is named, and what is missing."""

import platform

from surefoot.runs import versions as module
from surefoot.runs.versions import PACKAGES, installed, processor, versions


def test_python_processor_and_every_package_have_a_version():
    by_name = versions()
    assert list(by_name) == ["python", "processor", *PACKAGES]
    assert by_name["python"] == platform.python_version()
    assert by_name["processor"] == processor() != ""
    assert by_name["numpy"][0].isdigit()


def test_pybullet_counts_only_where_it_is_the_simulator():
    assert versions("bullet").keys() - versions("mujoco").keys() == {"pybullet"}


def test_a_package_that_is_not_installed_is_missing(monkeypatch):
    monkeypatch.setattr(module, "PACKAGES", ("numpy", "no-such-package"))
    assert versions()["no-such-package"] == "missing"
    assert installed("no-such-package") is None
    assert installed("numpy") == versions()["numpy"]


CPUINFO = (
    "processor\t: 0\ncpu family\t: 6\nmodel\t\t: 167\nmodel name\t: Xeon @ 2.8\nmodel name\t: B\n"
)


def test_the_processor_is_named_by_model_name_family_and_model(monkeypatch):
    monkeypatch.setattr(module.Path, "read_text", lambda _: CPUINFO)
    assert processor() == "Xeon @ 2.8, 6, 167"


def test_on_arm_it_is_named_by_implementer_and_part(monkeypatch):
    text = "processor\t: 0\nCPU implementer\t: 0x41\nCPU part\t: 0xd42\n"
    monkeypatch.setattr(module.Path, "read_text", lambda _: text)
    assert processor() == "0x41, 0xd42"
    monkeypatch.setattr(module.Path, "read_text", lambda _: "processor\t: 0\n")
    assert processor() == platform.machine()


def test_where_linux_says_nothing_the_machine_is_named(monkeypatch):
    def missing(_):
        raise FileNotFoundError

    monkeypatch.setattr(module.Path, "read_text", missing)
    assert processor() == platform.machine()
