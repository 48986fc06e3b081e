"""Films and contact sheets of a recorded robot, without a screen.

A `Recording` is what the robot did, who drove and when it was pushed; `film` makes an MP4 of it and
`contact_sheet` a PNG. The robot is drawn by `renderer`, in separate processes; captions and the
timeline are drawn here, and ffmpeg encodes the film. Next: `renderer`.
"""

from __future__ import annotations

from collections.abc import Generator, Iterable
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from subprocess import PIPE
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image, ImageDraw, ImageFont
from scipy.ndimage import gaussian_filter1d
from tqdm import tqdm

from surefoot.config import SimulationConfig
from surefoot.files import check_output, write_atomic
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel, standing
from surefoot.rotations import heading, rotation
from surefoot.sim.terrain import Ground
from surefoot.types import TICKS_PER_SECOND, Array, BoolArray, Command, IntArray
from surefoot.viz.colors import EXPERT_COLOR, GRAY, INK, POLICY_COLOR, rgb
from surefoot.viz.renderer import RenderingUnavailable, child_process, pictures, view_scale

FILM_SUFFIXES = (".mp4",)
"""The file name endings of films."""
AIM = 0.11
"""[m] height the camera looks at: halfway from the ground to Solo12's top."""
SMOOTHING = 0.3
"""[s] width of the Gaussian that smooths the camera's motion after the base."""
PUSH_CAPTIONED = 150
"""[ms] How long a push is captioned; it lasts 10 ms, less than a frame."""
SHEET_RATE = 24
"""Frames of a contact sheet per second of the recording."""
SHEET_COLUMNS = 4
"""Frames in a row of a contact sheet."""
SHEET_WIDTH = 480
"""[pixels] width of a frame of a contact sheet."""
SHEET_HEIGHT = 320
"""[pixels] height of a frame of a contact sheet."""
PORTRAIT_SIZE = (960, 640)
"""[pixels] width and height of the picture of a robot."""
UNKNOWN_COLOR = GRAY
"""Color of the timeline where nobody drove, or where it is unknown who did."""
WAITING = ("damped", "standing up")
"""What the robot is doing while neither the policy nor the expert drives."""


@dataclass(frozen=True)
class Recording:
    """What a film shows: one robot, tick by tick, and what happened to it.

    Attributes:
        robot: The robot.
        simulation: Configuration of the simulator that recorded it.
        q: ``(T, 19)`` configurations, one for each tick of 1 ms [m, unit quaternion, rad].
        expert_drove: ``(T,)`` True where the expert drove; None if that is not to be shown.
        pushes: Ticks at which a push begins.
        ground: The ground of that robot; None for level ground at z = 0.
        waiting: ``(T,)`` index into `WAITING` of why nobody drove; -1 where somebody did. None if
            somebody drove throughout.

    Raises:
        ValueError: ``q`` is not the recording of one robot, or ``expert_drove``, ``waiting``, the
            pushes or the ground do not fit that recording.
    """

    robot: RobotModel
    simulation: SimulationConfig
    q: Array
    expert_drove: BoolArray | None = None
    pushes: tuple[int, ...] = ()
    ground: Ground | None = None
    waiting: IntArray | None = None

    def __post_init__(self) -> None:
        """Check that all parts fit the recording."""
        q = self.q
        if q.ndim != 2 or q.shape[1] != 19 or not len(q) or not np.isfinite(q).all():
            raise ValueError(f"q {q.shape} must be finite and (T, 19): rollout.q[b, : length[b]]")
        if self.expert_drove is not None and self.expert_drove.shape != (len(q),):
            raise ValueError(
                f"expert_drove {self.expert_drove.shape} must be {(len(q),)}, as long as q: "
                "rollout.expert_drove[b, : length[b]]"
            )
        if self.waiting is not None and self.waiting.shape != (len(q),):
            raise ValueError(f"waiting {self.waiting.shape} must be {(len(q),)}, as long as q")
        if not all(0 <= push < len(q) for push in self.pushes):
            raise ValueError(
                f"pushes {self.pushes} must be ticks of the recording, 0 to {len(q) - 1}"
            )
        if self.ground is not None and len(self.ground) != 1:
            raise ValueError(
                f"the ground of {len(self.ground)} robots for the recording of one: "
                "rollout.ground[b : b + 1]"
            )


def command_in_words(command: Command) -> str:
    """A command for the title of a film: vx, and the other components that are not zero.

    Args:
        command: The command.
    """
    words = [f"vx {command.vx:.2f} m/s"]
    if command.vy:
        words.append(f"vy {command.vy:.2f} m/s")
    if command.yaw_rate:
        words.append(f"yaw rate {command.yaw_rate:.2f} rad/s")
    return ", ".join(words)


