"""Damaged policy files: refused with a clear error, or policies that answer with numbers."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from surefoot.config import PolicyConfig
from surefoot.learning.joint_limits import JointLimits, SafetyBounds
from surefoot.learning.policy import Policy, PolicyFileError, load, save
from tests.fakes.learning import random_state, spec_of, trained_network
from tests.fuzz.mutations import byte_mutations, check_loader, fuzz
from tests.fuzz.tensors import contents, header_mutations, sealed, tensor_mutations

SMALL = PolicyConfig(hidden=(8, 6))
BLIND = replace(SMALL, layout="proprioceptive")
LIMITS = JointLimits((2.7,) * 12, (None,) * 12, ((-1.0, None),) * 12)
BOUNDS = SafetyBounds((0.15, 1.0), (-0.4, 0.4), (-0.4, 0.4), ((-1.0, 1.0),) * 12)
STATE = replace(random_state(3), q=np.zeros((3, 19)), v=np.zeros((3, 18)))


@pytest.fixture(params=[SMALL, BLIND], ids=["full", "proprioceptive"])
def path(request, tmp_path) -> Path:
    """A policy file that is whole, and has been read once."""
    config = request.param
    path = tmp_path / "policy.safetensors"
    commands = [[0.0, -0.1, 0.0], [0.3, 0.1, 0.0]]
    provenance = {"run": "demo", "iteration": 3, "seed": 0}
    policy = Policy(
        trained_network(config),
        spec_of(config),
        commands,
        "solo12",
        provenance=provenance,
        limits=LIMITS,
        bounds=BOUNDS,
    )
    save(policy, path)
    load_and_ask(path)
    return path


def load_and_ask(path: Path) -> None:
    """Load a policy; one that is accepted has to be of use."""
    policy = load(path)
    assert all(array.isfinite().all() for layer in policy.network.folded() for array in layer)
    spec = policy.spec
    assert 0 < spec.kp <= 10_000 and 0 <= spec.kd <= 1000 and (spec.observation.periods >= 1).all()
    assert np.isfinite(policy.command_range).all()
    policy.reset(3)
    policy.torque(STATE, np.arange(3), np.zeros((3, 3)), np.ones(3, bool))


def check(path: Path, content: bytes) -> None:
    check_loader(load_and_ask, path, content, PolicyFileError)


def test_damaged_bytes(path):
    content = path.read_bytes()
    fuzz(byte_mutations(content), lambda damaged: check(path, damaged), 40)


def test_a_damaged_header_with_a_valid_hash(path):
    tensors, header = contents(path)
    fuzz(header_mutations(header), lambda damaged: check(path, sealed(tensors, damaged)), 40)


def test_damaged_tensors_with_a_valid_hash(path):
    tensors, header = contents(path)
    fuzz(tensor_mutations(tensors), lambda damaged: check(path, sealed(damaged, header)), 40)
