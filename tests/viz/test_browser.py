"""The page, driven without a browser and in a real one."""

import logging
import threading
import time

import numpy as np
import pytest
from PIL import Image

from surefoot.config import Config
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing
from surefoot.runs.episode_ids import EpisodeId
from surefoot.sim import make_simulator
from surefoot.types import Command
from surefoot.viz import browser
from surefoot.viz.browser import Page
from surefoot.viz.live import LiveSimulation
from surefoot.viz.live_setup import expert_setup, find_setup
from surefoot.viz.playback import Playback
from tests.fakes.chromium import PATIENCE, Chromium, needs_chromium, needs_viser, wait

pytestmark = needs_viser


@pytest.fixture
def page():
    """A page of a robot that its expert drives."""
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    page = Page(expert_setup(Config(), "solo12", "trot"), port=0)
    yield page
    page.close()


@pytest.fixture(scope="module")
def run_page(queried_run):
    """A page of a run."""
    page = Page(find_setup(queried_run.folder), queried_run.folder, port=0)
    yield page
    page.close()


@pytest.fixture
def pushes(page, monkeypatch):
    """The pushes that the page's robot gets: when [s], how strong [N s] and where to [deg].

    A push is shown for 0.6 s; a browser on a busy machine answers a click later than that.
    """
    received = []
    push = page.live.push

    def remember(size, direction):
        push(size, direction)
        received.append((page.live.snapshot().seconds, size, direction))

    monkeypatch.setattr(page.live, "push", remember)
    return received


def asked(page, question):
    """The answer to a question that is asked in the loop's thread."""
    answers = []
    done = threading.Event()

    def ask():
        answers.append(question())
        done.set()

    page.loop.call(ask)
    assert done.wait(PATIENCE)
    return answers[0]


def test_the_robot_walks_as_the_page_says_and_is_pushed_and_reset(page, pushes):
    assert asked(page, lambda: page.live.snapshot().command) == Command(0.2)
    page.tell(Command(0.1, 0.0, 0.2))
    page.push(0.5, 90.0)
    assert asked(page, lambda: page.live.snapshot().command) == Command(0.1, 0.0, 0.2)
    assert [push[1:] for push in pushes] == [(0.5, 90.0)]
    wait(lambda: asked(page, lambda: page.live.snapshot().seconds) > 0.0)
    page.pause()
    before = asked(page, lambda: page.live.snapshot().seconds)
    assert asked(page, lambda: page.live.snapshot().seconds) == before
    page.reset()
    assert asked(page, lambda: page.live.snapshot().seconds) < before


def test_what_a_page_may_send_is_brought_into_range(page, pushes):
    page._controls._sliders[0].value = 1e9
    page._controls._sliders[2].value = float("nan")
    command = asked(page, lambda: page.live.snapshot().command)
    low, high = page._setup.commands
    assert (command.vx, command.yaw_rate) == (high.vx, low.yaw_rate)
    page._controls._size.value = 1e9
    page._controls._push()
    wait(lambda: pushes)
    assert 0.0 < pushes[0][1] < 5.0


def test_what_cannot_be_done_is_said_and_ends_nothing(page):
    page.let_drive("policy")
    asked(page, lambda: None)
    assert "expert" in page._error
    page.choose("solo12", "troot")
    asked(page, lambda: None)
    assert "troot" in page._error
    assert page._controls._gait.value == "trot"
    assert page.loop.alive


def test_an_error_that_ends_the_page_is_shown_on_it(page, monkeypatch, caplog):
    def fail(snapshot):
        raise KeyError("hip")

    monkeypatch.setattr(page._scene, "show", fail)
    page.loop.wait()
    assert page.loop.failure == "KeyError: 'hip'"
    shown = page._instruments._status.content
    assert "this page has stopped" in shown
    assert "KeyError" in shown
    assert "Traceback" in caplog.text


class Stander:
    """Stands for an expert of any gait: it holds the nominal pose."""

    gait = 0

    def __init__(self, robot):
        self.robot = robot

    def reset(self, batch):
        self.diverged = np.zeros(batch, dtype=bool)

    def torque(self, state, tick, command, mask):
        away = standing(self.robot)[7:] - state.q[:, 7:]
        return 8.0 * away - 0.2 * state.v[:, 6:]


def start_standing(setup):
    """The simulation of a setup with such an expert, which plans nothing."""
    robot = load_robot(setup.config.robot)
    simulator = make_simulator(robot, 1, setup.config.simulation)
    gaits = setup.config.gaits
    live = LiveSimulation(simulator, setup.config.safety, 0.1, Stander(robot), gaits=gaits)
    live.begin_in(setup.begin)
    return live