def film(
    recording: Recording,
    path: Path,
    title: str | None = None,
    rate: float = 25.0,
    size: tuple[int, int] = (960, 540),
    speed: float = 1.0,
    workers: int | None = None,
) -> Path:
    """Film a robot from its front right, as an MP4 (H.264, yuv420p); whole or not at all.

    If the recording has pushes, or says who drove, each frame shows it, and a timeline at the
    bottom edge shows who drove when; a push is captioned for 150 ms.

    Args:
        recording: What the robot did.
        path: The film, with the ending .mp4, or a device or a pipe; its folder is created.
        title: Text in the upper left corner; the time since the start is on the right.
        rate: Frames per second of the film.
        size: Width and height [pixels].
        speed: Speed of the film; 0.25 is slow motion, four times slower than the robot.
        workers: Number of processes that draw, which does not change the film; None for one per
            available core.

    Returns:
        The path.

    Raises:
        RenderingUnavailable: Offscreen OpenGL or ffmpeg is missing.
        ValueError: The path has another ending, or the number of processes is not positive.
        WriteError: The path cannot be written.
    """
    check_output(path, suffixes=FILM_SUFFIXES)
    q = recording.q
    ticks = np.arange(0, len(q), TICKS_PER_SECOND * speed / rate).astype(np.int64)
    camera = _camera(q, ticks, 0.85, 125.0, -13.0, view_scale(recording.robot))
    _follow_height(camera, recording, ticks)
    has_timeline = recording.expert_drove is not None or bool(recording.pushes)

    def finished(picture: Image.Image, tick: int) -> Image.Image:
        _draw_caption(picture, recording, tick, title or "")
        if has_timeline:
            _draw_timeline(picture, recording, tick)
        return picture

    drawing = _pictures(recording, ticks, camera, size, workers)
    with closing(drawing):
        bar = tqdm(zip(ticks, drawing, strict=True), "film", len(ticks), leave=False, unit="frame")
        frames = (finished(picture, int(tick)) for tick, picture in bar)
        write_atomic(path, lambda target: _encode(frames, target, rate, size))
    return path


def contact_sheet(recording: Recording, path: Path, frames: int = 12) -> Path:
    """The middle of a recording in one picture (PNG): 24 frames a second, four in a row.

    The camera stands still on the robot's right: a stance foot that does not slip keeps its place
    from frame to frame. Twelve frames are one period of the trot. Captions in each frame name who
    drove and any push; there is no timeline.

    Args:
        recording: What the robot did.
        path: The picture, with the ending .png; it is written whole or not at all.
        frames: Number of frames; a recording that is too short gives fewer.

    Returns:
        The path.

    Raises:
        RenderingUnavailable: Offscreen OpenGL is missing.
        ValueError: The path has another ending.
        WriteError: The path cannot be written.
    """
    check_output(path, suffixes=(".png",))
    q = recording.q
    ticks = np.arange(frames) * TICKS_PER_SECOND // SHEET_RATE
    first = max(len(q) - ticks[-1], 0) // 2
    ticks = first + ticks[ticks < len(q)]
    camera = _camera(q, ticks, 0.78, 90.0, -7.0, view_scale(recording.robot))
    _follow_height(camera, recording, ticks)
    camera[:] = camera.mean(axis=0)
    columns = min(len(ticks), SHEET_COLUMNS)
    rows = int(np.ceil(len(ticks) / SHEET_COLUMNS))
    sheet = Image.new("RGB", (columns * SHEET_WIDTH, rows * SHEET_HEIGHT), "white")
    large = (2 * SHEET_WIDTH, 2 * SHEET_HEIGHT)  # reduced afterwards, so that edges are smooth
    drawing = _pictures(recording, ticks, camera, large)
    for number, picture in enumerate(drawing):
        small = picture.reduce(2)
        _draw_caption(small, recording, int(ticks[number]), "")
        row, column = divmod(number, SHEET_COLUMNS)
        sheet.paste(small, (column * SHEET_WIDTH, row * SHEET_HEIGHT))
    write_atomic(path, lambda target: sheet.save(target, format="PNG"))
    return path


def portrait(robot: RobotModel, path: Path) -> Path:
    """Draw a robot in its nominal pose, from its front right.

    Args:
        robot: The robot.
        path: The picture, with the ending .png; it is written whole or not at all.

    Returns:
        The path.

    Raises:
        RenderingUnavailable: Offscreen OpenGL is missing.
        ValueError: The path has another ending.
        WriteError: The path cannot be written.
    """
    check_output(path, suffixes=(".png",))
    q = standing(robot)[None]
    camera = _camera(q, np.zeros(1, dtype=np.int64), 0.85, 125.0, -13.0, view_scale(robot))
    [picture] = pictures(robot, SimulationConfig(), q, camera, PORTRAIT_SIZE)
    write_atomic(path, lambda target: picture.save(target, format="PNG"))
    return path


