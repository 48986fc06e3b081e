"""The command view: what it opens, and what it refuses before it opens anything."""

import signal
import subprocess
import sys
import time

import pytest

from surefoot.cli import view
from tests.fakes.chromium import needs_viser


class Recorder:
    """Stands for the page, and notes what it was made of."""

    made: list = []  # noqa: RUF012
    interrupted = True

    def __init__(self, setup, run, port):
        self.made.append((setup, run, port))
        self.address = "http://127.0.0.1:1"
        self.loop = self
        self.failure = "KeyError: 'hip'"

    def wait(self):
        if self.interrupted:
            raise KeyboardInterrupt

    def close(self):
        self.made.append("closed")


@pytest.fixture
def pages(monkeypatch):
    """The pages that were opened, and the addresses that a browser was sent to."""
    import surefoot.viz.browser

    opened = []
    Recorder.made = []
    monkeypatch.setattr(surefoot.viz.browser, "Page", Recorder)
    monkeypatch.setattr(view.webbrowser, "open", opened.append)
    monkeypatch.setenv("DISPLAY", ":0")
    return Recorder.made, opened


def test_a_run_is_opened_with_its_policy_and_its_episodes(surefoot, pages, run_folder, capsys):
    made, opened = pages
    assert surefoot("view", run_folder, "--port", 8200) == 0
    [(setup, run, port), end] = made
    assert setup.policy is not None
    assert (run, port, end) == (run_folder, 8200, "closed")
    assert opened == ["http://127.0.0.1:1"]
    assert "http://127.0.0.1:1" in capsys.readouterr().out


def test_without_a_target_the_packaged_policy_drives_and_without_a_screen_no_browser_opens(
    surefoot, pages, monkeypatch
):
    made, opened = pages
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert surefoot("view", "--sim", "bullet") == 0
    setup, run, _ = made[0]
    assert setup.policy is not None
    assert run is None
    assert setup.config.simulation.backend == "bullet"
    assert opened == []


@pytest.mark.parametrize(("port", "said"), [(8200, True), (1, False), (0, False)])
def test_another_port_than_the_one_asked_for_is_said(surefoot, pages, capsys, port, said):
    """The fake page is always served at port 1."""
    assert surefoot("view", "--no-browser", "--port", port) == 0
    assert (f"port {port} is taken" in capsys.readouterr().err) is said


def test_the_browser_stays_closed_if_it_is_not_wanted(surefoot, pages):
    assert surefoot("view", "--no-browser") == 0
    assert pages[1] == []


def test_a_page_whose_thread_has_ended_is_closed_and_the_error_said(
    surefoot, pages, monkeypatch, capsys
):
    monkeypatch.setattr(Recorder, "interrupted", False)
    assert surefoot("view", "--no-browser") == 2
    assert "the page has stopped: KeyError: 'hip'" in capsys.readouterr().err
    assert pages[0][-1] == "closed"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (("nowhere",), "no such run folder or policy file"),
        (("--port", 70000), "use 0 to 65535"),
        (("--gait", "troot"), "trot"),
        (("--robot", "solo21"), "solo12"),
    ],
)
def test_what_cannot_be_shown_is_refused(surefoot, pages, capsys, options, reason):
    assert surefoot("view", *options) == 2
    assert reason in capsys.readouterr().err
    assert pages[0] == []


@needs_viser
def test_a_missing_viser_is_named(surefoot, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert surefoot("view", "--no-browser", "--port", 0) == 2
    assert "pip install 'surefoot[viz]'" in capsys.readouterr().err


@needs_viser
@pytest.mark.thorough
@pytest.mark.parametrize("seconds", [1.0, 3.0])
def test_an_interrupted_page_ends_without_a_crash(seconds):
    command = [sys.executable, "-m", "surefoot", "view", "--port", "0", "--no-browser"]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        text=True,
        # As at a terminal, whatever those who run the tests ignore.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as page:
        assert page.stdout is not None
        assert "Ctrl-C ends it" in page.stdout.readline()
        time.sleep(seconds)
        page.send_signal(signal.SIGINT)
        assert page.wait(60) == 0
