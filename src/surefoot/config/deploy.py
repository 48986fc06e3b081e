"""How the runtime stands a robot up, and when it gives it up."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar

from surefoot.config.checked import Angle, Checked, Duration, Seconds, Share, Within

Ticks = Annotated[int, Within(1, 1000)]
"""A number of ticks of 1 ms."""


@dataclass(frozen=True)
class RuntimeConfig(Checked):
    """How the runtime stands a robot up, and which faults let it damp the joints for good."""

    section: ClassVar[str] = "runtime"

    stand: Duration = 2.0
    """[s] from the present posture to the nominal one (unitree_rl_mjlab)."""
    stand_kp: Annotated[float, Within(0.1, 100.0)] = 4.0
    """The stiffness while it stands up, as a multiple of the policy's."""
    stand_kd: Annotated[float, Within(0.1, 100.0)] = 2.0
    """The damping while it stands up, as a multiple of the policy's."""
    posture: Annotated[float, Within(0.0, 1.0)] = 0.1
    """[rad] how far beyond the initial states trained on roll, pitch and joints may be when the
    policy takes over."""
    settle: Seconds = 3.0
    """[s] how long the standing robot may take to come to such a posture."""
    missed_deadlines: Ticks = 10
    """So many ticks in a row without a command in time are a fault of a robot that is driven, or is
    to begin."""
    slow_for: Annotated[int, Within(1, 1_000_000)] = 500
    """So many more ticks missed than commanded in time are a fault, too: a robot that is always
    slow may never miss `missed_deadlines` in a row."""
    tilt: Angle = 45.0
    """[deg] roll or pitch beyond this is a fault."""
    height: Share = 0.3
    """By what share the measured height of the base may differ from what the legs of the standing
    robot say, where policy or expert use it: a wrong unit or origin differs by far more."""
    saturation: Duration = 0.1
    """[s] a joint at its torque limit for so long without a break is a fault."""
    saturation_share: Share = 0.98
    """What counts as at the limit, as a share of it."""
    absurd_torque: Annotated[float, Within(1.0, 1e6)] = 10.0
    """A joint target that asks for so many times a joint's torque limit is a fault: trained
    policies stay far below, unless they are told nonsense."""
    block: Seconds = 2.0
    """[s] how long the expert drives at least once the gate calls a state unsafe (T_block)."""
    plan_latency: Ticks = 8
    """[ms] a plan is asked for so long before it takes effect, for the state expected then; a plan
    takes 2 to 4 ms, and the way to the planner and back."""
    plan_patience: Ticks = 60
    """[ms] the expert may be without a plan for so long."""
