"""Jobs of a study that are tiny programs, and only sleep or fail."""

from pathlib import Path

from surefoot.config.study import Measurement, StudyConfig, Technique
from surefoot.study.folder import StudySetup, save_setup
from surefoot.study.supervise import Task

PROGRAM = """
import os, sys, time
folder, job = sys.argv[1:]
print("working on", job, os.environ["OMP_NUM_THREADS"], flush=True)
if job == "fails":
    raise ValueError("no such thing")
if job == "later":
    sys.exit(75)
if job == "long":
    open(os.path.join(folder, "pid"), "w").write(str(os.getpid()))
    time.sleep(60)
"""


def study_of_tiny_jobs(folder: Path) -> Path:
    """Make the folder of a study whose code is the tiny program."""
    study = StudyConfig(
        "mine", "My study", (Technique("a", "A", "dagger"),), (Measurement("t", "t"),)
    )
    save_setup(folder, StudySetup(study, None, "0", "float32"))
    package = folder / "code" / "surefoot" / "study"
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    (package.parent / "__init__.py").touch()
    (package / "work.py").write_text(PROGRAM)
    return folder


def task(folder: Path, job: str) -> Task:
    """A job of such a study: ends, fails, later or long, by its name."""
    return Task(folder, job, folder / "code")
