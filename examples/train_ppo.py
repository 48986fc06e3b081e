"""Train PPO of Stable-Baselines3 on robots in lockstep (needs the extra gym, and SB3).

For real results train longer: `benchmarks/reinforcement/ppo.py`.
"""

import gymnasium as gym
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecNormalize

import surefoot as sf
from surefoot.interop.gym.stable_baselines import LockstepVecEnv

STEPS = 1_000  # some millions are needed

robots = VecNormalize(LockstepVecEnv(8, robot="solo12", begin="train", duration=5.0))
policy = {"net_arch": [128, 128], "log_std_init": -2.0}  # targets vary by 0.3 rad at first
model = PPO("MlpPolicy", robots, n_steps=64, batch_size=128, policy_kwargs=policy, device="cpu")
model.learn(STEPS)

# One robot, through Gymnasium's own interface.
sf.register_environments()
env = gym.make("surefoot/Solo12-v0", duration=1.0)
seen, info = env.reset(seed=0)
total = 0.0
over = False
while not over:
    action, _ = model.predict(robots.normalize_obs(seen), deterministic=True)
    seen, reward, terminated, truncated, info = env.step(action)
    total += float(reward)
    over = terminated or truncated
print(f"return of an episode of 1 s: {total:.2f}; at best 2")
