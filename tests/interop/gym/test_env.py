"""The Gymnasium environments, held to Gymnasium's own checks and to each other."""

import json
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as sb3_check

from surefoot.config import Config, RobotConfig
from surefoot.config.json_io import to_json
from surefoot.config.robot_table import ROBOTS
from surefoot.interop.gym.env import WalkingEnv, WalkingVectorEnv
from surefoot.interop.gym.ids import ENVIRONMENTS, environment_of, register_environments
from surefoot.interop.gym.task import WalkingTask

register_environments()
IDS = ("surefoot/Solo12-v0", "surefoot/Go2-v0")
RNG = np.random.default_rng(0)
ACTIONS = RNG.uniform(-0.3, 0.3, (12, 3, 12)).astype(np.float32)


def walkers_of(env):
    assert isinstance(env.unwrapped, WalkingEnv)
    return env.unwrapped.walkers


@pytest.mark.parametrize("name", IDS)
def test_gymnasiums_check_finds_nothing(name):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gym.make(name, duration=0.2)
        check_env(env.unwrapped)


def test_stable_baselines3s_check_finds_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        sb3_check(WalkingEnv(duration=0.2), warn=True)


def test_registering_twice_changes_nothing():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        register_environments()
    assert all(name in gym.registry for name in ENVIRONMENTS)


def test_every_robot_has_an_environment():
    assert environment_of(ROBOTS["go2"]) == "surefoot/Go2-v0"
    assert environment_of(ROBOTS["hyq"]) == "surefoot/Quadruped-v0"
    own = replace(ROBOTS["go2"], foot_radius=0.03)  # somebody's own, with the same name
    assert environment_of(own) == "surefoot/Quadruped-v0"
    env = gym.make("surefoot/Quadruped-v0", robot="a1", duration=0.1)
    assert walkers_of(env).robot.name == "a1"


def episode(env, seed):
    """Observations, rewards and ends of an episode under fixed actions."""
    seen, _ = env.reset(seed=seed)
    record = [seen]
    for actions in ACTIONS:
        seen, reward, fell, over, _ = env.step(actions[0])
        record += [seen, [reward], [fell], [over]]
    return np.concatenate([np.ravel(each) for each in record])


def test_a_seed_fixes_everything():
    env = gym.make(IDS[0], begin="train")
    first = episode(env, 3)
    assert (episode(env, 3) == first).all()
    assert (episode(gym.make(IDS[0], begin="train"), 3) == first).all()
    assert (episode(env, 4) != first).any()


def test_robot_n_of_many_is_the_single_one_with_the_seed_n_later():
    many = gym.make_vec(IDS[0], num_envs=3, begin="train", expert=True)
    assert isinstance(many.unwrapped, WalkingVectorEnv)
    together, infos = many.reset(seed=5)
    alone = [gym.make(IDS[0], begin="train", expert=True) for _ in range(3)]
    for n, env in enumerate(alone):
        seen, info = env.reset(seed=5 + n)
        np.testing.assert_array_equal(seen, together[n])
        np.testing.assert_array_equal(info["expert_action"], infos["expert_action"][n])
    for actions in ACTIONS:
        together, rewards, fell, over, infos = many.step(actions)
        for n, env in enumerate(alone):
            seen, reward, terminated, truncated, info = env.step(actions[n])
            np.testing.assert_array_equal(seen, together[n])
            np.testing.assert_array_equal(info["expert_action"], infos["expert_action"][n])
            assert (reward, terminated, truncated) == (rewards[n], fell[n], over[n])


def ended(mode, steps=4):
    """Two robots whose episodes take two decisions, and what each step gives."""
    env = WalkingVectorEnv(2, duration=0.04, autoreset_mode=mode)
    env.reset(seed=0)
    return env, [env.step(np.zeros((2, 12), np.float32)) for _ in range(steps)]


def test_the_next_step_begins_new_episodes():
    env, steps = ended("NextStep")
    assert [step[3].tolist() for step in steps] == [
        [False] * 2,
        [True] * 2,
        [False] * 2,
        [False] * 2,
    ]
    assert (steps[2][1] == 0.0).all()  # that step only resets
    assert env.metadata["autoreset_mode"].value == "NextStep"


