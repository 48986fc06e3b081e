"""Films and pictures of a recorded robot, without a screen.

MuJoCo draws in a process of its own: which OpenGL it uses is settled when it is first imported, and
a graphics driver that crashes there takes nothing with it. Frames come back through a pipe; ffmpeg
makes a film of them.
"""

from __future__ import annotations

import os
import pickle
import sys
from collections.abc import Generator, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from subprocess import PIPE, Popen
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

import mujoco
import numpy as np
from PIL import Image, ImageColor, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter1d
from tqdm import tqdm

from surefoot.config import SimulationConfig
from surefoot.files import write_atomic
from surefoot.robots.model import RobotModel
from surefoot.robots.solo12 import solo12
from surefoot.rotations import heading, rotation
from surefoot.sim.mujoco import build_model, to_mujoco
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, IntArray
from surefoot.viz.plots import BLUE, GRAY, RED

AIM = 0.11  # [m] height the camera looks at: half way from the ground to the robot's top
SMOOTHING = 0.3  # [s] width of the Gaussian through which the camera follows the base
PUSH_SHOWN = 150  # [ms] that a push is named for; it lasts 10 ms, less than a frame
INK = "#282D37"
TILE = 0.1  # [m] edge of a floor square; at 0.3 m/s a step of the trot is 0.15 m long
MEND = "on Debian or Ubuntu: `make system`, or `apt-get install libegl1 libgl1-mesa-dri`"


class RenderingUnavailable(RuntimeError):  # noqa: N818
    """Something that pictures need is missing; the message says what, and how to mend it."""


def film(
    robot: RobotModel,
    config: SimulationConfig,
    q: Array,
    path: Path,
    rate: float = 50.0,
    size: tuple[int, int] = (960, 540),
    title: str | None = None,
    speed: float = 1.0,
    expert_drove: BoolArray | None = None,
    pushes: tuple[int, ...] = (),
) -> Path:
    """Film a robot from its front right, as an MP4 (H.264, yuv420p); whole or not at all.

    Args:
        robot: the robot.
        config: of the simulator that recorded it.
        q: ``(T, 19)`` configurations, one each 1 ms [m, unit quaternion, rad].
        path: the film; its folder must exist.
        rate: frames per second of the film.
        size: width and height [pixels].
        title: text in the upper left corner; the time since the start stands on the right.
        speed: 0.25 is slow motion, four times slower than the robot.
        expert_drove: ``(T,)`` True where the expert drove; each frame names the driver, and a
            timeline at the bottom edge shows who drove when.
        pushes: ticks at which a push begins; marked on the timeline, named for 150 ms.

    Raises:
        ValueError: ``q`` is not the recording of one robot, or the drivers or pushes are not of
            that recording.
        RenderingUnavailable: there is no OpenGL without a screen, or no ffmpeg.
    """
    ticks = np.arange(0, len(q), TICKS_PER_SECOND * speed / rate).astype(np.int64)
    camera = _camera(q, ticks, distance=0.85, side=125.0, elevation=-13.0)
    _check_events(len(q), expert_drove, pushes)

    def finished(picture: Image.Image, tick: int) -> Image.Image:
        _caption(picture, tick, title or "", expert_drove, pushes)
        if expert_drove is not None or pushes:
            _draw_timeline(picture, tick, len(q), expert_drove, pushes)
        return picture

    with closing(_pictures(robot, config, q[ticks], camera, size)) as pictures:
        bar = tqdm(zip(ticks, pictures, strict=True), "film", len(ticks), leave=False, unit="frame")
        frames = (finished(picture, int(tick)) for tick, picture in bar)
        write_atomic(path, lambda target: _encode(frames, target, rate, size))
    return path


def check_rendering() -> None:
    """Film two frames and throw them away.

    Raises:
        RenderingUnavailable: there is no OpenGL without a screen, or no ffmpeg.
    """
    robot = solo12()
    with TemporaryDirectory() as folder:
        q = np.tile(robot.nominal, (40, 1))
        film(robot, SimulationConfig(), q, Path(folder) / "check.mp4", size=(64, 48))


