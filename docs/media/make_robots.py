"""Film several robots and gaits, and join the films to robots.webp, the picture of the README.

Run it with the extra viz: ``python docs/media/make_robots.py FOLDER``. Films that lie in the folder
already are not made again. The films take ten minutes on two busy cores, the picture seconds.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from PIL import Image, ImageDraw, ImageFont

OUT = Path(__file__).parent / "robots.webp"
SECONDS = "6"
WIDTH = 320
HEIGHT = 160
COLUMNS = 3
RATE = 12.5
"""[1/s] frames of the picture."""
FIRST = 1.5
LAST = 5.5
"""[s] of the films that are shown: after the start from standing."""


@dataclass(frozen=True)
class Scene:
    """A film and its caption.

    Attributes:
        name: Name of the film, without its ending.
        caption: Text in the picture.
        command: The command of `surefoot` that films it.
    """

    name: str
    caption: str
    command: str


SCENES = (
    Scene("policy", "Solo12: the packaged policy", "play --vx 0.3"),
    Scene("go2-turn", "Go2: trot in a turn", "walk --robot go2 --vx 0.6 --yaw-rate 0.5"),
    Scene("anymal_c-trot", "ANYmal C: trot, 0.8 m/s", "walk --robot anymal_c --vx 0.8"),
    Scene("solo12-bound", "Solo12: bound", "walk --gait bound --vx 0.5"),
    Scene("go2-bound", "Go2: bound", "walk --robot go2 --gait bound --vx 0.6"),
    Scene("solo12-bumps", "Solo12: bumps of 5 cm", "walk --terrain bumps:0.05 --vx 0.3"),
)


def film(scene: Scene, folder: Path) -> Path:
    """The film of a scene, made if it is missing.

    Args:
        scene: What is filmed.
        folder: Where the film lies.
    """
    path = folder / f"{scene.name}.mp4"
    if not path.exists():
        command = ["surefoot", *scene.command.split(), "--seconds", SECONDS, "--out", str(path)]
        subprocess.run([sys.executable, "-m", *command], check=True)
    return path


def frames(path: Path) -> np.ndarray:
    """The frames of a film, without its own caption: ``(N, HEIGHT, WIDTH, 3)`` bytes.

    Args:
        path: The film, 960 x 540.
    """
    shown = f"crop=960:480:0:60,scale={WIDTH}:{HEIGHT}:flags=area,fps={RATE}"
    source = ["-ss", str(FIRST), "-to", str(LAST), "-i", str(path)]
    target = ["-vf", shown, "-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *source, *target]
    pixels = subprocess.run(command, check=True, capture_output=True).stdout
    return np.frombuffer(pixels, np.uint8).reshape(-1, HEIGHT, WIDTH, 3)


def main(folder: Path) -> None:
    """Make the films, then the picture.

    Args:
        folder: Where the films lie.
    """
    folder.mkdir(parents=True, exist_ok=True)
    films = [frames(film(scene, folder)) for scene in SCENES]
    rows = -(-len(SCENES) // COLUMNS)
    font = ImageFont.load_default(13)
    pictures: list[Image.Image] = []
    for number in range(min(map(len, films))):
        picture = Image.new("RGB", (COLUMNS * WIDTH, rows * HEIGHT))
        draw = ImageDraw.Draw(picture)
        for place, (scene, shown) in enumerate(zip(SCENES, films, strict=True)):
            row, column = divmod(place, COLUMNS)
            corner = (column * WIDTH, row * HEIGHT)
            picture.paste(Image.fromarray(shown[number]), corner)
            draw.text((corner[0] + 8, corner[1] + 5), scene.caption, fill="#282D37", font=font)
        pictures.append(picture)
    pictures[0].save(
        OUT,
        save_all=True,
        append_images=pictures[1:],
        duration=round(1000 / RATE),
        loop=0,
        quality=50,
        method=4,
    )
    print(f"{OUT}: {OUT.stat().st_size / 1e6:.1f} MB, {len(pictures)} frames")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
