"""Films: what comes out where there is OpenGL, and what is said where something is missing."""

import subprocess
import sys

import numpy as np
import pytest
from PIL import Image, ImageColor

import surefoot.viz.film as viewer
from surefoot.config import SimulationConfig
from surefoot.robots.model import standing
from surefoot.robots.solo12 import solo12
from surefoot.viz.film import RenderingUnavailable, contact_sheet, film
from surefoot.viz.plots import BLUE, GRAY, RED

ROBOT, CONFIG = solo12(), SimulationConfig()
SIZE = (160, 90)


def walk(ticks: int = 200):
    q = np.tile(standing(ROBOT), (ticks, 1))
    q[:, 0] += 1e-3 * np.arange(ticks)
    q[:, 7] += 0.3 * np.sin(np.arange(ticks) / 30)
    return q


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
    assert skip_without_opengl(film, ROBOT, CONFIG, walk(), path, size=SIZE, title="walk") == path
    frames = decoded(path, 10, *SIZE)
    middle = frames[:, 20:70, 40:120]
    assert middle.std() > 15  # a robot with its shadow, not an empty floor
    assert np.abs(np.diff(middle, axis=0)).mean() > 0.5
    assert [file.name for file in tmp_path.iterdir()] == ["walk.mp4"]

    from imageio_ffmpeg import get_ffmpeg_exe

    said = subprocess.run([get_ffmpeg_exe(), "-i", path], capture_output=True, check=False).stderr
    assert b"h264" in said and b"yuv420p" in said and b"50 fps" in said
    # Slow motion shows the same moments for longer, and odd sizes are padded.
    film(ROBOT, CONFIG, walk(20), path, rate=25, size=(81, 45), speed=0.25)
    assert len(decoded(path, 2, 82, 46)) == 2


def test_the_camera_follows_the_base_and_starts_beside_the_robot():
    q, ticks = walk(2000), np.arange(0, 2000, 100)
    q[:, 0] += 0.02 * np.sin(np.arange(2000) * 2 * np.pi / 250)
    camera = viewer._camera(q, ticks, distance=1.0, side=90.0, elevation=-10.0)
    inner = slice(8, -8)
    np.testing.assert_allclose(camera[inner, 0], 1e-3 * ticks[inner], atol=5e-3)
    np.testing.assert_allclose(camera[:, 3:], [[1.0, 90.0, -10.0]] * 20)
    q[:, 3:7] = [0, 0, np.sin(0.5), np.cos(0.5)]
    camera = viewer._camera(q, ticks, distance=1.0, side=90.0, elevation=-10.0)
    np.testing.assert_allclose(camera[:, 4], 90.0 + np.degrees(1.0))


@pytest.mark.parametrize(("ticks", "frames", "size"), [(600, 6, (1920, 640)), (90, 6, (1440, 320))])
def test_a_contact_sheet_has_four_frames_in_a_row(tmp_path, ticks, frames, size):
    path = skip_without_opengl(
        contact_sheet, ROBOT, CONFIG, walk(ticks), tmp_path / "sheet.png", frames
    )
    with Image.open(path) as sheet:
        assert sheet.size == size


def blank(count, size=SIZE):
    """Instead of `viewer._pictures`: nothing but sky, as a place to write on."""

    def pictures(*_):
        yield from (Image.new("RGB", size, "white") for _ in range(count))

    return pictures


def is_colour(pixels, colour, tolerance=30):
    """Where pixels have a colour, but for what the film's compression makes of it."""
    return (np.abs(pixels - np.array(ImageColor.getrgb(colour))) < tolerance).all(axis=-1)


DROVE = np.arange(200) >= 100
"""The policy drives for 100 ms, then the expert."""


def frame(tick, expert_drove: np.ndarray | None = DROVE, pushes=()):
    picture = Image.new("RGB", (400, 225), "white")
    viewer._caption(picture, tick, "", expert_drove, pushes)
    viewer._draw_timeline(picture, tick, 200, expert_drove, pushes)
    return np.array(picture).astype(int)


def test_the_timeline_has_the_drivers_colour_and_marks_now():
    for tick, driver in ((0, RED), (50, RED), (99, RED), (100, BLUE), (150, BLUE), (199, BLUE)):
        bottom = frame(tick)[-2]
        now = 2 * tick
        marker = np.abs(np.arange(400) - now) <= 1
        assert (bottom[now] == 255).all()
        assert is_colour(bottom[:200], RED, 1)[~marker[:200]].all()
        assert is_colour(bottom[200:], BLUE, 1)[~marker[200:]].all()
        label = frame(tick)[170:212, :100]  # the box in the lower left corner
        assert is_colour(label, driver, 1).mean() > 0.1
        assert not is_colour(label, BLUE if driver == RED else RED, 1).any()


def test_a_push_is_marked_on_the_timeline_and_named_for_150_ms():
    above = frame(0, pushes=(40,))[-8]
    ink = is_colour(above, viewer.INK, 1)
    assert np.flatnonzero(ink[10:]).tolist() == [70]  # two pixels a tick
    named = [(frame(t, pushes=(40,)) != frame(t))[170:212].any() for t in (39, 40, 189, 190)]
    assert named == [False, True, True, False]
    # Without a driver the timeline is grey, and nobody is named.
    picture = frame(0, expert_drove=None, pushes=(40,))
    assert is_colour(picture[-2, 10:], GRAY, 1).all()
    assert (picture[170:212] == 255).all()


