"""Ranges of the gait's and the expert's configurations."""

import pytest

from surefoot.config import CentroidalConfig, Config, ExpertConfig, Gait, KinematicConfig
from surefoot.robots.scaling import with_own_values


@pytest.mark.parametrize(
    ("kind", "change", "text"),
    [
        (Gait, {"duty": 1.01}, "gait.duty is 1.01; use 0.05 to 1.0"),
        (Gait, {"offsets": (0.0, 0.5, 0.5, 1.5)}, "gait.offsets[3] is 1.5; use 0.0 to 1.0"),
        (Gait, {"offsets": (0.0, 0.5)}, "gait.offsets is (0.0, 0.5), expected 4 values"),
        (ExpertConfig, {"kp": -1.0}, "expert.kp is -1.0; use 0.0 to 10000.0"),
        (ExpertConfig, {"foothold_rule": "capturing"}, "there is no expert.foothold_rule 'captu"),
        (CentroidalConfig, {"nodes": 0}, "expert.centroidal.nodes is 0; use 4 to 200"),
        (CentroidalConfig, {"nodes": 100_000}, "expert.centroidal.nodes is 100000; use 4 to 200"),
        (KinematicConfig, {"max_iterations": 10**6}, "expert.kinematic.max_iterations is 1000000"),
        (CentroidalConfig, {"force": (-1.0, 0.0, 0.0)}, "expert.centroidal.force[0] is -1.0; use"),
        (KinematicConfig, {"foot_weight": -1.0}, "expert.kinematic.foot_weight is -1.0; use 0.0"),
    ],
)
def test_values_outside_their_ranges_are_refused(kind, change, text):
    with pytest.raises(ValueError) as error:
        kind(**change)
    assert str(error.value).startswith(text)


@pytest.mark.parametrize(("kinematic", "centroidal"), [(30, 20), (10, 9)])
def test_motions_are_not_planned_further_ahead_than_forces(kinematic, centroidal):
    text = f"expert.kinematic.nodes is {kinematic}; use at most .*nodes, {centroidal}"
    with pytest.raises(ValueError, match=text):
        ExpertConfig(
            centroidal=CentroidalConfig(nodes=centroidal),
            kinematic=KinematicConfig(nodes=kinematic),
        )


def test_nodes_that_follow_the_gait_are_checked_with_no_others():
    kinematic = KinematicConfig(nodes=30)
    assert ExpertConfig(centroidal=CentroidalConfig(nodes=None), kinematic=kinematic)


def test_the_defaults_are_the_rules_of_the_first_initial_states():
    config = ExpertConfig()
    assert (config.capture_deadband, config.command_gain) == (0.1, None)
    own = with_own_values(Config()).expert
    assert (own.capture_share, own.turn_compensation) == (0.0, 0.0)
    assert own.command_gain == (1.15, 1.08, 1.28)
    assert (config.centroidal.nodes, config.kinematic.nodes) == (20, 10)
