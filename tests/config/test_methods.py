"""The methods' parameters: what they share, and rules that need two fields of one method."""

from dataclasses import fields, replace

import pytest

from surefoot.config import (
    METHODS,
    BehaviorCloningConfig,
    DaggerConfig,
    IterativeConfig,
    LocoSafeDaggerConfig,
    SafeDaggerConfig,
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
