"""The header of a policy file: everything except the weights, and what a program must agree with.

Format 3 has everything that is needed to run a policy, and records what it was trained for: robot,
joint order and limits, gaits, commands, safety bounds, layout, gains and rate. `read_header` also
reads format 2, whose policies had the layout `full` and one gait. Read ``policy.py`` next, which
saves and loads policies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from surefoot.config import Gait, HeightRule, Phase
from surefoot.config.json_io import from_json, to_json
from surefoot.errors import shown
from surefoot.learning.joint_limits import JointLimits, SafetyBounds
from surefoot.learning.layouts import PARTS, STORED_FORMER, History, Layout
from surefoot.learning.observation import GaitTiming, ObservationSpec
from surefoot.learning.tensor_file import Header
from surefoot.types import JOINTS, TICKS_PER_SECOND, to_ticks

FORMAT = 3
"""Version of the policy file."""
OLDEST_FORMAT = 2
"""The oldest version that is read."""

CommandTriple = tuple[float, float, float]
"""vx, vy [m/s], yaw rate [rad/s], as in JSON."""


class PolicyFileError(ValueError):
    """A policy file is damaged, or made for another robot, layout or version."""


@dataclass(frozen=True)
class PolicyHeader:
    """The header of a policy file of format 3, with its keys.

    Attributes:
        format: Version of the file.
        robot: Name of the robot.
        rate: Ticks of the policy in a second [Hz].
        joints: Names of the joints, in the order of inputs and outputs.
        limits: Limits of these joints; None if unknown.
        gaits: The gaits, each with its period.
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        bounds: The safety bounds trained with; None if unknown.
        layout: Name of the layout.
        observation: Names and sizes of the parts of the present observation.
        history: What is remembered; None for nothing.
        height: How the height of the base is measured.
        foot_radius: Radius of the foot spheres [m], for a height above the feet.
        goal: Names and sizes of the parts of the goal.
        phase: How the network sees the gait clock.
        hidden: Units of the hidden layers.
        kp: Proportional gain of the PD [N m/rad].
        kd: Derivative gain of the PD [N m s/rad].
        provenance: Anything about the origin of the policy.
        sha256: Hash of the file's contents.
    """

    format: int
    robot: str
    rate: int
    joints: tuple[str, ...]
    limits: JointLimits | None
    gaits: tuple[GaitTiming, ...]
    command_range: tuple[CommandTriple, CommandTriple]
    bounds: SafetyBounds | None
    layout: str
    observation: tuple[tuple[str, int], ...]
    history: History | None
    height: HeightRule
    foot_radius: float
    goal: tuple[tuple[str, int], ...]
    phase: Phase
    hidden: tuple[int, ...]
    kp: float
    kd: float
    provenance: Header
    sha256: str

    @property
    def spec(self) -> ObservationSpec:
        """How states, ticks and commands become the network's input.

        Raises:
            ValueError: A value is out of range, or the sizes do not fit the layout.
        """
        layout = Layout(self.layout, tuple(name for name, _ in self.observation), self.history)
        spec = ObservationSpec(self.phase, self.gaits, layout, self.height, self.foot_radius)
        present = [(name, PARTS[name].size) for name in layout.parts]
        for key, stored, expected in (
            ("observation", self.observation, present),
            ("goal", self.goal, list(spec.goal_sizes.items())),
        ):
            if list(stored) != expected:
                raise ValueError(f"{key} is {shown(stored)}, expected {expected}")
        return spec


def layout_keys(spec: ObservationSpec) -> Header:
    """The keys of a header that describe its layout."""
    layout = spec.layout
    history = layout.history
    return {
        "layout": layout.name,
        "observation": [[name, PARTS[name].size] for name in layout.parts],
        "history": None if history is None else to_json(history),
        "height": spec.height,
        "foot_radius": spec.foot_radius,
        "goal": [list(item) for item in spec.goal_sizes.items()],
        "phase": spec.phase,
    }


def check_interface(header: Header, robot: str | None, layout: str | None) -> None:
    """Check that a file agrees with the program that runs it.

    Args:
        header: The header, as it was read.
        robot: Name of the robot that the policy must be made for; None accepts any robot.
        layout: Name of the layout that it must have; None accepts any layout.

    Raises:
        ValueError: They do not agree; the message names the difference and what to do.
    """
    version = header.get("format")
    if isinstance(version, int) and version > FORMAT:
        raise ValueError(
            f"has format {shown(version)}, which a newer version of surefoot has written, expected "
            f"{OLDEST_FORMAT} to {FORMAT}; update surefoot, or save the policy with this version"
        )
    if type(version) is not int or version < OLDEST_FORMAT:
        raise ValueError(
            f"has format {shown(version)}, expected {OLDEST_FORMAT} to {FORMAT}; load it with the "
            "version of surefoot that wrote it, or train one"
        )
    joints = header.get("joints")
    if joints != list(JOINTS) and isinstance(joints, list) and _same_names(joints):
        raise ValueError(
            f"has joints in another order, {shown(joints)}, expected {list(JOINTS)}; its weights "
            "belong to its own order, so do not rename them: save it again with surefoot, whose "
            "policies all have the expected order"
        )
    expected: Header = {"joints": list(JOINTS), "rate": TICKS_PER_SECOND}
    if robot is not None:
        expected["robot"] = robot
    if layout is not None and version > OLDEST_FORMAT:
        expected["layout"] = layout
    elif layout not in (None, "full"):
        raise ValueError(f"has layout 'full', expected {layout!r}; {_OTHERWISE}")
    for key, value in expected.items():
        if header.get(key) != value:
            raise ValueError(
                f"has {key} {shown(header.get(key))}, expected {value!r}; {_OTHERWISE}"
            )


_OTHERWISE = "load a policy made for this, or train one"


def _same_names(joints: list[Any]) -> bool:
    """Whether these are the names of the joints, in any order."""
    return all(isinstance(name, str) for name in joints) and sorted(joints) == sorted(JOINTS)


def read_header(header: Header) -> PolicyHeader:
    """The header of a file of format 3, or of format 2 completed with what all such files share.

    Args:
        header: The header, as it was read and checked by `check_interface`.

    Raises:
        ValueError: A key is missing or unknown, or a value is of the wrong type or out of range.
    """
    if header["format"] == OLDEST_FORMAT:
        header = _from_former(header)
    return from_json(PolicyHeader, header, "header")


def _from_former(header: Header) -> Header:
    """The header of format 2 as one of format 3.

    Raises:
        ValueError: A key is missing, of the wrong type or unexpected, or the layout is not the one
            that all such files have.
    """
    former = dict(header)
    observation = [[name, PARTS[name].size] for name in PARTS if name != "angular_velocity"]
    for item in observation:
        if item[0] in STORED_FORMER:
            item[:] = [STORED_FORMER[str(item[0])], 6]
    if former.pop("observation", None) != observation:
        raise ValueError(
            f"observation is {shown(header.get('observation'))}, expected {observation}"
        )
    period = former.pop("period_ticks", None)
    if type(period) is not int:
        raise ValueError(f"header.period_ticks is {shown(period)}, expected int")
    # Format 2 only has the period; gaits with the trot's period were nearly always trots.
    gait = GaitTiming("trot" if period == to_ticks(Gait().period) else "custom", period)
    full = layout_keys(ObservationSpec("circle", (gait,)))
    if "phase" not in former:
        raise ValueError("header lacks phase")
    full["phase"] = former["phase"]
    if former.pop("goal", None) != full["goal"]:
        raise ValueError(f"goal is {shown(header.get('goal'))}, expected {full['goal']}")
    new = {**full, "gaits": to_json((gait,)), "limits": None, "bounds": None}
    del former["phase"]
    if unexpected := former.keys() & new.keys():
        raise ValueError(f"format {OLDEST_FORMAT} has no {', '.join(sorted(unexpected))}")
    return former | new