def test_a_further_gait_is_begun_as_the_robot_goes_on(monkeypatch):
    monkeypatch.setattr(browser, "start", start_standing)
    page = Page(expert_setup(Config(), "solo12", "trot"), port=0)
    try:
        page.tell(Command(0.1))
        wait(lambda: asked(page, lambda: page.live.snapshot().seconds) > 0.1)
        page.choose("solo12", "stand")
        gaits, snapshot = asked(page, lambda: (page._setup.gaits, page.live.snapshot()))
        assert page._error == ""
        assert gaits == ("trot", "stand")
        assert snapshot.seconds > 0.1
        assert (snapshot.asked_gait, snapshot.command) == (1, Command(0.1))
        assert page._controls._gait.value == "stand"
        wait(lambda: asked(page, lambda: page.live.snapshot().gait) == 1)
        wait(lambda: "gait stand" in page._instruments._status.content)
        # The key takes the next one of those that are walked.
        page._controls._next_gait()
        wait(lambda: asked(page, lambda: page.live.asked_gait) == 0)
        assert page._controls._gait.value == "trot"
    finally:
        page.close()


def test_another_robot_is_driven_and_drawn(page):
    page.choose("go2", "trot")
    assert asked(page, lambda: page.live.robot.name) == "go2"
    assert page._scene.robot.name == "go2"
    assert page._controls._robot.value == "go2"
    assert page._instruments._height.scales["y"]["range"][1] > 30.0
    page.choose("solo12", "trot")
    assert asked(page, lambda: page.live.robot.name) == "solo12"


def test_an_episode_is_opened_scrubbed_and_left_again(run_page):
    run_page.open_episode(EpisodeId(1, 0, 1).number)
    assert isinstance(asked(run_page, lambda: run_page.loop.source), Playback)
    run_page.seek(50)
    assert asked(run_page, lambda: run_page.loop.source.now) == 50
    run_page.reset()
    run_page.open_episode(EpisodeId(7, 0).number)
    asked(run_page, lambda: None)
    assert "iteration 7" in run_page._error
    run_page.choose("go2", "trot")
    asked(run_page, lambda: None)
    run_page.open_episode(EpisodeId(1, 0, 1).number)
    assert asked(run_page, lambda: run_page._instruments._height.scales["y"]["range"][1]) < 30.0
    run_page.go_live()
    assert asked(run_page, lambda: run_page.loop.source is run_page.live)


def test_the_chosen_episode_is_that_of_the_list(run_page):
    episodes = run_page._episodes
    episodes._iteration.value = "1"
    episodes._index.value = 1
    assert episodes.chosen == EpisodeId(1, 1).number
    episodes._query.value = "query 2"
    assert episodes.chosen == EpisodeId(1, 1, 2).number
    episodes._index.value = 10_000
    assert EpisodeId.from_number(episodes.chosen).index < 10_000


def colors_of(path):
    """The number of colors in the middle of a picture, where the robot is."""
    picture = Image.open(path).convert("RGB")
    width, height = picture.size
    middle = picture.crop((int(0.35 * width), height // 3, int(0.65 * width), 2 * height // 3))
    return len(np.unique(np.array(middle).reshape(-1, 3), axis=0))


def roll_since(page, seconds):
    """The roll of the robot from a time on, without its sign [deg]."""
    trace = asked(page, lambda: page.live.trace)
    return np.abs(np.degrees(trace[trace[:, 0] >= seconds, 1]))


@needs_chromium
def test_in_chromium_a_pushed_robot_recovers(page, pushes, tmp_path):
    with Chromium(page.address, tmp_path) as browser:
        browser.wait_for("expert drives", "solo12, trot", "real time", "hip abduction")
        wait(lambda: asked(page, lambda: page.live.snapshot().seconds) > 1.0)
        browser.click("Push")
        wait(lambda: pushes)
        pushed_at = pushes[0][0]
        wait(lambda: asked(page, lambda: page.live.snapshot().seconds) > pushed_at + 0.5)
        # At fifty phases of the gait it was 6.9 to 19.1 degrees; without a push it is 0.1.
        assert roll_since(page, pushed_at).max() > 6.0
        browser.press("A")
        wait(lambda: asked(page, lambda: page.live.snapshot().command.yaw_rate > 0.0))
        wait(lambda: asked(page, lambda: page.live.snapshot().seconds) > pushed_at + 2.0)
        assert roll_since(page, pushed_at)[-20:].max() < 6.0
        assert "fell" not in browser.text()
        browser.press("P")
        browser.wait_for("paused")
        time.sleep(2.0)
        picture = browser.screenshot(tmp_path / "page.png")
        assert colors_of(picture) > 200  # shaded parts, marks and tiles
