"""The toy itself: a linear plant, and an expert that masters it."""

import numpy as np

from surefoot.scenarios.starts import load_starts
from tests.fakes import toy
from tests.fakes.toy import plan


def test_the_toy_is_linear_and_its_expert_masters_it():
    assert np.abs(np.linalg.eigvals(toy.A - toy.B @ toy.K)).max() < 1.0
    assert np.abs(np.linalg.eigvals(toy.A)).max() > 1.0
    rng = np.random.default_rng(0)
    starts = load_starts()["train"][:5]
    world = toy.Toy(5)
    world.reset(starts.q, starts.v)
    for _ in range(20):
        before = [toy.x_of(q, v) for q, v in zip(world.q, world.v, strict=True)]
        torque = rng.normal(size=(5, 12))
        mask = np.array([True] * 4 + [False])
        world.step(torque, mask)
        for b in range(5):
            x = toy.A @ before[b] + toy.B @ torque[b] if mask[b] else before[b]
            now = toy.x_of(world.q[b], world.v[b])
            np.testing.assert_allclose(now, x, rtol=0, atol=1e-12)
    # The robot outside the mask is still where its episode began.
    np.testing.assert_array_equal(world.state.q[4], starts.q[4])
    made = plan(world.state[0], 130, starts.command[0])
    x = toy.x_of(world.q[0], world.v[0])
    np.testing.assert_allclose(made.joint_position[0], x[1:13], atol=1e-15)
    for t in range(99):
        x = toy.A @ x + toy.B @ made.torque[t]
    np.testing.assert_allclose(made.joint_position[99], x[1:13], atol=1e-9)
    np.testing.assert_allclose(made.joint_velocity[99], x[14:], atol=1e-9)
