"""What the folder of a study says while another process runs it."""

import subprocess
import sys

from surefoot.study.layout import LOCK_FILE, WORKERS_FILE
from surefoot.study.state import claim_study, say_workers, workers_of

PROGRAM = """
import sys
from pathlib import Path
from surefoot.study.state import claim_study, say_workers
claim_study(Path(sys.argv[1]))
say_workers(Path(sys.argv[1]), 3)
print("claimed", flush=True)
sys.stdin.readline()
"""


def test_the_number_of_workers_is_that_of_the_process_that_runs_the_study(tmp_path):
    with subprocess.Popen(
        [sys.executable, "-c", PROGRAM, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "claimed\n"
        assert workers_of(tmp_path) == 3
        (tmp_path / WORKERS_FILE).unlink()  # as before the process has written it
        assert workers_of(tmp_path) is None
        process.kill()


def test_a_study_that_nobody_else_runs_has_no_workers(tmp_path):
    assert workers_of(tmp_path) is None
    claim_study(tmp_path)
    say_workers(tmp_path, 2)
    assert (tmp_path / LOCK_FILE).exists()
    assert workers_of(tmp_path) is None
