"""Films: what comes out where there is OpenGL, and the errors where something is missing."""

import fcntl
import os
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image, ImageColor

import surefoot.viz.film as film_module
from surefoot.config import SimulationConfig
from surefoot.config.sim import parse_terrains
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.sim.terrain import Ground
from surefoot.types import Command
from surefoot.viz.colors import EXPERT_COLOR, INK, POLICY_COLOR
from surefoot.viz.film import (
    UNKNOWN_COLOR,
    Recording,
    command_in_words,
    contact_sheet,
    film,
)
from surefoot.viz.renderer import RenderingUnavailable

ROBOT = solo12()
SIZE = (160, 90)


def walk(ticks: int = 200):
    q = np.tile(standing(ROBOT), (ticks, 1))
    q[:, 0] += 1e-3 * np.arange(ticks)
    q[:, 7] += 0.3 * np.sin(np.arange(ticks) / 30)
    return q


def recording_of(q: np.ndarray, expert_drove=None, pushes=()) -> Recording:
    return Recording(ROBOT, SimulationConfig(), q, expert_drove, pushes)


def test_a_title_has_all_of_a_command_that_is_not_zero():
    assert command_in_words(Command(0.0, 0.0, 0.0)) == "vx 0.00 m/s"
    assert command_in_words(Command(0.3, 0.0, -0.5)) == "vx 0.30 m/s, yaw rate -0.50 rad/s"
    assert command_in_words(Command(0.3, 0.1, 0.0)) == "vx 0.30 m/s, vy 0.10 m/s"


def skip_without_opengl(function, *args, **options):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    try:
        return function(*args, **options)
    except RenderingUnavailable as error:
        pytest.skip(str(error))


def decoded(path, count: int, width: int, height: int):
    from imageio_ffmpeg import get_ffmpeg_exe

    command = [get_ffmpeg_exe(), "-v", "error", "-i", path, "-f", "rawvideo", "-pix_fmt", "rgb24"]
    raw = subprocess.run([*command, "-"], capture_output=True, check=True).stdout
    return np.frombuffer(raw, np.uint8).reshape(count, height, width, 3).astype(float)


def test_a_film_shows_the_robot_moving(tmp_path):
    path = tmp_path / "walk.mp4"
    assert skip_without_opengl(film, recording_of(walk(400)), path, "walk", size=SIZE) == path
    frames = decoded(path, 10, *SIZE)
    middle = frames[:, 20:70, 40:120]
    assert middle.std() > 15  # a robot with its shadow, not an empty floor
    assert np.abs(np.diff(middle, axis=0)).mean() > 0.5
    assert [file.name for file in tmp_path.iterdir()] == ["walk.mp4"]

    from imageio_ffmpeg import get_ffmpeg_exe

    printed = subprocess.run([get_ffmpeg_exe(), "-i", path], capture_output=True).stderr
    assert b"h264" in printed and b"yuv420p" in printed and b"25 fps" in printed
    # Slow motion shows the same moments for longer, and odd sizes are padded.
    film(recording_of(walk(20)), path, size=(81, 45), speed=0.25)
    assert len(decoded(path, 2, 82, 46)) == 2


def test_the_camera_follows_a_robot_down_a_slope():
    q = walk(2000)
    q[:, 2] -= np.linspace(0.0, 0.5, 2000)
    ticks = np.array([0, 1000, 1999])
    camera = np.zeros((3, 6))
    ground = Ground(parse_terrains("slope:10"), np.zeros((1, 3)), np.zeros(1))
    film_module._follow_height(camera, replace(recording_of(q), ground=ground), ticks)
    np.testing.assert_allclose(camera[:, 2], [0.0, -0.25, -0.5], atol=0.1)
    assert np.diff(camera[:, 2]).max() < -0.15
    level = np.zeros((3, 6))
    film_module._follow_height(level, recording_of(q), ticks)
    np.testing.assert_array_equal(level, 0.0)
    with pytest.raises(ValueError, match="ground of 2 robots for the recording of one"):
        replace(recording_of(q), ground=ground[np.array([0, 0])])


def test_a_film_is_the_same_to_the_byte_for_any_number_of_workers(tmp_path):
    recording = recording_of(walk(800), np.arange(800) > 300, (100,))
    films = []
    for workers in (1, 2):
        path = tmp_path / f"{workers}.mp4"
        skip_without_opengl(film, recording, path, "walk", size=SIZE, workers=workers)
        films.append(path.read_bytes())
    assert films[0] == films[1]


