"""The methods' parameters: what they share, and rules that need two fields of one method."""

from dataclasses import fields, replace
from typing import Any, cast

import pytest

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    DaggerConfig,
    ExpertData,
    IterativeConfig,
    LocoDaggerConfig,
    LocoSafeDaggerConfig,
    SafeDaggerConfig,
    Steps,
    method_config,
)

SHARED = [field.name for field in fields(IterativeConfig)]


@pytest.mark.parametrize("name", METHODS)
def test_a_method_is_found_by_its_name(name):
    config = method_config(name)
    assert type(config) is METHODS[name]
    assert config.name == name


def test_an_unknown_method_names_the_nearest():
    with pytest.raises(ValueError, match="no method 'dager'; did you mean 'dagger'"):
        method_config("dager")


def test_all_methods_but_behavior_cloning_are_iterative():
    assert SHARED == [
        "pretraining",
        "pretraining_epochs",
        "iterations",
        "velocities",
        "perturbations",
        "T",
        "epochs",
        "pretraining_steps",
        "steps",
        "steps_before_last",
    ]
    for name, kind in METHODS.items():
        assert issubclass(kind, IterativeConfig) == (name != "behavior_cloning")
        if name != "behavior_cloning":
            assert [field.name for field in fields(kind)][: len(SHARED)] == SHARED


def test_methods_differ_in_how_many_rollouts_they_make():
    dagger = DaggerConfig()
    safe = SafeDaggerConfig()
    loco_safe = LocoSafeDaggerConfig()
    assert (dagger.velocities, dagger.perturbations, dagger.T) == (10, 1, 5.0)
    assert (safe.velocities, safe.perturbations, safe.T) == (20, 2, 5.0)
    assert (loco_safe.velocities, loco_safe.perturbations, loco_safe.T) == (20, 2, 10.0)


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (BehaviorCloningConfig, {"epochs": 0}, "method.epochs is 0; use 1 to"),
        (IterativeConfig, {"pretraining_epochs": 0}, "method.pretraining_epochs is 0; use 1 to"),
        (IterativeConfig, {"iterations": -1}, "method.iterations is -1; use 0 to"),
        (IterativeConfig, {"velocities": 0}, "method.velocities is 0; use 1 to"),
        (IterativeConfig, {"perturbations": 0}, "method.perturbations is 0; use 1 to"),
        (IterativeConfig, {"T": 0.0}, "method.T is 0.0; use 0.001 to"),
        (IterativeConfig, {"epochs": 0}, "method.epochs is 0; use 1 to"),
        (IterativeConfig, {"steps": 0}, "method.steps is 0; use 1 to"),
        (IterativeConfig, {"pretraining_steps": -1}, "method.pretraining_steps is -1; use 1 to"),
        (IterativeConfig, {"steps_before_last": 0}, "method.steps_before_last is 0; use 1 to"),
        (BehaviorCloningConfig, {"steps": 0}, "method.steps is 0; use 1 to"),
        (DaggerConfig, {"p": 1.5}, "method.p is 1.5; use 0.0 to 1.0"),
        (SafeDaggerConfig, {"velocities": 0}, "method.velocities is 0; use 1 to"),
        (SafeDaggerConfig, {"perturbations": 0}, "method.perturbations is 0; use 1 to"),
        (SafeDaggerConfig, {"unsafe_share": 20.0}, "method.unsafe_share is 20.0; use 0.0 to 1.0"),
        (LocoDaggerConfig, {"alpha": -0.1}, "method.alpha is -0.1; use 0.0 to 1.0"),
        (LocoDaggerConfig, {"N_query": 0}, "method.N_query is 0; use 1 to 600"),
        (LocoDaggerConfig, {"N_query": 1000}, "method.N_query is 1000; use 1 to 600"),
        (LocoDaggerConfig, {"T_query": 0.0}, "method.T_query is 0.0; use 0.001 to"),
        (LocoDaggerConfig, {"before_fall": -1.0}, "method.before_fall is -1.0; use 0.0 to"),
        (LocoSafeDaggerConfig, {"velocities": 0}, "method.velocities is 0; use 1 to"),
        (LocoSafeDaggerConfig, {"perturbations": 0}, "method.perturbations is 0; use 1 to"),
        (LocoSafeDaggerConfig, {"T_block": -0.1}, "method.T_block is -0.1; use 0.0 to"),
        (LocoSafeDaggerConfig, {"T_end": -0.1}, "method.T_end is -0.1; use 0.0 to"),
        (LocoSafeDaggerConfig, {"tightest": 1.1}, "method.tightest is 1.1; use 0.0 to 1.0"),
        (LocoSafeDaggerConfig, {"alarm": 30.0}, "method.alarm is 30.0; use 0.0 to 1.0"),
        (LocoSafeDaggerConfig, {"hand_back": "never"}, "there is no method.hand_back 'never'"),
        (
            LocoSafeDaggerConfig,
            {"gates": ("bound",)},
            "there is no method.gates[0] 'bound'; did you mean 'bounds'",
        ),
    ],
)
def test_a_parameter_out_of_range_is_refused_with_its_name_and_its_range(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**cast(Any, change))
    assert str(error.value).startswith(text)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"velocities": 0}, "expert_data.velocities is 0; use 1 to"),
        ({"perturbations": -1}, "expert_data.perturbations is -1; use 0 to"),
        ({"perturbations": 0, "nominal": False}, "expert data of 0 perturbations without nominal"),
        ({"duration": 0.0}, "expert_data.duration is 0.0; use 0.001 to"),
    ],
)
def test_expert_rollouts_that_cannot_be_are_refused(change, text):
    with pytest.raises(ValueError) as error:
        replace(ExpertData(10, 1, True, 1.5), **change)
    assert str(error.value).startswith(text)


