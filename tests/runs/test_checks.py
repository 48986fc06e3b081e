"""Checks of a run as a whole: two configurations, the stored initial states, this machine."""

from dataclasses import replace

import pytest
import torch

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    Config,
    DaggerConfig,
    EvaluationConfig,
    ExpertData,
    Gait,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    SafeDaggerConfig,
    TrainingConfig,
)
from surefoot.config.presets import PRESETS, preset
from surefoot.runs.checks import check_config, parameters
from surefoot.runs.run import Run

UNVALIDATED = TrainingConfig(validation=0.0)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("method", METHODS)
def test_every_preset_can_be_run(method, name):
    check_config(preset(method, name))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (Config(gait=Gait(period=0.4)), "belong to the default gait"),
        (
            Config(evaluation=EvaluationConfig(episodes=201)),
            r"evaluation\.episodes is 201; use 1 to 200",
        ),
        (
            Config(method=DaggerConfig(velocities=21)),
            r"21 velocities asked for, .* hold 20 in .train.",
        ),
        (Config(method=LocoDaggerConfig(perturbations=8)), "8 perturbations asked for.*hold 7"),
        (
            Config(method=SafeDaggerConfig(), training=UNVALIDATED),
            r"training\.validation is 0, but tau",
        ),
        (
            Config(method=LocoSafeDaggerConfig(gates=("classifier",)), training=UNVALIDATED),
            r"training\.validation is 0, but tau",
        ),
        (
            Config(method=SafeDaggerConfig(pretraining=ExpertData(10, 0, True, 1.5))),
            r"training\.validation is 0\.1, which holds out none of the 10 rollouts",
        ),
    ],
)
def test_a_run_that_cannot_be_done_is_refused(config, message):
    with pytest.raises(ValueError, match=message):
        check_config(config)


def test_a_run_whose_expert_data_is_unperturbed_can_be_done():
    data = ExpertData(20, 0, True, 3.0)
    for method in (BehaviorCloningConfig(data), LocoDaggerConfig(pretraining=data)):
        check_config(Config(method=method))


def test_without_a_classifier_nothing_has_to_be_held_out():
    for method in (BehaviorCloningConfig(), LocoSafeDaggerConfig(gates=("bounds",))):
        check_config(Config(method=method, training=UNVALIDATED))


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_refused():
    with pytest.raises(ValueError, match="finds no GPU"):
        check_config(Config(training=TrainingConfig(device="cuda")))


def test_parameters_are_those_of_the_runs_method(tmp_path):
    run = Run(tmp_path, replace(Config(), method=DaggerConfig(p=0.25)))
    assert parameters(run, DaggerConfig).p == 0.25
    with pytest.raises(TypeError, match="configured for dagger, not for loco_dagger"):
        parameters(run, LocoDaggerConfig)
