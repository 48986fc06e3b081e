"""The mirror error of a policy: which mirror, in which states, and where there is none."""

from dataclasses import replace

import numpy as np
import pytest

from surefoot.config import Config, Gait, PolicyConfig
from surefoot.evaluation.mirror_error import mirror_error_in_starts, mirror_error_mrad
from surefoot.evaluation.mirrors import make_mirror
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.policy import Policy, load, save
from surefoot.robots.geometry import state_of
from surefoot.robots.solo12 import solo12
from surefoot.scenarios.starts import load_starts
from tests.fakes.learning import spec_of

CONFIG = replace(Config(), policy=PolicyConfig(hidden=(16, 16)))
STARTS = load_starts().first("test", 10)
UNEVEN = replace(CONFIG, gait=Gait(offsets=(0.0, 0.5, 0.5, 0.25)))


@pytest.fixture
def policy(tmp_path):
    path = tmp_path / "policy.safetensors"
    spec = spec_of(CONFIG.policy)
    save(Policy(PolicyNetwork(CONFIG.policy, 1), spec, np.zeros((2, 3)), "solo12"), path)
    return path


def test_the_error_is_that_of_left_and_right_in_the_initial_states(policy):
    error = mirror_error_in_starts(CONFIG, policy, STARTS)
    mirror = make_mirror(CONFIG, "left_right")
    state = state_of(solo12(), STARTS.q, STARTS.v)
    loaded = load(policy)
    answer = loaded.target(state, STARTS.tick, STARTS.command)
    image = loaded.target(
        mirror.state(state), mirror.tick(STARTS.tick), mirror.command(STARTS.command)
    )
    expected = 1000.0 * np.abs(mirror.joint_values(answer) - image).mean()
    assert error == pytest.approx(expected, rel=1e-5)
    assert error is not None and error > 1.0


def test_a_gait_that_is_not_its_own_mirror_image_has_no_error(policy):
    assert mirror_error_in_starts(UNEVEN, policy, STARTS) is None
    state = state_of(solo12(), STARTS.q, STARTS.v)
    arguments = (load(policy), state, STARTS.tick, STARTS.command)
    assert mirror_error_mrad(UNEVEN, *arguments) is None
    assert mirror_error_mrad(CONFIG, *arguments) is not None
    with pytest.raises(ValueError, match=r"gait\.offsets is .* mirrored .* training\.mirror none"):
        make_mirror(UNEVEN, "left_right")
