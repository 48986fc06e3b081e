"""Let an MPC that runs in another process drive: in C++, behind ROS, on another machine."""

import subprocess
import sys
from pathlib import Path

import surefoot as sf

# The server; start yours instead. It says on which port it listens.
server = Path(__file__).with_name("socket_server.py")
process = subprocess.Popen([sys.executable, str(server), "0"], stdout=subprocess.PIPE, text=True)
assert process.stdout is not None
port = int(process.stdout.readline().split()[-1])

try:
    robot = sf.solo12()
    plan = sf.SocketPlan(port)  # a plan function like any other: methods train on it, too
    expert = sf.Expert(plan, kp=3.0, kd=0.05)
    simulator = sf.make_simulator(robot, batch=4)
    episodes = sf.Episodes(sf.load_starts()["nominal"][:4], duration=2.0)
    rollouts = sf.rollout(simulator, episodes, sf.ExpertOnly(), expert)
finally:
    process.terminate()
print([sf.Outcome(outcome).name for outcome in rollouts.outcome])  # STALLED: it only stands