@pytest.mark.parametrize(
    ("T", "refused"), [(0.2, True), (0.3, True), (0.3004, True), (0.301, False)]
)
def test_a_history_network_needs_rollouts_longer_than_its_horizon(T, refused):
    bounded = LocoSafeDaggerConfig(T=T)
    if refused:
        with pytest.raises(ValueError, match=rf"method.T is {T} s; a history network predicts 0.3"):
            replace(bounded, gates=("bounds", "history"))
    else:
        assert replace(bounded, gates=("bounds", "history")).T == T


def test_at_least_one_gate_is_needed():
    with pytest.raises(ValueError, match=r"method\.gates is empty"):
        LocoSafeDaggerConfig(gates=())


def test_a_series_of_dataset_sizes_may_be_empty():
    assert BehaviorCloningConfig(frames=()).frames == ()
    with pytest.raises(ValueError, match=r"method\.frames\[1\] is 0; use 1 to"):
        BehaviorCloningConfig(frames=(5, 0))


@pytest.mark.parametrize(
    ("frames", "text"),
    [
        ((), "method.frames is empty, and without method.all_frames there is nothing"),
        ((5, 9, 7), r"method.frames is \(5, 9, 7\); without method.all_frames the last size"),
    ],
)
def test_a_series_without_all_frames_ends_with_its_largest_size(frames, text):
    assert BehaviorCloningConfig(frames=frames).sizes == len(frames) + 1
    with pytest.raises(ValueError, match=text):
        BehaviorCloningConfig(frames=frames, all_frames=False)
    assert BehaviorCloningConfig(frames=(5, 7), all_frames=False).sizes == 2


def test_steps_take_the_place_of_epochs():
    dagger = DaggerConfig(epochs=3, pretraining_epochs=4)
    assert (dagger.first_training, dagger.training) == (4, 3)
    stepped = replace(dagger, pretraining_steps=70, steps=50)
    assert (stepped.first_training, stepped.training) == (Steps(70), Steps(50))
    assert BehaviorCloningConfig(epochs=5).training == 5
    assert BehaviorCloningConfig(epochs=5, steps=9).training == Steps(9)


def test_iterations_before_the_last_may_train_for_fewer_steps():
    dagger = DaggerConfig(epochs=3, pretraining_epochs=4, iterations=3)
    assert [dagger.training_in(i) for i in range(4)] == [4, 3, 3, 3]
    growing = replace(dagger, steps_before_last=50)
    assert [growing.training_in(i) for i in range(4)] == [4, Steps(50), Steps(50), 3]
    assert replace(growing, steps=90).training_in(3) == Steps(90)
