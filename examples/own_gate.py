"""Let your own gate decide when the expert has to rescue the policy."""

import numpy as np

import surefoot as sf


class FastJoints:
    """Calls a state unsafe where a joint is fast: a gate has these two methods."""

    def __init__(self, limit: float) -> None:
        self.limit = limit  # [rad/s]

    def reset(self, batch: int) -> None:
        """Forget everything; this gate has no memory."""

    def unsafe(self, state: sf.State, tick: np.ndarray, command: np.ndarray) -> np.ndarray:
        """(B,) True where a state is unsafe; state.v is (B, 18)."""
        return np.abs(state.v[:, 6:]).max(axis=1) > self.limit


robot = sf.solo12()
config = sf.with_own_values(sf.preset("loco_safe_dagger", "quick"), robot)
network = sf.PolicyNetwork(config.policy)
policy = sf.Policy(network, sf.policy_spec(config), np.zeros((2, 3)), robot.name)
gate = sf.AnyOf([FastJoints(12.0), sf.Bounds(config.safety)])
arbiter = sf.SafetySwitch(sf.SafetyMonitor(gate, block=0.5))

# This policy has learned nothing; the gate sees to it that the expert catches the robots.
episodes = sf.Episodes(sf.load_starts()["nominal"][:10], duration=2.0)
simulator = sf.make_simulator(robot, batch=10)
rollouts = sf.rollout(simulator, episodes, arbiter, sf.make_expert(robot, config), policy)
share = rollouts.expert_drove[rollouts.happened].mean()
print(f"the expert drove {100 * share:.0f} % of the time")
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])
