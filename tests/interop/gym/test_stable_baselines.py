"""The lockstep batch as Stable-Baselines3 wants it; PPO takes a few steps on it."""

import numpy as np
from stable_baselines3 import PPO

from surefoot.interop.gym.env import WalkingEnv
from surefoot.interop.gym.stable_baselines import LockstepVecEnv


def test_ppo_trains_on_it():
    robots = LockstepVecEnv(4, duration=0.2)
    model = PPO("MlpPolicy", robots, n_steps=16, batch_size=32, n_epochs=1, seed=0, device="cpu")
    before = model.policy.state_dict()["action_net.weight"].clone()
    model.learn(64)
    assert model.num_timesteps == 64
    assert (model.policy.state_dict()["action_net.weight"] != before).any()
    assert model.ep_info_buffer is not None


def test_an_episode_that_is_over_keeps_its_last_observation():
    robots = LockstepVecEnv(2, duration=0.04)
    robots.seed(0)
    robots.reset()
    robots.step(np.zeros((2, 12), np.float32))
    seen, _, done, infos = robots.step(np.zeros((2, 12), np.float32))
    assert done.tolist() == [True, True]
    for row in range(2):
        assert infos[row]["TimeLimit.truncated"]
        assert (np.asarray(infos[row]["terminal_observation"]) != np.asarray(seen)[row]).any()


def assert_same(ours, theirs):
    assert set(ours) == set(theirs) == {"velocity", "expert_action"}
    for name, value in ours.items():
        np.testing.assert_array_equal(value, theirs[name])


def test_the_infos_of_a_robot_are_those_of_its_environment():
    options = {"duration": 0.06, "expert": True}
    robots = LockstepVecEnv(3, **options)
    alone = [WalkingEnv(**options) for _ in range(3)]
    robots.seed(5)
    robots.reset()
    for n, env in enumerate(alone):
        assert_same(robots.reset_infos[n], env.reset(seed=5 + n)[1])
    actions = np.random.default_rng(0).uniform(-0.3, 0.3, (4, 3, 12)).astype(np.float32)
    ends = 0
    for action in actions:
        _, _, done, infos = robots.step(action)
        for n, env in enumerate(alone):
            *_, info = env.step(action[n])
            mine = {name: infos[n][name] for name in info}
            assert_same(mine, info)
            if done[n]:
                ends += 1
                assert infos[n]["TimeLimit.truncated"]
                assert_same(robots.reset_infos[n], env.reset()[1])
    assert ends == 3


def test_a_seed_fixes_the_next_reset():
    robots = LockstepVecEnv(2)
    robots.seed(3)
    first = robots.reset()
    assert (robots.reset() != first).any()
    robots.seed(3)
    assert (robots.reset() == first).all()