def test_a_film_shows_who_drives_only_if_told(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    monkeypatch.setattr(viewer, "_pictures", blank(10))
    path = film(ROBOT, CONFIG, walk(), tmp_path / "film.mp4", size=SIZE)
    assert (decoded(path, 10, *SIZE)[:, 20:] > 250).all()
    film(ROBOT, CONFIG, walk(), path, size=SIZE, expert_drove=DROVE, pushes=(60,))
    frames = decoded(path, 10, *SIZE)
    assert is_colour(frames[-1, -1, 4:76], RED).all()
    assert is_colour(frames[0, -1, 84:156], BLUE).all()
    label = frames[:, 66:84, :50]
    assert is_colour(label, RED).any(axis=(1, 2)).tolist() == [True] * 5 + [False] * 5
    assert is_colour(label, BLUE).any(axis=(1, 2)).tolist() == [False] * 5 + [True] * 5
    assert (frames[:, 20:60] > 250).all()


def test_a_contact_sheet_names_the_driver_of_each_frame(tmp_path, monkeypatch):
    monkeypatch.setattr(viewer, "_pictures", blank(4, (960, 640)))
    path, seen = tmp_path / "sheet.png", []
    for drove in (None, DROVE):
        contact_sheet(ROBOT, CONFIG, walk(), path, 4, expert_drove=drove)
        with Image.open(path) as sheet:
            below = np.array(sheet)[40:].reshape(280, 4, 480, 3).astype(int)
        seen.append([[is_colour(below[:, n], c, 1).any() for c in (RED, BLUE)] for n in range(4)])
    # The frames are 41 ms apart, from 37 ms on.
    assert seen == [[[False, False]] * 4, [[True, False]] * 2 + [[False, True]] * 2]


@pytest.mark.parametrize(
    ("events", "message"),
    [
        ({"expert_drove": DROVE[:-1]}, r"expert_drove \(199,\) must be \(200,\)"),
        ({"pushes": (200,)}, r"pushes \(200,\) must be ticks .* 0 to 199"),
        ({"pushes": (3, -1)}, "must be ticks of the recording"),
    ],
)
def test_events_of_another_recording_are_refused(tmp_path, events, message):
    for make in (film, contact_sheet):
        with pytest.raises(ValueError, match=message):
            make(ROBOT, CONFIG, walk(), tmp_path / "picture", **events)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("broken", [np.zeros((0, 19)), np.zeros((5, 18)), np.full((5, 19), np.nan)])
def test_what_is_no_recording_is_refused(tmp_path, broken):
    with pytest.raises(ValueError, match="must be finite"):
        film(ROBOT, CONFIG, broken, tmp_path / "film.mp4")
    with pytest.raises(ValueError, match="must be finite"):
        contact_sheet(ROBOT, CONFIG, broken, tmp_path / "sheet.png")


@pytest.mark.skipif(sys.platform != "linux", reason="MUJOCO_GL has other values elsewhere")
def test_without_opengl_the_error_says_what_to_install(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    monkeypatch.setenv("MUJOCO_GL", "disable")
    with pytest.raises(RenderingUnavailable, match=r"MUJOCO_GL=disable.*apt-get install libegl1"):
        film(ROBOT, CONFIG, walk(), tmp_path / "film.mp4", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_without_ffmpeg_the_error_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(RenderingUnavailable, match=r"pip install 'surefoot\[viz\]'"):
        film(ROBOT, CONFIG, walk(), tmp_path / "film.mp4", size=SIZE)
    assert not list(tmp_path.iterdir())


def test_a_film_that_cannot_be_written_leaves_the_old_one(tmp_path, monkeypatch):
    pytest.importorskip("imageio_ffmpeg", reason="the viz extra is not installed")
    path = tmp_path / "film.mp4"
    path.write_bytes(b"old")
    blank = [Image.new("RGB", SIZE)] * 10

    def stop(*_args):
        yield from blank[:3]
        raise KeyboardInterrupt

    monkeypatch.setattr(viewer, "_pictures", stop)
    with pytest.raises(KeyboardInterrupt):
        film(ROBOT, CONFIG, walk(), path, size=SIZE)
    broken = tmp_path / "ffmpeg"
    broken.write_text(
        '#!/bin/sh\nfor last; do :; done\necho half > "$last"; echo full >&2; exit 1\n'
    )
    broken.chmod(0o700)
    monkeypatch.setenv("IMAGEIO_FFMPEG_EXE", str(broken))
    monkeypatch.setattr(viewer, "_pictures", lambda *_: (picture for picture in blank))
    with pytest.raises(RenderingUnavailable, match=r"could not write the film.*full"):
        film(ROBOT, CONFIG, walk(), path, size=SIZE)
    broken.unlink()
    assert path.read_bytes() == b"old" and len(list(tmp_path.iterdir())) == 1
