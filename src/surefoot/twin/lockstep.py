"""A bridge in lockstep: a simulated robot whose time stands still until a command arrives.

Read `serve` next, which uses it.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from surefoot.deploy import protocol
from surefoot.deploy.bridge import RELEASE, Bridge, Channel

RESTING = 3000  # [ticks] for a latched robot to fall, before its time stands still again


def serve_lockstep(
    bridge: Bridge,
    channel: Channel,
    running: Callable[[], bool],
    wall: Callable[[], float] = time.monotonic,
) -> None:
    """Tick once for each command, so that a simulated robot waits for the runtime.

    Once the bridge is latched, time passes until the robot has fallen. A runtime may take its
    time, unless another one asks for the robot: then the first one is dropped if it has been silent
    for `RELEASE` by the wall clock.

    Args:
        bridge: The bridge; its clock must be the simulated one.
        channel: The channel of the bridge.
        running: Asked before every tick, and ten times a second while waiting; False ends the loop.
        wall: Gives the time by the wall clock [s].
    """
    heard_at = wall()
    rested = 0
    try:
        while running():
            is_latched = bridge.status == protocol.LATCHED and rested < RESTING
            channel.wait(0.001 if is_latched else 0.1)
            accepted = bridge.accepted
            heard = bridge.heard
            turned_away = bridge.turned_away
            bridge.receive()
            if bridge.heard != heard:
                heard_at = wall()
            elif bridge.turned_away != turned_away and wall() - heard_at >= RELEASE:
                bridge.release()
            stays_latched = is_latched and bridge.status == protocol.LATCHED
            if stays_latched or bridge.accepted != accepted:
                bridge.advance()
            else:
                bridge.report()
            rested = rested + 1 if bridge.status == protocol.LATCHED else 0
    finally:
        bridge.close()
