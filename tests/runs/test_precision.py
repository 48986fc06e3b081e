"""The precision of a run: chosen when it is begun, written down, and kept whatever is faster later.

Runs of versions that wrote down no choice go on as they began.
"""

import json
from dataclasses import replace

import pytest

import surefoot.learning.precision as learning_precision
import surefoot.runs.precision as precision_module
from surefoot.config import TrainingConfig
from surefoot.files import write_json
from surefoot.learning.precision import PrecisionChoice
from surefoot.robots.scaling import with_own_values
from surefoot.runs.layout import RunError
from surefoot.runs.precision import kept_precision
from surefoot.runs.run import create, open_run
from tests.fakes.runs import collected_record
from tests.fakes.toy_runs import CONFIG, SMALL_METHODS, run_method


def trained_in(precision: str):
    """The configuration of a small run, with that precision."""
    training = replace(CONFIG.training, precision=precision)
    config = replace(CONFIG, method=SMALL_METHODS["dagger"], training=training)
    return with_own_values(config)


AUTO = trained_in("auto")


@pytest.fixture
def seconds(monkeypatch) -> dict[str, float]:
    """How long a step seems to take in each format [s]."""
    times = {"float32": 2e-3, "bfloat16": 1e-3}
    monkeypatch.setattr(learning_precision, "step_seconds", lambda *_: times)
    return times


def test_the_choice_is_written_into_the_run_and_kept(seconds, tmp_path):
    folder = tmp_path / "run"
    choice = PrecisionChoice("bfloat16", 2.0, 1.0)
    assert create(folder, AUTO).precision == choice
    seconds["float32"] = 0.5e-3  # what is faster changes
    for run in (open_run(folder), create(folder, AUTO)):
        assert run.precision == choice
        assert run.config == AUTO
    written = json.loads((folder / "config.json").read_text())
    assert written["precision"] == {"chosen": "bfloat16", "float32_ms": 2.0, "bfloat16_ms": 1.0}
    assert written["config"]["training"]["precision"] == "auto"


@pytest.mark.usefixtures("toys")
def test_all_trainings_of_a_resumed_run_have_the_precision_that_it_was_begun_with(
    seconds, tmp_path
):
    """And the bits of a run that names it."""
    create(tmp_path / "auto" / "run", AUTO)
    seconds["float32"] = 0.5e-3
    chosen = run_method(tmp_path / "auto", AUTO, resume=True)
    named = run_method(tmp_path / "named", trained_in("bfloat16"))
    for iteration in (0, 1):
        records = [run.trained(iteration) for run in (chosen, named)]
        assert records[0] is not None
        assert records[1] is not None
        policies = [run.policy_path(iteration).read_bytes() for run in (chosen, named)]
        assert records[0].precision == records[1].precision == "bfloat16"
        assert records[0].train_loss == records[1].train_loss
        assert policies[0] == policies[1]


def begun_before(folder, config) -> None:
    """A run in progress, as a version without a choice left it."""
    run = create(folder, config)
    run.append_metrics(collected_record(0))
    setup = json.loads((folder / "config.json").read_text())
    del setup["precision"]
    write_json(folder / "config.json", setup)


@pytest.mark.parametrize(("has_instructions", "kept"), [(True, "bfloat16"), (False, "float32")])
def test_a_run_of_an_earlier_version_goes_by_the_instructions(
    seconds, monkeypatch, tmp_path, has_instructions, kept
):
    before = trained_in("bfloat16")
    begun_before(tmp_path / "run", before)
    monkeypatch.setattr(precision_module, "has_bfloat16", lambda device: has_instructions)
    for config in (before, AUTO):  # the default was bfloat16 and is auto now
        run = create(tmp_path / "run", config, resume=True)
        assert run.config == before
        assert run.precision is None
        assert kept_precision(run.config.training, run.precision).precision == kept
    with pytest.raises(RunError, match="another configuration"):
        create(tmp_path / "run", trained_in("float32"), resume=True)


def test_a_run_of_an_earlier_version_in_float32_stays_there(monkeypatch):
    monkeypatch.setattr(precision_module, "has_bfloat16", lambda device: True)
    training = TrainingConfig(precision="float32")
    assert kept_precision(training, None).precision == "float32"


def test_a_damaged_choice_is_an_error_that_names_the_file(seconds, tmp_path):
    create(tmp_path / "run", AUTO)
    path = tmp_path / "run" / "config.json"
    setup = json.loads(path.read_text())
    setup["precision"]["chosen"] = "float61"
    path.write_text(json.dumps(setup))
    with pytest.raises(RunError, match=r"config.json cannot be read.*float61"):
        open_run(tmp_path / "run")
