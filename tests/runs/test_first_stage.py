"""Runs that begin with what another has made: the same bits as if they had made it themselves."""

from dataclasses import replace

import pytest

from surefoot.config import DisturbanceConfig, PolicyConfig
from surefoot.methods import METHODS as TRAINED
from surefoot.runs.first_stage import copy_first_stage, first_stage
from surefoot.runs.layout import RunError
from surefoot.runs.run import create
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.runs import fingerprint
from tests.fakes.toy import plan
from tests.fakes.toy_runs import CONFIG, METHODS, run_method

pytestmark = pytest.mark.usefixtures("toys")


def begun(folder, source, config, shared):
    """A run that begins with the first stage of another, and is trained to its end."""
    run = create(folder / "run", config)
    copy_first_stage(source, run, shared)
    TRAINED[run.method].train(run, Workers(1), plan)
    return run


@pytest.mark.parametrize(
    "name", first_often(1, ["safe_dagger", "dagger", "loco_dagger-0.5", "loco_safe_dagger"])
)
def test_a_method_that_begins_with_anothers_pretraining_ends_with_its_own_bits(
    tmp_path, runs, name
):
    source = runs("loco_dagger-0.8")
    config = replace(CONFIG, method=METHODS[name])
    assert fingerprint(begun(tmp_path, source, config, "policy")) == fingerprint(runs(name))


def test_a_training_on_anothers_data_ends_with_its_own_bits_and_other_weights(tmp_path, runs):
    source = runs("behavior_cloning")
    training = replace(CONFIG.training, seed=77)
    config = replace(CONFIG, method=METHODS["behavior_cloning"], training=training)
    own = run_method(tmp_path / "own", config)
    copied = begun(tmp_path / "copied", source, config, "data")
    assert fingerprint(copied) == fingerprint(own)
    assert copied.dataset.hash == source.dataset.hash
    assert copied.trained(0) != source.trained(0)


def test_nothing_is_copied_twice(tmp_path, runs):
    source = runs("loco_dagger-0.8")
    run = create(tmp_path / "run", replace(CONFIG, method=METHODS["dagger"]))
    copy_first_stage(source, run, "data")
    copy_first_stage(source, run, "policy")
    copy_first_stage(source, run, "policy")
    assert [record.stage for record in run.metrics] == ["collect", "train"]


@pytest.mark.parametrize(
    ("changes", "shared"),
    [
        ({"seed": 6}, "data"),
        ({"chunk": 5}, "data"),
        ({"starts": "nominal"}, "data"),
        ({"pretraining": DisturbanceConfig(pushes=1)}, "data"),
        ({"policy": PolicyConfig(hidden=(8,))}, "policy"),
        ({"training": replace(CONFIG.training, batch=32)}, "policy"),
        ({"method": replace(METHODS["dagger"], pretraining_epochs=3)}, "policy"),
        ({"method": replace(METHODS["dagger"], pretraining_steps=3)}, "policy"),
    ],
)
def test_a_run_that_begins_otherwise_is_refused(tmp_path, runs, changes, shared):
    config = replace(CONFIG, **({"method": METHODS["dagger"]} | changes))
    run = create(tmp_path / "run", config)
    with pytest.raises(RunError, match=f"cannot begin with the {shared}"):
        copy_first_stage(runs("loco_dagger-0.8"), run, shared)
    assert not run.metrics


def test_a_source_that_has_not_come_so_far_is_refused(tmp_path):
    config = replace(CONFIG, method=METHODS["dagger"])
    source = create(tmp_path / "source", config)
    target = create(tmp_path / "target", config)
    with pytest.raises(RunError, match="has not made its first data yet"):
        copy_first_stage(source, target, "data")


def test_pushes_fix_the_data_of_behavior_cloning_and_not_that_of_a_pretraining():
    pushed = replace(CONFIG, collection=DisturbanceConfig(pushes=5))
    for name, same in (("behavior_cloning", False), ("dagger", True)):
        method = METHODS[name]
        before = first_stage(replace(CONFIG, method=method), "data")
        assert (first_stage(replace(pushed, method=method), "data") == before) is same
