"""Clone the expert into a policy, save it, and let it drive."""

import numpy as np

import surefoot as sf

config = sf.preset("behavior_cloning", "quick")
robot = sf.solo12()
simulator = sf.make_simulator(robot, batch=20)
expert = sf.make_expert(robot, config)

# The expert drives for 1 s from stored initial states.
episodes = sf.Episodes(sf.load_starts()["train"][:20], duration=1.0)
rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), expert)

data = sf.Dataset("data")
data.append("first", rollouts.frames(keep=rollouts.happened, episode=np.arange(20)))

spec = sf.policy_spec(config)  # the layout of the observation, and the gains of the PD law
network = sf.PolicyNetwork(config.policy)
result = sf.fit(network, data, config.training, spec, epochs=2, seed=0)
policy = sf.Policy(result.network, spec, result.command_range, robot.name)
sf.save(policy, "policy.safetensors")

rollouts = sf.rollout(simulator, episodes, sf.PolicyOnly(), expert, policy)
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])  # some fall: 20 s are little data
