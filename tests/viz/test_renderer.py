"""The process that draws: its pictures, and what is left when it fails."""

import sys
from subprocess import PIPE

import numpy as np
import pytest

from surefoot.config import SimulationConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
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