def test_the_same_step_begins_new_episodes_and_keeps_the_last_observation():
    _, steps = ended("SameStep")
    assert [step[3].tolist() for step in steps] == [
        [False] * 2,
        [True] * 2,
        [False] * 2,
        [True] * 2,
    ]
    seen, *_, infos = steps[1]
    assert infos["_final_obs"].tolist() == [True, True]
    for row in range(2):
        assert infos["final_obs"][row].shape == (47,)
        assert (infos["final_obs"][row] != seen[row]).any()
    assert infos["final_info"]["_velocity"].tolist() == [True, True]


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_infos_are_those_of_gymnasiums_own_vector_environment(mode):
    kwargs = {"num_envs": 3, "duration": 0.06, "expert": True}
    ours = gym.make_vec(IDS[0], autoreset_mode=mode, **kwargs)
    theirs = gym.make_vec(
        IDS[0], vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, **kwargs
    )
    _assert_same_infos(ours.reset(seed=5)[1], theirs.reset(seed=5)[1])
    ends = 0
    for actions in ACTIONS[:8]:
        *_, truncated, infos = ours.step(actions)
        _assert_same_infos(infos, theirs.step(actions)[-1])
        ends += int(truncated.sum())
    assert ends == 6


def _assert_same_infos(ours, theirs):
    assert set(ours) == set(theirs)
    for name, value in ours.items():
        if name == "final_info":
            _assert_same_infos(value, theirs[name])
        elif name == "final_obs":
            for one, other in zip(value, theirs[name], strict=True):
                np.testing.assert_array_equal(one, other)
        else:
            np.testing.assert_array_equal(value, theirs[name], name)


def test_without_autoreset_robots_wait_for_their_reset():
    env, steps = ended("Disabled")
    assert (steps[2][0] == steps[1][0]).all()
    seen, _ = env.reset(options={"reset_mask": np.array([True, False])})
    assert (seen[0] != steps[1][0][0]).any()
    assert (seen[1] == steps[1][0][1]).all()


def test_a_seed_is_for_the_robots_that_begin():
    def commands(*resets):
        env = WalkingVectorEnv(2)
        env.reset(seed=5)
        for options in resets:
            env.reset(**options)
        env.reset()
        return env.walkers.command.copy()

    first = {"seed": 77, "options": {"reset_mask": [True, False]}}
    np.testing.assert_array_equal(commands(first)[1], commands()[1])
    assert (commands(first)[0] != commands()[0]).any()


def test_an_action_that_is_not_finite_is_refused():
    env = WalkingVectorEnv(2)
    env.reset(seed=5)
    actions = np.zeros((2, 12), np.float32)
    actions[1, 3] = np.nan
    with pytest.raises(ValueError, match="the action of robot 1 is not finite"):
        env.step(actions)


def test_a_list_of_seeds_has_one_for_each_robot():
    env = WalkingVectorEnv(2)
    seen, _ = env.reset(seed=[7, 7])
    assert (seen[0] == seen[1]).all()
    with pytest.raises(ValueError, match="1 seeds for 2 robots"):
        env.reset(seed=[7])


def test_a_configuration_may_come_as_json():
    config = json.loads(json.dumps(to_json(Config())))
    env = gym.make(IDS[0], config=config, rate=1000)
    assert walkers_of(env).robot.name == "solo12"
    assert env.spec is not None
    assert "rate" in env.spec.to_json()


def test_a_configuration_of_another_robot_than_the_one_named_is_refused():
    with pytest.raises(ValueError, match=r"the robot is 'go2', but that of the config"):
        gym.make("surefoot/Go2-v0", config=Config())
    with pytest.raises(ValueError, match="there is no robot 'nonsense'"):
        WalkingVectorEnv(2, "nonsense", config=Config())
    go2 = Config(robot=RobotConfig(model="go2"))
    for name in ("surefoot/Go2-v0", "surefoot/Quadruped-v0"):
        assert walkers_of(gym.make(name, config=go2)).robot.name == "go2"
    assert walkers_of(gym.make("surefoot/Quadruped-v0")).robot.name == "solo12"


def test_an_unknown_option_names_the_nearest():
    with pytest.raises(ValueError, match="did you mean 'rate'"):
        WalkingEnv(rates=50)
    assert WalkingEnv(rate=100).walkers.task == WalkingTask(rate=100)


def test_infos_have_the_experts_action_only_on_demand():
    assert set(WalkingEnv().reset(seed=0)[1]) == {"velocity"}
    assert set(WalkingEnv(expert=True).reset(seed=0)[1]) == {"velocity", "expert_action"}
