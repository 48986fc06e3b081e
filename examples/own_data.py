"""Train on your own data: a log of your expert, or of a robot, as plain arrays."""

import numpy as np

import surefoot as sf

config = sf.with_own_values(sf.preset("behavior_cloning", "quick"))
robot = sf.solo12()

# Your log: what was measured every millisecond, and the torque that your expert gave there. Here
# the package's expert makes one, as somebody else's would be.
episodes = sf.Episodes(sf.load_starts()["train"][:20], duration=1.0)
simulator = sf.make_simulator(robot, batch=20)
walk = sf.rollout(simulator, episodes, sf.ExpertOnly(), sf.make_expert(robot, config))
np.savez(
    "log.npz",
    q=walk.q.reshape(-1, 19),  # x y z, quaternion xyzw, 12 joint angles
    v=walk.v.reshape(-1, 18),  # base velocities in the base frame, 12 joint rates
    torque=walk.torque.reshape(-1, 12),
    command=np.repeat(walk.starts.command, 1000, axis=0),  # vx, vy, yaw rate
    tick=(walk.starts.tick[:, None] + np.arange(1000)).ravel(),  # gait clock [ms]
    episode=np.repeat(np.arange(20), 1000),
)

data = sf.Dataset("own_data")
data.append("log", sf.frames_from_arrays(sf.read_expert_log("log.npz"), robot))  # checked
spec = sf.policy_spec(config)
network = sf.PolicyNetwork(config.policy)
result = sf.fit(network, data, config.training, spec, epochs=2, seed=0)
policy = sf.Policy(result.network, spec, result.command_range, robot.name)
sf.save(policy, "policy.safetensors")  # `surefoot play policy.safetensors` films it

print(f"{result.frames} frames, L1 {result.train_loss[-1]:.3f} rad")
rollouts = sf.rollout(simulator, episodes, sf.PolicyOnly(), sf.make_expert(robot, config), policy)
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])
