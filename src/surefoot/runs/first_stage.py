"""A run can begin with a copy of another run's first data, or also of its first policy.

Methods that pre-train on the same expert rollouts begin alike, and so do several trainings on the
same data. `first_stage` is the part of the configuration that fixes this beginning; if it is equal,
`copy_first_stage` gives a new run the files and records that it would have made itself, bit for
bit.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from surefoot.config import Config, IterativeConfig
from surefoot.config.json_io import to_json
from surefoot.files import write_atomic
from surefoot.learning.policy import Policy, save
from surefoot.robots.identity import description_hash
from surefoot.runs.budget import first_allowance
from surefoot.runs.episode_ids import iteration_of_shard
from surefoot.runs.layout import RunError
from surefoot.runs.policies import load_policy
from surefoot.runs.precision import kept_precision
from surefoot.runs.run import Run
from surefoot.scenarios.starts import PACKAGED, load_starts

Shared = Literal["data", "policy"]
"""What two runs share at the beginning: their first data, or also the policy trained on it."""
DATA_SECTIONS = (
    "seed",
    "chunk",
    "robot",
    "simulation",
    "gait",
    "other_gaits",
    "switches",
    "commands",
    "expert",
    "safety",
    "start_set",
    "starts",
)
"""Parts of a configuration that fix expert rollouts, in addition to the method's parameters."""


def first_stage(config: Config, shared: Shared) -> list[Any]:
    """Everything in a configuration that fixes its first data, or also its first policy.

    Args:
        config: Configuration of a run.
        shared: Whether only the data counts, or the policy too.

    Returns:
        JSON values, which are equal for two runs that begin with the same bits.
    """
    values = to_json(without_files(config))
    method = config.method
    fixed = [values[section] for section in DATA_SECTIONS]
    fixed.append(first_allowance(config))
    if isinstance(method, IterativeConfig):
        fixed += [to_json(method.pretraining), values["pretraining"]]
        trained: list[Any] = [to_json(method.first_training)]
    else:
        fixed += [to_json(method.data), values["collection"]]
        # A series of dataset sizes begins with its smallest.
        trained = [to_json(method.training), method.frames]
    if shared == "data":
        return fixed
    return [*fixed, *trained, values["policy"], values["training"]]


def without_files(config: Config) -> Config:
    """The configuration with hashes of its initial states and of its robot's description.

    Each run has its own copies, so comparing their paths would tell nothing.
    """
    others = tuple(
        replace(other, start_set=_start_set(other.start_set)) for other in config.other_gaits
    )
    spec = config.robot.spec
    if spec is not None:
        own = replace(spec, urdf=description_hash(spec))
        config = replace(config, robot=replace(config.robot, spec=own))
    return replace(config, start_set=_start_set(config.start_set), other_gaits=others)


def _start_set(name: str | None) -> str | None:
    """A text that identifies initial states: their hash, or the name of a packaged set."""
    if name is None or name in PACKAGED or not Path(name).exists():
        return name
    return load_starts(name).hash


def copy_first_stage(source: Run, target: Run, shared: Shared) -> None:
    """Give a new run the first data of another one, or also its first policy.

    Nothing is copied twice: after a kill in between, only the rest is copied.

    Args:
        source: The run to copy from.
        target: The run that begins with the copy.
        shared: What is copied.

    Raises:
        RunError: The two runs do not begin alike, the policy would be one of another precision, or
            the source has not made this yet.
    """
    if first_stage(source.config, shared) != first_stage(target.config, shared):
        raise RunError(
            f"{target.folder} cannot begin with the {shared} of {source.folder}: their "
            "configurations differ in what fixes it"
        )
    if shared == "policy" and target.trained(0) is None:
        _check_precision(source, target)
    collected = source.collected(0)
    trained = source.trained(0)
    if collected is None or (shared == "policy" and trained is None):
        raise RunError(f"{source.folder} has not made its first {shared} yet; train it first")
    if target.collected(0) is None:
        _copy_data(source, target)
        target.append_metrics(collected)
    if shared == "policy" and trained is not None and target.trained(0) is None:
        _copy_policy(source, target)
        target.append_metrics(trained)


def _check_precision(source: Run, target: Run) -> None:
    """Check that two runs train in the same precision, which `auto` chose for each of them.

    Raises:
        RunError: They do not.
    """
    theirs, own = (
        kept_precision(run.config.training, run.precision).precision for run in (source, target)
    )
    if theirs != own:
        raise RunError(
            f"{target.folder} cannot begin with the policy of {source.folder}, which trains in "
            f"{theirs}, and {target.folder.name} in {own}: begin it with training.precision "
            f"{theirs}, or copy the data alone"
        )


def _copy_data(source: Run, target: Run) -> None:
    """Copy the shards of iteration 0, with their summaries and traces."""
    for name in source.dataset.shards:
        if iteration_of_shard(name) != 0:
            continue
        if source.trace_path(name).exists():
            write_atomic(target.trace_path(name), source.trace_path(name).read_bytes())
        write_atomic(target.summary_path(name), source.summary_path(name).read_bytes())
        target.dataset.append(name, source.dataset.load([name], all_ticks=True))


def _copy_policy(source: Run, target: Run) -> None:
    """Copy the policy of iteration 0, with the target in its provenance."""
    policy = load_policy(source, 0)
    provenance = policy.provenance | {"run": target.name, "method": target.method}
    copied = Policy(
        policy.network,
        policy.spec,
        policy.command_range,
        policy.robot,
        provenance,
        policy.limits,
        policy.bounds,
    )
    save(copied, target.policy_path(0))