def test_the_camera_follows_the_base_and_starts_beside_the_robot():
    q = walk(2000)
    ticks = np.arange(0, 2000, 100)
    q[:, 0] += 0.02 * np.sin(np.arange(2000) * 2 * np.pi / 250)
    camera = film_module._camera(q, ticks, distance=1.0, side=90.0, elevation=-10.0)
    inner = slice(8, -8)
    np.testing.assert_allclose(camera[inner, 0], 1e-3 * ticks[inner], atol=5e-3)
    np.testing.assert_allclose(camera[:, 3:], [[1.0, 90.0, -10.0]] * 20)
    q[:, 3:7] = [0, 0, np.sin(0.5), np.cos(0.5)]
    camera = film_module._camera(q, ticks, distance=1.0, side=90.0, elevation=-10.0)
    np.testing.assert_allclose(camera[:, 4], 90.0 + np.degrees(1.0))


@pytest.mark.parametrize(("ticks", "frames", "size"), [(600, 6, (1920, 640)), (90, 6, (1440, 320))])
def test_a_contact_sheet_has_four_frames_in_a_row(tmp_path, ticks, frames, size):
    recording = recording_of(walk(ticks))
    path = skip_without_opengl(contact_sheet, recording, tmp_path / "sheet.png", frames)
    with Image.open(path) as sheet:
        assert sheet.size == size


def blank(count, size=SIZE):
    """Stand in for `pictures` with nothing but sky, as a place to write on."""

    def pictures(*_):
        yield from (Image.new("RGB", size, "white") for _ in range(count))

    return pictures


def is_color(pixels, color, tolerance=30):
    """Where pixels have a color, but for what the film's compression makes of it."""
    return (np.abs(pixels - np.array(ImageColor.getrgb(color))) < tolerance).all(axis=-1)


DROVE = np.arange(200) >= 100
"""The policy drives for 100 ms, then the expert."""


def frame(
    tick,
    expert_drove: np.ndarray | None = DROVE,
    pushes=(),
    waiting: np.ndarray | None = None,
):
    picture = Image.new("RGB", (400, 225), "white")
    recording = replace(recording_of(walk(), expert_drove, pushes), waiting=waiting)
    film_module._draw_caption(picture, recording, tick, "")
    film_module._draw_timeline(picture, recording, tick)
    return np.array(picture).astype(int)


def test_the_timeline_has_the_drivers_color_and_marks_now():
    colors = {True: EXPERT_COLOR, False: POLICY_COLOR}
    for tick in (0, 50, 99, 100, 150, 199):
        driver = colors[bool(DROVE[tick])]
        other = colors[not DROVE[tick]]
        bottom = frame(tick)[-2]
        now = 2 * tick
        marker = np.abs(np.arange(400) - now) <= 1
        assert (bottom[now] == 255).all()
        assert is_color(bottom[:200], POLICY_COLOR, 1)[~marker[:200]].all()
        assert is_color(bottom[200:], EXPERT_COLOR, 1)[~marker[200:]].all()
        label = frame(tick)[170:212, :100]  # the box in the lower left corner
        assert is_color(label, driver, 1).mean() > 0.1
        assert not is_color(label, other, 1).any()


def test_a_push_is_marked_on_the_timeline_and_named_for_150_ms():
    above = frame(0, pushes=(40,))[-8]
    ink = is_color(above, INK, 1)
    assert np.flatnonzero(ink[10:]).tolist() == [70]  # two pixels a tick
    named = [(frame(t, pushes=(40,)) != frame(t))[170:212].any() for t in (39, 40, 189, 190)]
    assert named == [False, True, True, False]
    # Without a driver the timeline is gray, and no driver is named.
    picture = frame(0, expert_drove=None, pushes=(40,))
    assert is_color(picture[-2, 10:], UNKNOWN_COLOR, 1).all()
    assert (picture[170:212] == 255).all()


def test_where_nobody_drives_a_gray_box_and_a_gray_timeline_say_so():
    waiting = np.where(DROVE, -1, 1)
    for tick in (0, 150):
        waits = waiting[tick] >= 0
        picture = frame(tick, waiting=waiting)
        label = picture[170:212, :100]
        assert is_color(label, UNKNOWN_COLOR, 1).any() == waits
        assert is_color(label, EXPERT_COLOR, 1).any() != waits
        assert is_color(picture[-2, 20:180], UNKNOWN_COLOR, 1).all()
        assert is_color(picture[-2, 380:], EXPERT_COLOR, 1).all()