def contact_sheet(
    robot: RobotModel,
    config: SimulationConfig,
    q: Array,
    path: Path,
    frames: int = 12,
    expert_drove: BoolArray | None = None,
    pushes: tuple[int, ...] = (),
) -> Path:
    """The middle of a recording in one picture (PNG): 24 frames a second, four in a row.

    The camera stands still on the robot's right: a stance foot that does not slip keeps its place
    from frame to frame. Twelve frames are one period of the trot. Driver and pushes are named in
    each frame, without a timeline. Otherwise as `film`.
    """
    ticks = np.arange(frames) * TICKS_PER_SECOND // 24
    ticks = (ticks + max(len(q) - ticks[-1], 0) // 2)[ticks < len(q)]
    camera = _camera(q, ticks, distance=0.78, side=90.0, elevation=-7.0)
    camera[:] = camera.mean(axis=0)
    _check_events(len(q), expert_drove, pushes)
    width, height, rows = 480, 320, -(-len(ticks) // 4)
    sheet = Image.new("RGB", (min(len(ticks), 4) * width, rows * height), "white")
    large = 2 * width, 2 * height  # reduced afterwards, so that edges are smooth
    for n, picture in enumerate(_pictures(robot, config, q[ticks], camera, large)):
        small = picture.reduce(2)
        _caption(small, int(ticks[n]), "", expert_drove, pushes)
        sheet.paste(small, (n % 4 * width, n // 4 * height))
    write_atomic(path, lambda target: sheet.save(target, format="PNG"))
    return path


def _camera(q: Array, ticks: IntArray, distance: float, side: float, elevation: float) -> Array:
    """``(n, 6)`` for each tick: point to look at, distance [m], azimuth, elevation [deg]."""
    if q.ndim != 2 or q.shape[1] != 19 or not len(q) or not np.isfinite(q).all():
        raise ValueError(f"q {q.shape} must be finite and (T, 19): rollout.q[b, : length[b]]")
    base = gaussian_filter1d(q[:, :2], SMOOTHING * TICKS_PER_SECOND, axis=0, mode="nearest")[ticks]
    # Sides count from the robot's first heading: at 90 the camera is on its right.
    cos, sin = heading(rotation(q[0, 3:7]))
    view = [AIM, distance, np.degrees(np.arctan2(sin, cos)) + side, elevation]
    return np.hstack([base, np.tile(view, (len(base), 1))])


def _check_events(length: int, expert_drove: BoolArray | None, pushes: tuple[int, ...]) -> None:
    if expert_drove is not None and expert_drove.shape != (length,):
        raise ValueError(
            f"expert_drove {expert_drove.shape} must be {(length,)}, as long as q: "
            "rollout.expert_drove[b, : length[b]]"
        )
    if not all(0 <= push < length for push in pushes):
        raise ValueError(f"pushes {pushes} must be ticks of the recording, 0 to {length - 1}")


def _caption(
    picture: Image.Image,
    tick: int,
    title: str,
    expert_drove: BoolArray | None,
    pushes: tuple[int, ...],
) -> None:
    """Title and time above; driver and push below, in boxes on the left."""
    width, height = picture.size
    margin, font = height // 30, ImageFont.load_default(height // 22)
    draw, time = ImageDraw.Draw(picture), f"{tick / TICKS_PER_SECOND:.2f} s"
    draw.text((margin, margin), title, INK, font, "la")
    draw.text((width - margin, margin), time, INK, font, "ra")
    labels = []
    if expert_drove is not None:
        labels.append(("expert drives", BLUE) if expert_drove[tick] else ("policy drives", RED))
    if any(0 <= tick - push < PUSH_SHOWN for push in pushes):
        labels.append(("push", INK))
    left, bottom = margin, height - 2 * margin
    for label, colour in labels:
        right = left + draw.textlength(label, font) + margin
        draw.rectangle((left, bottom - 2 * margin, right, bottom), colour)
        draw.text(((left + right) / 2, bottom - margin), label, "white", font, "mm")
        left = right + margin / 2


def _draw_timeline(
    picture: Image.Image,
    tick: int,
    length: int,
    expert_drove: BoolArray | None,
    pushes: tuple[int, ...],
) -> None:
    """The whole recording along the bottom edge: its drivers, its pushes, and now."""
    width, height = picture.size
    draw, thick, pen = ImageDraw.Draw(picture), max(height // 45, 2), max(width // 480, 1)
    if expert_drove is None:
        draw.rectangle((0, height - thick, width, height), GRAY)
    else:
        by_column = expert_drove[np.arange(width) * length // width, None]
        colours = np.where(by_column, ImageColor.getrgb(BLUE), ImageColor.getrgb(RED))
        strip = Image.fromarray(colours[None].astype(np.uint8)).resize((width, thick))
        picture.paste(strip, (0, height - thick))
    for push in pushes:
        x = push * width // length
        draw.rectangle((x, height - 2 * thick, x + pen - 1, height - thick - 1), INK)
    x = tick * width // length
    draw.rectangle((x - pen, height - 2 * thick, x + pen, height), "white", INK)


def _pictures(
    robot: RobotModel, config: SimulationConfig, q: Array, camera: Array, size: tuple[int, int]
) -> Generator[Image.Image, None, None]:
    """Pictures of ``q`` ``(n, 19)`` under ``camera`` ``(n, 6)``, drawn by `_draw`."""
    model = build_model(robot, config, visual=True)
    qpos, _ = to_mujoco(q, np.zeros((len(q), model.nv)))
    system = os.environ.get("MUJOCO_GL") or ("egl" if sys.platform == "linux" else "")
    failure = f"MuJoCo cannot draw without a screen (MUJOCO_GL={system}); {MEND}"
    environment = {**os.environ, "MUJOCO_GL": system}
    command = [sys.executable, "-c", "from surefoot.viz.film import _draw; _draw()"]
    count = 3 * size[0] * size[1]
    with _child(command, failure, stdin=PIPE, stdout=PIPE, env=environment) as child:
        pickle.dump((model, qpos, camera, size), child.stdin)
        child.stdin.flush()
        for _ in q:
            if len(pixels := child.stdout.read(count)) < count:
                raise BrokenPipeError
            yield Image.frombytes("RGB", size, pixels)


def _draw() -> None:
    """The drawing process: a job on standard input, raw pictures on standard output."""
    model, qpos, camera, (width, height) = pickle.load(sys.stdin.buffer)
    pictures = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a graphics driver prints is not a picture
    # Without a GPU a picture takes 0.13 s; with smooth edges, finer shadows and a mirror 0.45 s.
    model.vis.quality.offsamples, model.vis.quality.shadowsize = 0, 1024
    model.mat_reflectance[:], model.mat_texrepeat[:] = 0.0, 1.0 / TILE
    model.vis.global_.offwidth, model.vis.global_.offheight = width, height
    model.stat.extent = 1.0  # [m] that shadows are computed for
    data, view = mujoco.MjData(model), mujoco.MjvCamera()
    with mujoco.Renderer(model, height, width) as renderer:
        for data.qpos[:], row in zip(qpos, camera, strict=True):
            view.lookat[:] = row[:3]
            view.distance, view.azimuth, view.elevation = row[3:]
            model.light_pos[0] = row[:3] - model.light_dir[0]  # shadows are drawn near the lamp
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, view)
            pictures.write(renderer.render().tobytes())
        pictures.flush()
        os._exit(0)  # some drivers crash on their way out


def _encode(
    pictures: Iterable[Image.Image], path: Path, rate: float, size: tuple[int, int]
) -> None:
    """Write frames as an MP4."""
    try:
        from imageio_ffmpeg import get_ffmpeg_exe

        ffmpeg = get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        message = f"films need ffmpeg, which is missing ({error}): pip install 'surefoot[viz]'"
        raise RenderingUnavailable(message) from error
    source = f"-f rawvideo -pix_fmt rgb24 -s {size[0]}x{size[1]} -r {rate} -i -"
    even = "-vf pad=ceil(iw/2)*2:ceil(ih/2)*2"  # as H.264 wants it
    target = "-c:v libx264 -preset veryfast -crf 20 -pix_fmt yuv420p -movflags +faststart -f mp4"
    command = [ffmpeg, *f"-y -v error {source} {even} {target}".split(), str(path)]
    with _child(command, "ffmpeg could not write the film", stdin=PIPE) as process:
        for picture in pictures:
            process.stdin.write(picture.tobytes())


@contextmanager
def _child(command: list[str], failure: str, **options: Any) -> Iterator[Any]:
    """A process that has to end well once the body has ended, or a pipe to it has broken."""
    with TemporaryFile() as words, Popen(command, stderr=words, **options) as process:
        try:
            with suppress(BrokenPipeError):
                yield process
            process.communicate()
        except BaseException:
            process.kill()
            process.communicate()
            raise
        if process.returncode:
            words.seek(0)
            said = words.read().decode(errors="replace").strip() or f"code {process.returncode}"
            raise RenderingUnavailable(f"{failure}. It ended with: {said.splitlines()[-1]}")