def check_rendering() -> None:
    """Film two frames, and throw them away.

    Raises:
        RenderingUnavailable: Offscreen OpenGL or ffmpeg is missing.
    """
    robot = load_robot()
    recording = Recording(robot, SimulationConfig(), np.tile(robot.nominal, (80, 1)))
    with TemporaryDirectory() as folder:
        film(recording, Path(folder) / "check.mp4", size=(64, 48))


def _camera(
    q: Array, ticks: IntArray, distance: float, side: float, elevation: float, scale: float = 1.0
) -> Array:
    """``(n, 6)`` for each tick: point to look at [m], distance [m], azimuth, elevation [deg].

    Height and distance are given for Solo12; a robot ``scale`` times as large is seen from farther
    away.
    """
    base = gaussian_filter1d(q[:, :2], SMOOTHING * TICKS_PER_SECOND, axis=0, mode="nearest")[ticks]
    # Angles count from the robot's first heading: at 90 the camera is on its right.
    cos, sin = heading(rotation(q[0, 3:7]))
    view = [scale * AIM, scale * distance, np.degrees(np.arctan2(sin, cos)) + side, elevation]
    return np.hstack([base, np.tile(view, (len(base), 1))])


def _follow_height(camera: Array, recording: Recording, ticks: IntArray) -> None:
    """Let the camera rise and sink with the base of a robot on uneven ground, in place.

    On level ground the camera stays at one height, and shows how the base moves.

    Args:
        camera: ``(n, 6)`` from `_camera`.
        recording: What the robot did.
        ticks: ``(n,)`` the ticks that are drawn.
    """
    if recording.ground is None:
        return
    width = SMOOTHING * TICKS_PER_SECOND
    base = gaussian_filter1d(recording.q[:, 2], width, mode="nearest")[ticks]
    camera[:, 2] += base - standing(recording.robot)[2]


def _pictures(
    recording: Recording,
    ticks: IntArray,
    camera: Array,
    size: tuple[int, int],
    workers: int | None = None,
) -> Generator[Image.Image, None, None]:
    """The pictures of some ticks of a recording, seen from `camera` ``(n, 6)``."""
    q = recording.q[ticks]
    robot = recording.robot
    return pictures(robot, recording.simulation, q, camera, size, workers, recording.ground)


def _draw_caption(picture: Image.Image, recording: Recording, tick: int, title: str) -> None:
    """Draw title and time at the top, and boxes for the driver and a push at the bottom left."""
    width, height = picture.size
    margin = height // 30
    font = ImageFont.load_default(height // 22)
    draw = ImageDraw.Draw(picture)
    draw.text((margin, margin), title, INK, font, "la")
    draw.text((width - margin, margin), f"{tick / TICKS_PER_SECOND:.2f} s", INK, font, "ra")
    boxes = []
    if recording.waiting is not None and recording.waiting[tick] >= 0:
        boxes.append((WAITING[recording.waiting[tick]], UNKNOWN_COLOR))
    elif recording.expert_drove is not None:
        if recording.expert_drove[tick]:
            boxes.append(("expert drives", EXPERT_COLOR))
        else:
            boxes.append(("policy drives", POLICY_COLOR))
    if any(0 <= tick - push < PUSH_CAPTIONED for push in recording.pushes):
        boxes.append(("push", INK))
    left = margin
    bottom = height - 2 * margin
    for text, color in boxes:
        right = left + draw.textlength(text, font) + margin
        draw.rectangle((left, bottom - 2 * margin, right, bottom), color)
        draw.text(((left + right) / 2, bottom - margin), text, "white", font, "mm")
        left = right + margin / 2


def _draw_timeline(picture: Image.Image, recording: Recording, tick: int) -> None:
    """Draw the whole recording along the bottom edge: who drove, the pushes, and the present."""
    width, height = picture.size
    length = len(recording.q)
    draw = ImageDraw.Draw(picture)
    thick = max(height // 45, 2)
    pen = max(width // 480, 1)
    if recording.expert_drove is None:
        draw.rectangle((0, height - thick, width, height), UNKNOWN_COLOR)
    else:
        columns = np.arange(width) * length // width
        by_column = recording.expert_drove[columns, None]
        colors = np.where(by_column, rgb(EXPERT_COLOR), rgb(POLICY_COLOR))
        if recording.waiting is not None:
            colors[recording.waiting[columns] >= 0] = rgb(UNKNOWN_COLOR)
        strip = Image.fromarray(colors[None].astype(np.uint8)).resize((width, thick))
        picture.paste(strip, (0, height - thick))
    for push in recording.pushes:
        x = push * width // length
        draw.rectangle((x, height - 2 * thick, x + pen - 1, height - thick - 1), INK)
    x = tick * width // length
    draw.rectangle((x - pen, height - 2 * thick, x + pen, height), "white", INK)


def _encode(frames: Iterable[Image.Image], path: Path, rate: float, size: tuple[int, int]) -> None:
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
    with child_process(command, "ffmpeg could not write the film", stdin=PIPE) as process:
        for frame in frames:
            process.stdin.write(frame.tobytes())
