"""Let the expert walk in other worlds: ground, floors, loads and pushes it does not know of."""

from dataclasses import replace

import numpy as np

import surefoot as sf
from surefoot.scenarios.ground import put_under
from surefoot.sim.terrain import ground_below

worlds = {
    "as ever": (0.5, 1.0, 0.0, "flat"),
    "a slippery floor": (0.25, 1.0, 0.0, "flat"),
    "half as much weight again": (0.5, 1.5, 0.0, "flat"),
    "a push to the left": (0.5, 1.0, 1.0, "flat"),
    "bumps of 3 cm": (0.5, 1.0, 0.0, "bumps:0.03"),
}
friction, mass, impulse = np.array([world[:3] for world in worlds.values()]).T
B = len(worlds)
robot = sf.solo12()
config = sf.preset("loco_safe_dagger", "quick")
terrain = ",".join(world[3] for world in worlds.values())
config = replace(config, simulation=replace(config.simulation, terrain=terrain))

# Each robot has a floor, a base and a push of its own [N s], after 0.5 s.
push = np.zeros((B, 1, 3))
push[:, 0, 1] = impulse
disturbance = sf.Disturbance(
    pushes=sf.Pushes(push, tick=np.full((B, 1), 500), duration=10), friction=friction, mass=mass
)
nominal = sf.load_starts()["nominal"]
forward = int(np.argmax(nominal.command[:, 0] >= 0.2))  # a state of the trot at 0.2 m/s
start = nominal[np.full(B, forward)]

# The middle of each robot's terrain lies below it, as high as its feet.
places = np.zeros((B, 2))
ground = ground_below(config.simulation.terrains, places, np.zeros(B), start.q[:, :2])
ground = put_under(ground, robot, start.q)
episodes = sf.Episodes(start, duration=2.0, disturbance=disturbance, ground=ground)
simulator = sf.make_simulator(robot, B, config.simulation, ground)
rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), sf.make_expert(robot, config))

rise = np.ptp(np.asarray(rollouts.felt_ground), axis=1)  # of the ground under the feet [m]
for n, name in enumerate(worlds):
    x, y = rollouts.q[n, -1, :2]
    outcome = sf.Outcome(rollouts.outcome[n]).name
    print(
        f"{name}: {outcome}, {x:.2f} m forward, {y:.2f} m left, {1000 * rise[n]:.0f} mm up or down"
    )
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])
