"""Presets: the paper's numbers, and what the cheaper ones keep of them."""

from dataclasses import replace

import pytest

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    DaggerConfig,
    DisturbanceConfig,
    ExpertData,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    PolicyConfig,
    RobotConfig,
    SafeDaggerConfig,
    SafetyConfig,
)
from surefoot.config.learning import Steps
from surefoot.config.presets import PRESETS, preset
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values


@pytest.mark.parametrize("name", ["default", "quick"])
def test_tuned_presets_keep_the_papers_protocol(name):
    dagger = preset("loco_safe_dagger", name)
    cloning = preset("behavior_cloning", name)
    paper = LocoSafeDaggerConfig()
    for field in ("T_end", "hand_back", "velocities", "perturbations"):
        assert getattr(dagger.method, field) == getattr(paper, field)
    assert dagger.safety == SafetyConfig()
    assert dagger.training == cloning.training
    if name == "default":
        assert (dagger.method.iterations, dagger.method.T) == (paper.iterations, paper.T)
    else:
        # Both methods start from the same data, so that they can be compared.
        assert cloning.method.data == dagger.method.pretraining


def test_the_default_preset_trains_little_while_data_are_still_to_come():
    """The last training is the longest."""
    method = preset("loco_safe_dagger", "default").method
    lengths = [method.training_in(i) for i in range(method.iterations + 1)]
    assert lengths == [8, *[Steps(2000)] * 9, 12]
    for name in METHODS:
        training = preset(name).training
        assert (training.weight_decay, training.input_noise, training.mirror) == (0.0, 0.0, "auto")
        quick = preset(name, "quick").training
        assert replace(quick, mirror="auto") == training


def test_the_preset_pushed_differs_from_the_default_one_by_the_pushes_of_the_expert_alone():
    for method in METHODS:
        default = preset(method, "default")
        pushed = preset(method, "pushed")
        first = "collection" if method == "behavior_cloning" else "pretraining"
        assert getattr(default, first).pushes == 0
        assert getattr(pushed, first).pushes == 1
        assert replace(pushed, **{first: getattr(default, first)}) == default


@pytest.mark.parametrize("name", ["solo12", "go2"])
def test_an_expert_that_teaches_is_pushed_harder_than_a_policy_and_by_the_robots_mass(name):
    robot = RobotConfig(name)
    ratio = 1.0 if name == "solo12" else load_robot(robot).mass / load_robot(RobotConfig()).mass
    for method in ("behavior_cloning", "loco_safe_dagger"):
        config = with_own_values(replace(preset(method, "pushed"), robot=robot))
        cloned = method == "behavior_cloning"
        taught = config.collection if cloned else config.pretraining
        assert taught.impulse == pytest.approx((0.5 * ratio, 3.0 * ratio), rel=1e-3)
        if not cloned:
            assert config.collection.impulse == pytest.approx((0.3 * ratio, 1.5 * ratio), rel=1e-3)


def test_the_preset_paper_has_the_numbers_of_the_paper():
    """Numbers of the paper and of its research code, written down once more."""
    config = preset("loco_safe_dagger", "paper")
    assert config.simulation.backend == "bullet"
    assert config.simulation.friction == 0.5
    method = config.method
    training = config.training
    assert isinstance(method, LocoSafeDaggerConfig)
    assert method.pretraining == ExpertData(10, 1, True, 1.5)
    assert (method.pretraining_epochs, method.epochs, method.iterations) == (150, 15, 10)
    assert (method.velocities, method.perturbations, method.T) == (20, 2, 10.0)
    assert (method.T_block, method.T_end) == (2.0, 1.0)
    assert (training.learning_rate, training.batch, training.schedule) == (2e-3, 256, "constant")
    assert (training.validation, training.precision) == (0.1, "float32")
    assert (training.weight_decay, training.input_noise, method.steps_before_last) == (0, 0, None)
    assert training.mirror == "none"
    assert config.policy == PolicyConfig(phase="fraction")
    config = with_own_values(config)  # Solo12's
    assert config.policy == PolicyConfig((512, 512, 512), 2.0, 0.1, "fraction")
    assert (config.expert.kp, config.expert.kd) == (3.0, 0.05)
    assert (config.expert.foothold_rule, config.expert.command_gain) == ("published", (1, 1, 1))
    assert (config.expert.centroidal.nodes, config.expert.kinematic.nodes) == (20, 10)
    assert (config.gait.period, config.gait.duty, config.gait.step_height) == (0.5, 0.6, 0.075)
    assert (config.evaluation.episodes, config.evaluation.duration) == (100, 5.0)
    cloning = preset("behavior_cloning", "paper").method
    assert cloning == BehaviorCloningConfig(ExpertData(20, 2, False, 3.0), 150)


def test_the_preset_paper_has_the_other_methods_as_the_paper_or_their_authors_do():
    loco = preset("loco_dagger", "paper").method
    assert isinstance(loco, LocoDaggerConfig)
    assert (loco.iterations, loco.velocities * loco.perturbations, loco.T) == (10, 10, 5.0)
    assert (loco.N_query, loco.T_query, loco.before_fall) == (5, 1.0, 0.2)
    assert (loco.alpha, loco.epochs) == (0.5, 15)
    safe = preset("safe_dagger", "paper").method
    assert isinstance(safe, SafeDaggerConfig)
    assert safe.unsafe_share == 0.2
    dagger = preset("dagger", "paper").method
    assert isinstance(dagger, DaggerConfig)
    assert dagger.p == 0.5
    for name in METHODS:
        assert preset(name, "paper").collection == DisturbanceConfig()
        assert preset(name, "paper").evaluation.disturbance == DisturbanceConfig()


@pytest.mark.parametrize("name", PRESETS)
def test_all_iterative_methods_begin_with_the_same_data_and_training(name):
    methods = [preset(each, name).method for each in METHODS if each != "behavior_cloning"]
    assert len({(m.pretraining, m.training_in(0)) for m in methods}) == 1
    assert len({(m.training_in(1), m.training_in(m.iterations)) for m in methods}) == 1


def test_an_unknown_preset_or_method_names_the_nearest():
    with pytest.raises(ValueError, match="no preset 'quik'; did you mean 'quick'"):
        preset("loco_safe_dagger", "quik")
    with pytest.raises(
        ValueError, match="no method 'locosafedagger'; did you mean 'loco_safe_dagger'"
    ):
        preset("locosafedagger")


def test_the_pushes_of_a_preset_are_as_hard_for_the_mass_of_a_robot():
    solo12 = with_own_values(preset("loco_safe_dagger"))
    assert (solo12.collection.impulse, solo12.collection.expert_impulse) == ((0.3, 1.5), (0.5, 3))
    assert solo12.push.resolution == 0.2
    config = replace(preset("loco_safe_dagger"), robot=RobotConfig("go2"))
    ratio = load_robot("go2").mass / 2.5
    go2 = with_own_values(config)
    assert go2.collection.impulse == pytest.approx((0.3 * ratio, 1.5 * ratio), rel=1e-3)
    assert go2.push.resolution == pytest.approx(0.2 * ratio, rel=1e-3)
    given = replace(config, collection=DisturbanceConfig(1, impulse=(1.0, 2.0)))
    assert with_own_values(given).collection.impulse == (1.0, 2.0)
