"""The processes that draw: their pictures, and what is left when one fails."""

import sys
from io import BytesIO
from subprocess import PIPE

import numpy as np
import pytest

import surefoot.viz.renderer as renderer
from surefoot.config import SimulationConfig
from surefoot.config.sim import parse_terrains
from surefoot.files import WriteError
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.sim.terrain import Ground
from surefoot.viz.renderer import RenderingUnavailable, child_process, pictures


def run_child(code: str) -> bytes:
    with child_process([sys.executable, "-c", code], "It failed", stdout=PIPE) as child:
        return child.stdout.read()


def test_pictures_show_each_configuration_from_its_camera():
    robot = solo12()
    q = np.tile(standing(robot), (3, 1))
    q[2, 0] += 0.1
    camera = np.tile([0.0, 0.0, 0.1, 0.8, 90.0, -10.0], (3, 1))
    try:
        drawn = list(pictures(robot, SimulationConfig(), q, camera, (64, 48)))
    except RenderingUnavailable as error:
        pytest.skip(str(error))
    first, same, moved = (np.array(picture).astype(int) for picture in drawn)
    assert first.shape == (48, 64, 3)
    np.testing.assert_allclose(first, same, atol=2)
    assert np.abs(moved - first).mean() > 1.0


def test_pictures_show_the_ground():
    robot = solo12()
    q = standing(robot)[None]
    camera = np.array([[0.0, 0.0, 0.1, 0.8, 90.0, -10.0]])
    place = (np.zeros((1, 3)), np.zeros(1))
    grounds = [Ground(parse_terrains(text), *place) for text in ("flat", "slope:20", "bumps:0.1")]
    drawn = []
    for ground in (None, *grounds):
        try:
            drawn += pictures(robot, SimulationConfig(), q, camera, (64, 48), ground=ground)
        except RenderingUnavailable as error:
            pytest.skip(str(error))
    plane, flat, slope, bumps = (np.array(picture).astype(int) for picture in drawn)
    assert np.abs(flat - plane).mean() < 1.0
    assert np.abs(slope - plane).mean() > 3.0
    assert np.abs(bumps - plane).mean() > 3.0
    assert np.abs(bumps - slope).mean() > 3.0


@pytest.mark.thorough
def test_the_pictures_are_the_same_for_any_number_of_processes(monkeypatch):
    robot = solo12()
    count = 20
    q = np.tile(standing(robot), (count, 1))
    q[:, 0] += 0.3 * np.arange(count)  # far enough that MuJoCo moves the floor under the camera
    q[:, 8] += 0.02 * np.arange(count)
    camera = np.tile([0.0, 0.0, 0.1, 0.8, 90.0, -10.0], (count, 1))
    camera[:, 0] = q[:, 0]
    camera[:, 4] += 3.0 * np.arange(count)
    drawn = []
    for workers, threads in ((1, "2"), (2, "0"), (3, "1")):
        monkeypatch.setenv("LP_NUM_THREADS", threads)
        drawing = pictures(robot, SimulationConfig(), q, camera, (96, 64), workers)
        try:
            drawn.append([picture.tobytes() for picture in drawing])
        except RenderingUnavailable as error:
            pytest.skip(str(error))
    assert len(drawn[0]) == len(set(drawn[0])) == count
    assert drawn[1] == drawn[0]
    assert drawn[2] == drawn[0]


def stand_in(fails_at: int, closed: list[int]):
    """Stand in for the processes: one fails at a picture, and the others are ended."""

    def drawn_elsewhere(share, cores):
        _, qpos, _, (width, height) = share
        first = round(qpos[0, 0])
        try:
            yield b""
            for row in qpos:
                if round(row[0]) == fails_at:
                    raise RenderingUnavailable(f"it crashed at {fails_at}")
                yield bytes([round(row[0])]) * (3 * width * height)
        except GeneratorExit:
            closed.append(first)
            raise

    return drawn_elsewhere


@pytest.mark.parametrize(("workers", "processes"), [(1, 1), (2, 2), (3, 3), (5, 3)])
def test_processes_draw_in_turn_and_each_has_enough_to_do(monkeypatch, workers, processes):
    shares = []
    whole = stand_in(-1, [])

    def counted(share, cores):
        shares.append(len(share[1]))
        return whole(share, cores)

    monkeypatch.setattr(renderer, "_drawn_elsewhere", counted)
    robot = solo12()
    q = np.tile(standing(robot), (20, 1))
    q[:, 0] = np.arange(20)
    drawing = pictures(robot, SimulationConfig(), q, np.zeros((20, 6)), (2, 1), workers)
    assert [picture.tobytes()[0] for picture in drawing] == list(range(20))
    assert len(shares) == processes and sum(shares) == 20


def test_if_one_process_fails_its_error_is_raised_and_the_others_end(monkeypatch):
    closed = []
    monkeypatch.setattr(renderer, "_drawn_elsewhere", stand_in(10, closed))
    robot = solo12()
    q = np.tile(standing(robot), (20, 1))
    q[:, 0] = np.arange(20)
    drawing = pictures(robot, SimulationConfig(), q, np.zeros((20, 6)), (2, 1), 3)
    with pytest.raises(RenderingUnavailable, match="crashed at 10"):
        list(drawing)
    assert sorted(closed) == [0, 2]
    with pytest.raises(ValueError, match="0 workers; use at least 1"):
        next(pictures(robot, SimulationConfig(), q, np.zeros((20, 6)), (2, 1), 0))


def test_a_child_that_succeeds_gives_its_output():
    assert run_child("print('ok')") == b"ok\n"


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import sys; print('noise', file=sys.stderr); sys.exit('no EGL')", "no EGL"),
        ("import os; os._exit(3)", "code 3"),
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "code -11"),
    ],
)
def test_a_child_that_fails_is_an_error_with_its_last_line(code, reason):
    with pytest.raises(RenderingUnavailable, match=f"^It failed. It ended with: {reason}$"):
        run_child(code)


def test_an_error_in_the_body_ends_the_child():
    with (
        pytest.raises(KeyboardInterrupt),
        child_process([sys.executable, "-c", "import time; time.sleep(60)"], "It failed") as child,
    ):
        raise KeyboardInterrupt
    assert child.poll() is not None


class FullDisk(BytesIO):
    """A temporary file that takes nothing, and says so again when it is closed."""

    def write(self, data):
        raise OSError("no space left")

    def close(self):
        raise OSError("no space left")


def test_a_full_disk_is_named_where_what_is_drawn_goes_through_it(monkeypatch):
    monkeypatch.setattr(renderer, "TemporaryFile", FullDisk)
    robot = solo12()
    q = standing(robot)[None]
    with pytest.raises(WriteError, match=r"a temporary file in .* cannot be written.*free some"):
        next(pictures(robot, SimulationConfig(), q, np.zeros((1, 6)), (2, 1)))
