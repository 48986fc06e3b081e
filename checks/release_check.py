"""Build the package, install the wheel where nothing is, and use it as its first user would.

`make release-check` runs it. The user has no checkout, no HOME and an empty folder: what the wheel
lacks, or what only works beside its source, fails here. ``--python python3.12`` takes another
interpreter, ``--demo`` runs the demo, too (minutes).
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parent.parent
DATA = (
    "surefoot/py.typed",
    "surefoot/__init__.pyi",
    "surefoot/runs/data/solo12-trot.safetensors",
    "surefoot/scenarios/data/solo12-trot-v1.npz",
    "surefoot/scenarios/data/solo12-trot-v1-wide.npz",
)
"""Files of the wheel that are no modules, and without which commands fail."""
NOBODY = 65534
"""The user without anything."""
WHEEL_BYTES = 8_000_000
SDIST_BYTES = 12_000_000
"""Sizes that are worth a question."""


def check_contents(wheel: Path, sdist: Path) -> list[str]:
    """What is wrong with the files that are to be published; nothing if all is well.

    Args:
        wheel: The wheel.
        sdist: The archive of the source.
    """
    with zipfile.ZipFile(wheel) as archive:
        in_wheel = archive.namelist()
    with tarfile.open(sdist) as archive:
        in_sdist = archive.getnames()
    wrong = [f"the wheel lacks {name}" for name in DATA if name not in in_wheel]
    caches = ("__pycache__", ".pyc", ".nbi", ".nbc")
    names = (*in_wheel, *in_sdist)
    wrong += [f"{name} is a cache" for name in names if any(part in name for part in caches)]
    own = ("surefoot", f"{wheel.name.partition('-py3')[0]}.dist-info")
    wrong += [
        f"{name} is no part of the package" for name in in_wheel if name.split("/")[0] not in own
    ]
    for path, most in ((wheel, WHEEL_BYTES), (sdist, SDIST_BYTES)):
        size = path.stat().st_size
        print(f"{path.name}: {size / 1e6:.1f} MB")
        if size > most:
            wrong.append(f"{path.name} has {size} bytes, more than {most}")
    return wrong


def run(command: Sequence[str | Path], **options: object) -> None:
    """Run a command, and show it.

    Raises:
        CalledProcessError: It fails.
    """
    print("$", *map(str, command), flush=True)
    subprocess.run(list(map(str, command)), check=True, **options)  # pyright: ignore


def use(binaries: Path, folder: Path, demo: bool) -> None:
    """Run commands in an empty folder as a user without HOME, who may not write to the package.

    Args:
        binaries: Where the command is.
        folder: Where the user's own two folders are made.
        demo: Whether the demo is run, too.

    Raises:
        CalledProcessError: A command fails.
    """
    folder.chmod(0o755)
    empty = folder / "empty"
    temporary = folder / "tmp"
    options: dict[str, object] = {}
    for own in (empty, temporary):
        own.mkdir()
    if os.geteuid() == 0:  # root may write everywhere, and has a home without HOME
        for own in (empty, temporary):
            os.chown(own, NOBODY, NOBODY)
        nobody: dict[str, object] = {"user": NOBODY, "group": NOBODY, "extra_groups": []}
        try:
            run([binaries / "python", "-c", ""], **nobody)
            options = nobody
        except PermissionError:
            print("the interpreter lies where only root may go, so that root is the user")
    environment = {"PATH": os.defpath, "TMPDIR": str(temporary)}
    commands = [["doctor"], ["play", "--seconds", "2"], ["walk", "--seconds", "1", "--no-video"]]
    if demo:
        commands.append(["demo"])
    for command in commands:
        run([binaries / "surefoot", *command], cwd=empty, env=environment, **options)


def main() -> int:
    """Build, check and use the package; 1 if something is wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", default=sys.executable, help="interpreter of the new user")
    parser.add_argument("--extras", default="viz", help="extras to install, with commas in between")
    parser.add_argument("--constraints", default=str(ROOT / "constraints.txt"))
    parser.add_argument("--demo", action="store_true", help="run the demo, too")
    parser.add_argument("--keep", help="a folder that is left there, instead of a temporary one")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(args.keep or temporary).resolve()  # programs run in other folders
        if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
            parser.error(f"--keep {args.keep} is no empty folder; name another one")
        folder.mkdir(parents=True, exist_ok=True)
        run([sys.executable, "-m", "build", "--outdir", folder / "dist", ROOT])
        (wheel,) = (folder / "dist").glob("*.whl")
        (sdist,) = (folder / "dist").glob("*.tar.gz")
        wrong = check_contents(wheel, sdist)
        if wrong:
            print(*wrong, sep="\n")
            return 1
        run([args.python, "-m", "venv", folder / "venv"])
        binaries = folder / "venv" / "bin"
        wanted = f"{wheel}[{args.extras}]" if args.extras else str(wheel)
        constraints = ["-c", args.constraints] if args.constraints else []
        pip = [binaries / "python", "-m", "pip", "install", "--quiet", "--no-cache-dir"]
        run([*pip, *constraints, wanted])
        use(binaries, folder, args.demo)
    print("the wheel works for a user without a checkout and without HOME")
    return 0


if __name__ == "__main__":
    sys.exit(main())
