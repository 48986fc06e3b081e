"""Let the expert walk in another world: floors, loads and pushes that it does not know of."""

import numpy as np

import surefoot as sf

config = sf.preset("loco_safe_dagger", "quick")
robot = sf.solo12()
worlds = {
    "as ever": (0.5, 1.0, 0.0),
    "a slippery floor": (0.25, 1.0, 0.0),
    "half as much weight again": (0.5, 1.5, 0.0),
    "a push to the left": (0.5, 1.0, 1.0),
}
friction, mass, impulse = np.array(list(worlds.values())).T
B = len(worlds)

# Each robot has a floor, a base and a push of its own [N s], after 0.5 s.
push = np.zeros((B, 1, 3))
push[:, 0, 1] = impulse
disturbance = sf.Disturbance(
    pushes=sf.Pushes(push, tick=np.full((B, 1), 500), duration=10), friction=friction, mass=mass
)
nominal = sf.load_starts()["nominal"]
forward = int(np.argmax(nominal.command[:, 0] >= 0.2))  # a state of the trot at 0.2 m/s
start = nominal[np.full(B, forward)]
episodes = sf.Episodes(start, duration=2.0, disturbance=disturbance)
simulator = sf.make_simulator(robot, batch=B)
rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), sf.make_expert(robot, config))

for name, outcome, q in zip(worlds, rollouts.outcome, rollouts.q, strict=True):
    print(f"{name}: {sf.Outcome(outcome).name}, {q[-1, 0]:.2f} m forward, {q[-1, 1]:.2f} m left")
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])
