# %% [markdown]
# # The first hour with surefoot
#
# An MPC walks, a policy learns to walk from it, and we push both. Every cell takes seconds on a
# laptop without a GPU; `surefoot train loco_safe_dagger` does all of it properly in ten minutes.

# %%
import matplotlib.pyplot as plt
import numpy as np

import surefoot as sf

robot = sf.solo12()
config = sf.with_own_values(sf.preset("behavior_cloning", "quick"))
print(f"{robot.name}: {robot.mass:.2f} kg, torque limit {robot.torque_limit[0]} N m")

# %% [markdown]
# ## The expert walks
#
# Ten robots in lockstep, each told another speed. An expert plans every 50 ms and drives at 1 kHz.

# %%
expert = sf.make_expert(robot, config)
commands = np.zeros((10, 3))
commands[:, 0] = np.linspace(0.0, 0.3, 10)  # vx [m/s]; then vy and the yaw rate
starts = sf.at_rest(sf.standing(robot), commands)
simulator = sf.make_simulator(robot, batch=10)
walk = sf.rollout(simulator, sf.Episodes(starts, duration=2.0), sf.ExpertOnly(), expert)

fig, axes = plt.subplots(1, 2, figsize=(9, 3))
axes[0].plot(walk.q[:, :, 0].T)
axes[0].set(xlabel="time [ms]", ylabel="x [m]", title="ten speeds")
axes[1].plot(walk.contacts[-1] + 1.2 * np.arange(4))
axes[1].set(xlabel="time [ms]", yticks=1.2 * np.arange(4), yticklabels=["FL", "FR", "HL", "HR"])
axes[1].set_title("feet on the ground, at 0.3 m/s")

# %% [markdown]
# ## A policy learns from it
#
# The expert recovers from perturbed states; what it does there is the data. A network learns the
# joint targets that give the expert's torques.

# %%
episodes = sf.Episodes(sf.load_starts()["train"][:40], duration=0.8)
simulator = sf.make_simulator(robot, batch=40)
taught = sf.rollout(simulator, episodes, sf.ExpertOnly(), expert)
frames = taught.frames(keep=taught.happened & ~taught.failed[:, None], episode=np.arange(40))
spec = sf.policy_spec(config)
network = sf.PolicyNetwork(config.policy, seed=0)
result = sf.fit(network, frames, config.training, spec, epochs=3, seed=0)
policy = sf.Policy(result.network, spec, result.command_range, robot.name)
sf.save(policy, "first_policy.safetensors")
print(f"{result.frames} frames, error {result.train_loss[-1]:.3f} rad")

# %% [markdown]
# ## We push both
#
# 1 N s from the left after half a second, at 0.1 m/s. So little data makes no robust policy: that
# is what DAGGER, with a safety monitor, is for.

# %%
nominal = sf.load_starts()["nominal"]
start = nominal[np.full(2, int(np.argmax(nominal.command[:, 0] >= 0.1)))]
push = sf.Pushes(np.array([[[0.0, -1.0, 0.0]]] * 2), tick=np.full((2, 1), 500), duration=10)
pushed = sf.Episodes(start, duration=2.0, disturbance=sf.Disturbance(pushes=push))
simulator = sf.make_simulator(robot, batch=2)
fig, axis = plt.subplots(figsize=(9, 3))
for name, arbiter in (("expert", sf.ExpertOnly()), ("policy", sf.PolicyOnly())):
    rollouts = sf.rollout(simulator, pushed, arbiter, expert, policy)
    print(name, sf.Outcome(rollouts.outcome[0]).name)
    axis.plot(rollouts.q[0, : rollouts.length[0], 1], label=name)
axis.set(xlabel="time [ms]", ylabel="y [m]")
axis.legend()
