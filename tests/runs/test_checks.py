"""Checks of a run as a whole: two configurations, the stored initial states, this machine."""

from dataclasses import replace

import pytest
import torch

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    CommandBox,
    Config,
    DaggerConfig,
    DisturbanceConfig,
    EvaluationConfig,
    ExpertData,
    Gait,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    RobotConfig,
    SafeDaggerConfig,
    TrainingConfig,
)
from surefoot.config.presets import PRESETS, preset
from surefoot.mpc.gaits import with_gait
from surefoot.robots.load import load_robot
from surefoot.runs.checks import check_config
from surefoot.scenarios.starts import PACKAGED, load_starts, save_starts
from surefoot.types import to_ticks

UNVALIDATED = TrainingConfig(validation=0.0)


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("method", METHODS)
def test_every_preset_can_be_run(method, name):
    check_config(preset(method, name))


def test_a_robot_can_be_trained_on_initial_states_of_its_own(tmp_path):
    path = tmp_path / "dog.npz"
    save_starts(replace(load_starts(), robot="go2"), path)
    config = preset("loco_safe_dagger", "default")
    check_config(replace(config, robot=RobotConfig("go2"), start_set=str(path)))
    with pytest.raises(ValueError, match=r"'dog' belong to the robot go2, but .* asks for solo12"):
        check_config(replace(config, start_set=str(path)))


@pytest.mark.parametrize(
    ("config", "message"),
    [
        (
            Config(gait=Gait(period=0.4), start_set=PACKAGED[0]),
            r"'solo12-trot-v1' belong to the gait trot, but .* for a gait of period 0\.4 s, duty",
        ),
        (
            with_gait(Config(start_set=PACKAGED[0]), "walk"),
            "asks for the gait walk: leave --config.start-set out, or make a set",
        ),
        (
            Config(robot=RobotConfig("go2"), start_set=PACKAGED[0]),
            r"'solo12-trot-v1' belong to the robot solo12, .* asks for go2: leave",
        ),
        (
            Config(commands=CommandBox(vy=(-0.1, 0.1)), start_set=PACKAGED[0]),
            r"'solo12-trot-v1' are not at the commands of the configuration, vx 0 to 0\.3, "
            r"vy -0\.1 to 0\.1, yaw rate 0 to 0: leave --config.start-set out",
        ),
        (
            Config(robot=RobotConfig("go2")),
            "there are no initial states for the robot go2, the gait trot and these commands yet",
        ),
        (
            Config(training=TrainingConfig(mirror="front_hind")),
            "train backward commands too, such as --vx -0.3 0.3",
        ),
        (
            Config(
                gait=Gait(offsets=(0.0, 0.5, 0.5, 0.25)),
                training=TrainingConfig(mirror="left_right"),
            ),
            r"gait\.offsets is .* not the same shifted by half a period.* training\.mirror none",
        ),
        (
            Config(evaluation=EvaluationConfig(episodes=201)),
            r"evaluation\.episodes is 201; use 1 to 200",
        ),
        (
            Config(method=DaggerConfig(velocities=21)),
            r"method\.velocities is 21; use at most 20, .* 'solo12-trot-v1' .* in 'train'",
        ),
        (
            Config(method=LocoDaggerConfig(perturbations=8)),
            r"method\.perturbations is 8; use at most 7",
        ),
        (
            Config(method=BehaviorCloningConfig(data=ExpertData(999, 1, False, 1.0))),
            r"method\.data\.velocities is 999; use at most 20",
        ),
        (
            Config(method=BehaviorCloningConfig(data=ExpertData(2, 999, False, 1.0))),
            r"method\.data\.perturbations is 999; use at most 8",
        ),
        (
            Config(method=DaggerConfig(pretraining=ExpertData(21, 1, True, 1.0))),
            r"method\.pretraining\.velocities is 21; use at most 20",
        ),
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


def test_a_training_with_another_robots_pushes_is_warned_of(caplog):
    config = replace(preset("dagger", "quick"), collection=DisturbanceConfig(pushes=1))
    check_config(config)
    assert not caplog.text
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("surefoot.runs.checks.load_robot", lambda _: load_robot("go2"))
        check_config(config)
    assert "collection.impulse: pushes of 0.5 to 1.5 N s" in caplog.text


def test_a_size_of_a_series_all_of_which_is_held_out_is_refused_before_any_work():
    """Which episodes come first follows from the seed, and which are held out from their ids."""
    method = preset("behavior_cloning", "default").method
    assert isinstance(method, BehaviorCloningConfig)
    small = replace(method, frames=(to_ticks(method.data.duration), 100_000))
    refused = []
    for seed in range(10):
        config = replace(preset("behavior_cloning", "default"), method=small, seed=seed)
        try:
            check_config(config)
        except ValueError as error:
            assert "are held out (training.validation)" in str(error)
            refused.append(seed)
    assert 0 < len(refused) < 5  # a tenth is held out
