"""Runs that begin with what another has made: the same bits as if they had made it themselves."""

from dataclasses import replace

import pytest

import surefoot.runs.run as run_module
from surefoot.config import (
    TABLE_I,
    DisturbanceConfig,
    OtherGait,
    PolicyConfig,
    RobotConfig,
)
from surefoot.config.gait_table import GAITS
from surefoot.learning.precision import PrecisionChoice
from surefoot.methods import METHODS as TRAINED
from surefoot.runs.first_stage import copy_first_stage, first_stage
from surefoot.runs.layout import RunError
from surefoot.runs.run import create
from surefoot.workers import Workers
from tests.cases import first_often
from tests.fakes.runs import collected_record, fingerprint, trained, trained_record
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
    assert trained(copied, 0).train_loss != trained(source, 0).train_loss


OTHER_SECTIONS = {
    "seed": 6,
    "chunk": 5,
    "robot": RobotConfig(torque_limit=1.0),
    "simulation": replace(CONFIG.simulation, friction=0.3),
    "gait": GAITS["bound"],
    "other_gaits": (OtherGait(GAITS["bound"]),),
    "switches": 3,
    "commands": replace(CONFIG.commands, vy=(-0.1, 0.1)),
    "expert": replace(CONFIG.expert, kp=1.0),
    "safety": replace(TABLE_I, fall_angle=20.0),
    "start_set": "solo12-trot-v1-wide",
    "starts": "nominal",
}


@pytest.mark.parametrize(("section", "value"), OTHER_SECTIONS.items(), ids=OTHER_SECTIONS)
def test_each_part_of_a_configuration_that_fixes_rollouts_fixes_the_first_data(section, value):
    other = replace(CONFIG, **{section: value})
    assert first_stage(other, "data") != first_stage(CONFIG, "data")


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


def test_a_policy_trained_in_another_precision_is_refused_and_its_data_is_not(
    tmp_path, monkeypatch
):
    """Two runs of one configuration, for which another precision was the faster one."""
    config = replace(CONFIG, method=METHODS["dagger"])
    config = replace(config, training=replace(config.training, precision="auto"))

    def begun_in(chosen):
        monkeypatch.setattr(run_module, "choose_for_run", lambda _: PrecisionChoice(chosen))
        return create(tmp_path / chosen, config)

    source = begun_in("bfloat16")
    source.append_metrics(collected_record(0))
    source.append_metrics(trained_record(0))
    target = begun_in("float32")
    with pytest.raises(RunError, match=r"trains in bfloat16, and .* in float32"):
        copy_first_stage(source, target, "policy")
    assert not target.metrics
    copy_first_stage(source, target, "data")
    assert target.collected(0) == source.collected(0)


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
