"""Cards in Markdown, as the Hugging Face hub shows them: what a dataset or a policy file is.

`dataset_card` is the README of an exported dataset; `write_policy_card` writes a `policy_card` next
to a policy that is exported or fitted. Both name the gait, commands and gains of the file in the
same words.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from surefoot.config import Config
from surefoot.config.json_io import to_json
from surefoot.deploy.description import PolicyDescription
from surefoot.evaluation.robustness import Robustness
from surefoot.files import is_stream, write_atomic
from surefoot.interop.datasets.segments import SIMULATED, Exported
from surefoot.interop.joint_text import limits_in_words
from surefoot.learning.dataset import Dataset
from surefoot.learning.policy import Policy, PolicySpec, policy_spec
from surefoot.types import TICKS_PER_SECOND

TAGS = "surefoot, legged robots, imitation learning"
"""What every dataset and policy is about."""
CONVENTIONS = (
    "Joints: hip abduction, hip flexion and knee of the legs front left, front right, hind left, "
    "hind right. SI units, radians; quaternions are xyzw; base velocities are in the base frame."
)
"""How to read the numbers."""


def dataset_card(
    title: str,
    library: Literal["LeRobot", "Minari"],
    config: Config,
    dataset: Dataset,
    exported: Exported,
    columns: dict[str, str],
    recorded: str = SIMULATED,
) -> str:
    """The README of an exported dataset.

    Args:
        title: The first heading of the card.
        library: The library that reads the dataset.
        config: The configuration that the data were collected with.
        dataset: The dataset that was exported.
        exported: What was written.
        columns: What the columns hold.
        recorded: Where the frames were recorded.
    """
    seconds = exported.frames / TICKS_PER_SECOND
    box = config.commands
    lines = [
        "---",
        "task_categories: [robotics]",
        f"tags: [{library}, {TAGS}]",
        "---",
        f"# {title}",
        "",
        f"{exported.frames} frames ({seconds:.1f} s at 1 kHz) of the quadruped "
        f"{config.robot.model}, recorded {recorded} with surefoot. A model predictive "
        "controller answers every frame; `expert_drove` says whether its answer was applied.",
        "",
        f"- {exported.episodes} episodes: stretches without a gap of the collected ones, of which "
        f"{exported.left_out} frames were too short to be one.",
        *_walking(policy_spec(config), box.axes),
        f"- Simulator: {config.simulation.backend}, friction {config.simulation.friction:g}"
        f"{_uneven(config.simulation.terrain)}.",
        f"- SHA-256 of the frames before the export: `{dataset.hash}`.",
        "",
        "| column | what it holds |",
        "|---|---|",
        *(f"| `{name}` | {text} |" for name, text in columns.items()),
        "",
        CONVENTIONS,
        "",
    ]
    return "\n".join(lines)


def _uneven(terrain: str | None) -> str:
    """What a card says about a terrain."""
    if terrain is None:
        return ""
    return f", terrain {terrain}; heights are above the ground that the loaded feet felt"


@dataclass(frozen=True)
class PolicyUse:
    """What a policy's card says beyond what the policy itself contains.

    Attributes:
        summary: What the file holds, in one sentence.
        limits: What must not be expected of the policy, in sentences.
        checks: Commands that check or measure the policy.
        measured: The robustness that its run measured; None if unknown.
        holds: What the file holds besides the policy, in sentences.
    """

    summary: str
    limits: tuple[str, ...]
    checks: tuple[str, ...]
    measured: Robustness | None = None
    holds: tuple[str, ...] = ()


def write_policy_card(policy: Policy, file: Path, use: PolicyUse) -> Path | None:
    """Write the card of a policy next to its file.

    Args:
        policy: The policy.
        file: The file, a policy file or an exported one.
        use: What else is known.

    Returns:
        The card; None if the file is a stream, which has no card.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    card = card_path(file)
    if card is not None:
        write_atomic(card, policy_card(policy, file.name, use).encode())
    return card