def test_a_film_names_the_driver_only_if_it_is_known(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    monkeypatch.setattr(film_module, "pictures", blank(10))
    path = film(recording_of(walk()), tmp_path / "film.mp4", rate=50, size=SIZE)
    assert (decoded(path, 10, *SIZE)[:, 20:] > 250).all()
    film(recording_of(walk(), DROVE, (60,)), path, rate=50, size=SIZE)
    frames = decoded(path, 10, *SIZE)
    assert is_color(frames[-1, -1, 4:76], POLICY_COLOR).all()
    assert is_color(frames[0, -1, 84:156], EXPERT_COLOR).all()
    label = frames[:, 66:84, :50]
    assert is_color(label, POLICY_COLOR).any(axis=(1, 2)).tolist() == [True] * 5 + [False] * 5
    assert is_color(label, EXPERT_COLOR).any(axis=(1, 2)).tolist() == [False] * 5 + [True] * 5
    assert (frames[:, 20:60] > 250).all()


def test_a_contact_sheet_names_the_driver_of_each_frame(tmp_path, monkeypatch):
    monkeypatch.setattr(film_module, "pictures", blank(4, (960, 640)))
    path = tmp_path / "sheet.png"
    for drove, of_policy, of_expert in (
        (None, [False] * 4, [False] * 4),
        (DROVE, [True, True, False, False], [False, False, True, True]),
    ):
        contact_sheet(recording_of(walk(), drove), path, 4)
        with Image.open(path) as sheet:
            below = np.array(sheet)[40:].reshape(280, 4, 480, 3).astype(int)
        # The frames are 41 ms apart, from 37 ms on.
        assert is_color(below, POLICY_COLOR, 1).any(axis=(0, 2)).tolist() == of_policy
        assert is_color(below, EXPERT_COLOR, 1).any(axis=(0, 2)).tolist() == of_expert


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ({"expert_drove": DROVE[:-1]}, r"expert_drove \(199,\) must be \(200,\)"),
        ({"pushes": (200,)}, r"pushes \(200,\) must be ticks .* 0 to 199"),
        ({"pushes": (3, -1)}, "must be ticks of the recording"),
    ],
)
def test_events_of_another_recording_are_refused(events, message):
    with pytest.raises(ValueError, match=message):
        recording_of(walk(), **events)


@pytest.mark.parametrize("broken", [np.zeros((0, 19)), np.zeros((5, 18)), np.full((5, 19), np.nan)])
def test_arrays_that_are_no_recording_are_refused(broken):
    with pytest.raises(ValueError, match="must be finite"):
        recording_of(broken)


@pytest.mark.skipif(sys.platform != "linux", reason="MUJOCO_GL has other values elsewhere")
def test_without_opengl_the_error_says_what_to_install(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(RenderingUnavailable, match=r"MUJOCO_GL=disable.*apt-get install libegl1"):
        film(recording_of(walk(600)), tmp_path / "film.mp4", size=SIZE, workers=2)
    assert not list(tmp_path.iterdir())


def test_without_ffmpeg_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(RenderingUnavailable, match=r"pip install 'surefoot\[viz\]'"):
        film(recording_of(walk()), tmp_path / "film.mp4", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_a_film_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    path = tmp_path / "film.mp4"
    path.write_bytes(b"old")
    blank = [Image.new("RGB", SIZE)] * 10

    def stop(*_args):
        yield from blank[:3]
        raise KeyboardInterrupt

    monkeypatch.setattr(film_module, "pictures", stop)
    with pytest.raises(KeyboardInterrupt):
        film(recording_of(walk()), path, size=SIZE)
    broken = tmp_path / "ffmpeg"
    broken.write_text(
        '#!/bin/sh\nfor last; do :; done\necho half > "$last"; echo full >&2; exit 1\n'
    )
    broken.chmod(0o700)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(broken))
    monkeypatch.setattr(film_module, "pictures", lambda *_: (picture for picture in blank))
    with pytest.raises(RenderingUnavailable, match=r"could not write the film.*full"):
        film(recording_of(walk()), path, size=SIZE)
    broken.unlink()
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1


def test_another_format_than_the_name_says_is_not_written(tmp_path):
    recording = recording_of(walk(10))
    for write, name, ending in ((film, "a.png", ".mp4"), (contact_sheet, "a.mp4", ".png")):
        with pytest.raises(ValueError, match=f"{name} must end in {ending}"):
            write(recording, tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_links_stay_and_pipes_get_the_film_and_the_sheet(tmp_path):
    recording = recording_of(walk(40))
    link = tmp_path / "film.mp4"
    link.symlink_to(tmp_path / "elsewhere")
    skip_without_opengl(film, recording, link, size=(64, 48))
    assert link.is_symlink()
    content = (tmp_path / "elsewhere").read_bytes()
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for write, start in ((film, content[4:8]), (contact_sheet, b"PNG")):
        reader = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
        fcntl.fcntl(reader, fcntl.F_SETPIPE_SZ, 2**20)  # no second process has to read
        write(recording, pipe)
        assert start in os.read(reader, 100)
        os.close(reader)
        assert pipe.is_fifo()
