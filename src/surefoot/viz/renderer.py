"""Pictures of a robot without a screen, drawn by MuJoCo in a process of its own.

Which OpenGL MuJoCo uses is settled when it is first imported, and a graphics driver that crashes in
the drawing process takes nothing with it. `pictures` starts that process, which is this module run
as a program; the pictures come back through a pipe. Next: `film`, which makes films of them.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Generator, Iterator
from contextlib import contextmanager, suppress
from subprocess import PIPE, Popen
from tempfile import TemporaryFile
from typing import Any

import mujoco
import numpy as np
from PIL import Image

from surefoot.config import SimulationConfig
from surefoot.robots.model import RobotModel
from surefoot.robots.scaling import size_of
from surefoot.sim.mujoco import to_mujoco
from surefoot.sim.mujoco_model import build_model
from surefoot.types import Array

TILE = 0.1
"""[m] edge of a floor square; at 0.3 m/s a step of the trot is 0.15 m long."""
FIX = "on Debian or Ubuntu: `make system`, or `apt-get install libegl1 libgl1-mesa-dri`"


class RenderingUnavailable(RuntimeError):  # noqa: N818
    """Something that pictures need is missing; the message says what, and how to fix it."""


def view_scale(robot: RobotModel) -> float:
    """How much larger than Solo12 a robot looks, to a tenth: its legs are that much longer.

    Args:
        robot: The robot.
    """
    return max(0.1, round(size_of(robot).length_ratio, 1))


def pictures(
    robot: RobotModel,
    simulation: SimulationConfig,
    q: Array,
    camera: Array,
    size: tuple[int, int],
) -> Generator[Image.Image, None, None]:
    """Draw configurations one after the other.

    Args:
        robot: The robot.
        simulation: Configuration of the simulator, which fixes the scene.
        q: ``(n, 19)`` configurations [m, unit quaternion, rad].
        camera: ``(n, 6)`` point to look at [m], distance [m], azimuth and elevation [deg].
        size: Width and height of a picture [pixels].

    Raises:
        RenderingUnavailable: There is no OpenGL without a screen.
    """
    model = build_model(robot, simulation, visual=True)
    qpos, _ = to_mujoco(q, np.zeros((len(q), model.nv)))
    system = os.environ.get("MUJOCO_GL") or ("egl" if sys.platform == "linux" else "")
    failure = f"MuJoCo cannot draw without a screen (MUJOCO_GL={system}); {FIX}"
    environment = {**os.environ, "MUJOCO_GL": system}
    command = [sys.executable, "-m", __name__]
    count = 3 * size[0] * size[1]
    # MuJoCo computes shadows, and cuts off what is near, by this length.
    model.stat.extent = view_scale(robot)
    with child_process(command, failure, stdin=PIPE, stdout=PIPE, env=environment) as child:
        pickle.dump((model, qpos, camera, size), child.stdin)
        child.stdin.flush()
        for _ in q:
            pixels = child.stdout.read(count)
            if len(pixels) < count:
                raise BrokenPipeError
            yield Image.frombytes("RGB", size, pixels)


def draw_pictures() -> None:
    """Draw what comes through standard input, and write raw pictures to standard output."""
    model, qpos, camera, (width, height) = pickle.load(sys.stdin.buffer)
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a graphics driver prints is not a picture
    # Without a GPU a picture takes 0.13 s; with smooth edges, finer shadows and a mirror 0.45 s.
    model.vis.quality.offsamples = 0
    model.vis.quality.shadowsize = 1024
    model.mat_reflectance[:] = 0.0
    model.mat_texrepeat[:] = 1.0 / TILE
    model.vis.global_.offwidth = width
    model.vis.global_.offheight = height
    data = mujoco.MjData(model)
    view = mujoco.MjvCamera()
    with mujoco.Renderer(model, height, width) as renderer:
        for configuration, row in zip(qpos, camera, strict=True):
            data.qpos[:] = configuration
            view.lookat[:] = row[:3]
            view.distance = row[3]
            view.azimuth = row[4]
            view.elevation = row[5]
            model.light_pos[0] = row[:3] - model.light_dir[0]  # shadows are drawn near the lamp
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, view)
            output.write(renderer.render().tobytes())
        output.flush()
        os._exit(0)  # some drivers crash on their way out


@contextmanager
def child_process(command: list[str], failure: str, **options: Any) -> Iterator[Any]:
    """Run a process that has to succeed once the body has ended, or a pipe to it has broken.

    Args:
        command: Program and arguments.
        failure: First sentence of the error if it does not succeed.
        options: Arguments of `subprocess.Popen`.

    Raises:
        RenderingUnavailable: The process failed; the message ends with the last line it printed.
    """
    with TemporaryFile() as errors, Popen(command, stderr=errors, **options) as process:
        try:
            with suppress(BrokenPipeError):
                yield process
            process.communicate()
        except BaseException:
            process.kill()
            process.communicate()
            raise
        if process.returncode:
            errors.seek(0)
            printed = errors.read().decode(errors="replace").strip()
            reason = printed.splitlines()[-1] if printed else f"code {process.returncode}"
            raise RenderingUnavailable(f"{failure}. It ended with: {reason}")


if __name__ == "__main__":
    draw_pictures()
