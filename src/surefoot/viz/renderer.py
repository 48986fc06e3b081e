"""Pictures of a robot without a screen, drawn by MuJoCo in separate processes.

Which OpenGL MuJoCo uses is settled when it is first imported, and a graphics driver that crashes in
a drawing process takes nothing else with it. `pictures` starts those processes, which run this
module as a program. Each of n processes draws every n-th picture and hands it over through a pipe,
so pictures come in order, and only the one that a process has just drawn waits in memory. Next:
`film`, which makes films from pictures.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Generator, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from subprocess import PIPE, Popen
from tempfile import TemporaryFile, gettempdir
from typing import IO, TYPE_CHECKING, Any

import mujoco
import numpy as np
from PIL import Image

from surefoot.workers import Workers, default_workers

if TYPE_CHECKING:
    from surefoot.config import SimulationConfig
    from surefoot.robots.model import RobotModel
    from surefoot.sim.terrain import Ground
    from surefoot.types import Array

TILE = 0.1
"""[m] edge of a floor square; at 0.3 m/s a step of the trot is 0.15 m long."""
SHOWN_GROUND = 3.0
"""[m] How far around a robot's path its uneven ground is drawn; drawing all of it takes four times
as long."""
LEAST_SHARE = 6
"""The fewest pictures per process: starting a process takes as long as drawing these."""
FIX = "on Debian or Ubuntu: `make system`, or `apt-get install libegl1 libopengl0 libgl1-mesa-dri`"


class RenderingUnavailable(RuntimeError):  # noqa: N818
    """Something that pictures need is missing; the message says what, and how to fix that."""


def view_scale(robot: RobotModel) -> float:
    """How many times larger than Solo12 a robot is drawn, to a tenth: the ratio of leg lengths.

    Args:
        robot: The robot.
    """
    from surefoot.robots.scaling import size_of

    return max(0.1, round(size_of(robot).length_ratio, 1))


def pictures(
    robot: RobotModel,
    simulation: SimulationConfig,
    q: Array,
    camera: Array,
    size: tuple[int, int],
    workers: int | None = None,
    ground: Ground | None = None,
) -> Generator[Image.Image, None, None]:
    """Draw configurations, and yield their pictures in order: the same for any number of processes.

    Args:
        robot: The robot.
        simulation: Configuration of the simulator, which fixes the scene.
        q: ``(n, 19)`` configurations [m, unit quaternion, rad].
        camera: ``(n, 6)`` point to look at [m], distance [m], azimuth and elevation [deg].
        size: Width and height of a picture [pixels].
        workers: Maximum number of processes that draw; None for one per available core. There are
            never so many that one would draw fewer than six pictures.
        ground: The ground of the robot; None for a floor at z = 0.

    Raises:
        RenderingUnavailable: Offscreen OpenGL is missing.
        ValueError: The number of processes is not positive.
        WriteError: The disk is too full for the temporary file of what is to be drawn.
    """
    # The processes that draw import this module too, but need none of these.
    from surefoot.sim.mujoco import to_mujoco
    from surefoot.sim.mujoco_ground import keep_near
    from surefoot.sim.mujoco_model import build_model

    cores = default_workers()
    most = cores if workers is None else Workers(workers).started
    count = max(min(most, len(q) // LEAST_SHARE), 1)
    model = build_model(robot, simulation, visual=True, ground=ground)
    if ground is not None:
        keep_near(model, ground, q[:, :2], SHOWN_GROUND)
    # MuJoCo scales its shadows and its near clipping plane by this length.
    model.stat.extent = view_scale(robot)
    qpos, _ = to_mujoco(q, np.zeros((len(q), model.nv)))
    with ExitStack() as stack:
        drawings = []
        for first in range(count):
            share = (model, qpos[first::count], camera[first::count], size)
            drawing = stack.enter_context(closing(_drawn_elsewhere(share, cores // count)))
            next(drawing)  # starts its process, so that all of them start at once
            drawings.append(drawing)
        for number in range(len(q)):
            yield Image.frombytes("RGB", size, next(drawings[number % count]))


def _drawn_elsewhere(share: tuple[Any, ...], cores: int) -> Generator[bytes, None, None]:
    """Draw in another process; yield empty bytes once it has started, then raw pictures.

    Args:
        share: What `draw_pictures` reads: model, configurations, cameras, size.
        cores: Number of cores that the process may use.

    Raises:
        RenderingUnavailable: Offscreen OpenGL is missing.
        WriteError: The disk is full.
    """
    _, qpos, _, (width, height) = share
    system = os.environ.get("MUJOCO_GL") or ("egl" if sys.platform == "linux" else "")
    failure = f"MuJoCo cannot draw without a screen (MUJOCO_GL={system}); {FIX}"
    # Mesa, which draws where there is no GPU, starts a thread for every core of the machine. Told
    # to use 0 threads, it starts none, and draws in the main thread.
    threads = str(cores if cores > 1 else 0)
    environment = {"LP_NUM_THREADS": threads, **os.environ, "MUJOCO_GL": system}
    command = [sys.executable, "-P", "-m", __name__]
    options = {"stdout": PIPE, "env": environment}
    with _file_of(share) as file, child_process(command, failure, stdin=file, **options) as child:
        yield b""
        for _ in qpos:
            pixels = child.stdout.read(3 * width * height)
            if len(pixels) < 3 * width * height:
                raise BrokenPipeError
            yield pixels


def _file_of(share: tuple[Any, ...]) -> IO[bytes]:
    """A temporary file, at its beginning, with what `draw_pictures` reads.

    Raises:
        WriteError: The disk is full.
    """
    from surefoot.files import writing

    with writing(f"a temporary file in {gettempdir()}"), ExitStack() as failing:
        file = failing.enter_context(TemporaryFile())
        pickle.dump(share, file)
        file.seek(0)
        failing.pop_all()
    return file


def draw_pictures() -> None:
    """Draw what comes through standard input, and write raw pictures to standard output."""
    model, qpos, camera, (width, height) = pickle.load(sys.stdin.buffer)
    output = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a graphics driver prints is not a picture
    # Without a GPU, a picture of a film takes a core 0.05 s; smooth edges alone would double that.
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
            # MuJoCo centers an endless floor at the camera of the update before. After two updates
            # a picture does not depend on the one that its process drew before.
            renderer.update_scene(data, view)
            renderer.update_scene(data, view)
            output.write(renderer.render().tobytes())
        output.flush()
        os._exit(0)  # some drivers crash on their way out


@contextmanager
def child_process(command: list[str], failure: str, **options: Any) -> Iterator[Any]:
    """Run a process that must succeed once the body has ended, or a pipe to it has broken.

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