def limits_and_starts(description: PolicyDescription) -> tuple[str, str]:
    """What an exported file holds of limits and of initial states, a sentence each.

    Args:
        description: What the file says.
    """
    profile = "no hardware profile"
    if description.profile is not None:
        profile = f"the hardware profile `{description.profile}`"
    begins = description.start_range
    starts = "unknown, so that no runtime can tell in which postures it may begin"
    if begins is not None:
        roll, pitch = (f"{low:.3g} to {high:.3g} rad" for low, high in (begins.roll, begins.pitch))
        starts = f"`{begins.starts}`, with roll {roll} and pitch {pitch}"
    return (
        f"Limits, with {profile}: {'; '.join(limits_in_words(description))}.",
        f"Initial states: {starts}.",
    )


def card_path(file: Path | None) -> Path | None:
    """The path of a file's card: trot.onnx has trot.onnx.md.

    Args:
        file: The file; None, a stream such as ``/dev/stdout`` and an empty name have no card.
    """
    if file is None or is_stream(file) or not file.name:
        return None
    return file.with_name(f"{file.name}.md")


def policy_card(policy: Policy, title: str, use: PolicyUse) -> str:
    """The card of a policy.

    Args:
        policy: The policy.
        title: The first heading of the card.
        use: What else is known.
    """
    spec = policy.spec.observation
    vx, vy, yaw_rate = policy.command_range.T.tolist()
    seen = ", ".join(spec.layout.parts)
    history = spec.layout.history
    if history is not None:
        seen += f"; of the past: {', '.join(history.parts)}"
        seen += ", applied joint targets" if history.targets else ""
        seen += f", {history.samples} samples {history.stride} ms apart"
    origin = {name: json.dumps(value) for name, value in to_json(policy.provenance).items()}
    lines = [
        "---",
        "pipeline_tag: robotics",
        f"tags: [{TAGS}]",
        "---",
        f"# {title}",
        "",
        f"{use.summary} It walks the quadruped {policy.robot}; it was trained with surefoot to "
        "imitate a model predictive controller.",
        "",
        *_walking(policy.spec, (vx, vy, yaw_rate)),
        f"- Layout `{spec.layout.name}`, {spec.input_size} numbers at 1 kHz: {seen}; then "
        f"{', '.join(spec.goal_sizes)}.",
        *(f"- {text}" for text in use.holds),
        "",
        "## Where it comes from",
        "",
        *(f"- {name}: `{value}`" for name, value in origin.items()),
        *([] if origin else ["Its file does not say."]),
        "",
        "## What was measured",
        "",
        _measured(use.measured),
        "",
        "## What not to expect",
        "",
        *(f"- {text}" for text in use.limits),
        "",
        *_checks(use.checks),
        CONVENTIONS,
        "",
    ]
    return "\n".join(lines)


def _walking(spec: PolicySpec, commands: Sequence[Sequence[float]]) -> list[str]:
    """Gaits, commands and gains, as items of a list.

    Args:
        spec: The observation and gains of the policy, or of policies trained on the data.
        commands: ``(3, 2)`` smallest and largest vx, vy [m/s] and yaw rate [rad/s].
    """
    vx, vy, yaw_rate = (f"{low:g} to {high:g}" for low, high in commands)
    gaits = [
        f"- Gait {gait.name}: period {gait.period_ticks} ms, duty factor {gait.duty:g}, phase "
        f"offsets {', '.join(f'{offset:g}' for offset in gait.offsets)} periods."
        for gait in spec.observation.gaits
    ]
    return [
        *gaits,
        f"- Commands: vx {vx} m/s, vy {vy} m/s, yaw rate {yaw_rate} rad/s.",
        f"- A joint target a acts as tau = {spec.kp:g} (a - q) - {spec.kd:g} dq/dt [N m].",
    ]


def _measured(result: Robustness | None) -> str:
    """A measurement in a sentence."""
    if result is None:
        return "Nothing of it is known here."
    low, high = result.success_interval
    return (
        f"From {result.episodes} initial states of the split `{result.split}` of {result.starts}, "
        f"{100 * result.success_rate:.1f} % of the robots succeeded (95 % interval "
        f"{100 * low:.1f} to {100 * high:.1f} %); {result.falls} fell, {result.stalls} stalled."
    )


def _checks(commands: Sequence[str]) -> list[str]:
    """The section with the commands that check a policy; empty without any commands."""
    if not commands:
        return []
    return ["## How to check it", "", "```bash", *commands, "```", ""]
