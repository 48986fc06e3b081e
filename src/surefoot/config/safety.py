"""When the expert takes over, and what counts as a fall."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal

from surefoot.config.checked import Checked, Rising, Seconds, Within

GateName = Literal["bounds", "relaxing", "classifier", "history"]
"""Names of the gates.

- `bounds`: the paper's table.
- `relaxing`: the same table, tight in the first iteration and as in the paper in the last one;
  never tighter than the settled gait needs.
- `classifier`: SafeDAGGER's network, which predicts where the policy deviates from the expert.
- `history`: a network that predicts from the last 100 ms that the bounds will be left within the
  next 0.3 s.

The paper names `relaxing` and `history` as future work. A network serves as a gate from the
iteration after the first one whose data it can learn from.
"""

HandBack = Literal["safe_and_blocked", "every_violation_restarts", "safe_or_blocked"]
"""Rules that say when the policy drives again after a takeover; the paper's text and code disagree.

- `every_violation_restarts`: T_block without a violation has passed (Algorithm 4).
- `safe_or_blocked`: the state is safe again, or T_block is over (the paper's prose).
- `safe_and_blocked`: the state is safe again, and at least T_block has passed since the takeover
  (the paper's research code; "at least 2 s" in the text).
"""

HISTORY_HORIZON = 0.3
"""How far ahead a history network predicts that the bounds will be left [s]."""

Range = Annotated[tuple[float, float], Within(-10_000.0, 10_000.0), Rising()]
"""The smallest and the largest value that is safe; a wide one switches its test off."""
Tilt = Annotated[float, Within(0.0, 10_000.0)]
"""Roll or pitch either way [deg]; a wide one switches its test off."""
Needed = Annotated[tuple[float, float], Within(-10_000.0, 10_000.0)]
"""The height [m] and the tilt [deg] that a settled gait needs."""


@dataclass(frozen=True)
class SafetyConfig(Checked):
    """When the expert takes over (paper, Table I), and what counts as a fall.

    None stands for the own bound of the robot, and of its settled gait where that was prepared
    (`surefoot prepare`); see `robots.scaling.own_safety`. Solo12's are the paper's, `TABLE_I`.
    """

    section: ClassVar[str] = "safety"

    com_height: Range | None = None
    """[m] height of the center of mass; None is the robot's own (Solo12: 0.15 to 1)."""
    roll_pitch: Tilt | None = None
    """[deg] either way; None is 25, or more where the settled gait needs it."""
    hip_abduction: Range | None = None
    """[deg] for the left front leg; mirrored for the others; None is the robot's own (Solo12: -30
    to 60)."""
    hip_flexion: Range | None = None
    """[deg] likewise; None is the robot's own (Solo12: 0 to 90)."""
    knee: Range | None = None
    """[deg] likewise; None is the robot's own (Solo12: -160 to 0)."""
    settled: Needed | None = None
    """[m], [deg] how low the center of mass, and how far roll and pitch, are in the settled gait,
    with a margin: the gate `relaxing` is never tighter. None is what was prepared; where nothing
    was, it is not known, and limits nothing."""
    joints: tuple[Range, ...] = ()
    """[deg] of all twelve joints, leg by leg, in place of the three ranges above; none uses
    those."""
    fall_height: Range | None = None
    """[m] a base height outside this range is a fall; None is the robot's own (Solo12: 0.1 to 2,
    the paper's research code)."""
    fall_angle: Tilt = 30.0
    """[deg] roll or pitch beyond this is a fall (the paper's research code)."""
    body_contact: Seconds = 0.0
    """[s] a base or a leg, not a foot, on the ground for so long without a break is a fall; 0 only
    counts it (the paper). 0.1 is a fall that no robot gets up from."""
    grace: Seconds = 0.5
    """[s] falls are tested from this time on (the paper's research code)."""
    stepping_from: Seconds | None = 1.56
    """[s] shorter episodes are not judged for stepping: in their last third, even in a perfect trot
    (period 0.5 s, touchdown 20 ms), not every foot has touched down. Slower gaits are judged from
    three periods and touchdowns on, whatever this is, and robots that are to stand at any time
    never are; None turns this test off."""

    def __post_init__(self) -> None:
        """Check the fields, and that every joint has a range or none has."""
        super().__post_init__()
        if len(self.joints) not in (0, 12):
            raise ValueError(
                f"{self.section}.joints has {len(self.joints)} ranges; give one for each of the "
                "twelve joints, or none"
            )


TABLE_I = SafetyConfig(
    com_height=(0.15, 1.0),
    roll_pitch=25.0,
    hip_abduction=(-30.0, 60.0),
    hip_flexion=(0.0, 90.0),
    knee=(-160.0, 0.0),
    fall_height=(0.10, 2.0),
)
"""The bounds of Solo12: the paper's Table I, and the falls of its research code."""
