"""An MPC as a process of its own: the pattern of a server in any language.

``python examples/socket_server.py 5555`` answers until it is stopped. A server in C++ reads 60
doubles and writes an integer and 36 doubles a tick: `surefoot.interop.socket_plan` says which.
"""

import sys

import numpy as np

import surefoot as sf

NOMINAL = np.array([0.0, 0.8, -1.6, 0.0, 0.8, -1.6, 0.0, -0.8, 1.6, 0.0, -0.8, 1.6])


def plan(state: sf.State, tick: int, command: sf.Command) -> sf.MotionPlan:
    """Hold the nominal pose for 100 ms; yours comes from a solver."""
    angles = np.tile(NOMINAL, (100, 1))
    return sf.MotionPlan(angles, np.zeros((100, 12)), np.zeros((100, 12)))


if __name__ == "__main__":
    server = sf.serve_plan(plan, port=int(sys.argv[1]) if len(sys.argv) > 1 else 5555)
    print(f"listening on port {server.server_address[1]}", flush=True)
    server.serve_forever()
