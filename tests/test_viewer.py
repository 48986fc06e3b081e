"""Films: what comes out where there is OpenGL, and what is said where something is missing."""

import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from surefoot import viewer
from surefoot.config import SimulationConfig
from surefoot.robot import solo12, standing
from surefoot.viewer import RenderingUnavailable, contact_sheet, film

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
