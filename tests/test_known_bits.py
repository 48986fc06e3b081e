"""Solo12's trot as the study `smoke` runs it: neither its bits change nor, elsewhere, its numbers.

Bits are promised for one model of processor and one set of versions. ``data/smoke_bits.json`` holds
the hashes of those on which they were stored, and numbers for all others.
``PYTHONPATH=. python -m tests.test_known_bits`` adds the hashes of this machine.
"""

import hashlib
import json
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.config.studies import named_study
from surefoot.config.study import config_of
from surefoot.methods import METHODS
from surefoot.runs.run import create
from surefoot.runs.versions import versions
from surefoot.workers import Workers

FILE = Path(__file__).parent / "data" / "smoke_bits.json"
TECHNIQUES = ("behavior_cloning", "loco_safe_dagger")
EVERY = 100
"""[ms] between the states that are stored."""
TOLERANCE = 1e-9
"""[m, rad] by which the expert's states may differ elsewhere. On a Xeon whose libraries were told
to be on a Haswell they differed by 1.2e-13."""


def smoke_run(technique, folder):
    """A run of the smoke study's first seed."""
    study = named_study("smoke")
    config = config_of(study.technique(technique), study.settings[0])
    run = create(folder, replace(config, seed=study.seeds[0]))
    METHODS[run.method].train(run, Workers(1), None)
    return run


def hashes_of(run):
    """SHA-256 of the data, and of all that the policies compute with."""
    policies = hashlib.sha256()
    for path in sorted((run.folder / "policies").glob("*")):
        policies.update(path.read_bytes())
    return {"data": run.dataset.hash, "policies": policies.hexdigest()}


def states_of(run):
    """``(n, 19)`` the configuration of the expert's robots every 100 ms."""
    frames = run.dataset.load(all_ticks=True)
    return frames.q[::EVERY]


def platform_of_bits():
    """What the bits depend on, in a line; a virtual machine may hide a part of its instructions."""
    parts = versions()
    del parts["surefoot"], parts["h5py"], parts["onnxruntime"]
    lines = Path("/proc/cpuinfo").read_text().splitlines() if sys.platform == "linux" else []
    flags = next((line for line in lines if line.startswith("flags")), "")
    parts["instructions"] = hashlib.sha256(flags.encode()).hexdigest()[:8]
    return ", ".join(f"{name} {value}" for name, value in parts.items())


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("smoke")
    return {technique: smoke_run(technique, folder / technique) for technique in TECHNIQUES}


def test_on_a_known_processor_the_smoke_study_has_the_stored_bits(runs):
    stored = json.loads(FILE.read_text())["hashes"].get(platform_of_bits())
    if stored is None:
        pytest.skip(f"no bits are stored for {platform_of_bits()}")
    assert {name: hashes_of(run) for name, run in runs.items()} == stored


def test_anywhere_the_expert_walks_as_stored(runs):
    stored = np.array(json.loads(FILE.read_text())["states"])
    np.testing.assert_allclose(states_of(runs["behavior_cloning"]), stored, atol=TOLERANCE, rtol=0)


def main():
    """Store the bits of this machine."""
    stored = json.loads(FILE.read_text())
    with tempfile.TemporaryDirectory() as folder:
        runs = {
            technique: smoke_run(technique, Path(folder) / technique) for technique in TECHNIQUES
        }
        stored["hashes"][platform_of_bits()] = {name: hashes_of(run) for name, run in runs.items()}
        # The numbers of other processors are to stay near those of the first one.
        stored["states"] = stored["states"] or states_of(runs["behavior_cloning"]).tolist()
    text = json.dumps(stored)
    FILE.write_text(
        text.replace("[[", "[\n[").replace("], [", "],\n[").replace("]]", "]\n]") + "\n"
    )


if __name__ == "__main__":
    main()
