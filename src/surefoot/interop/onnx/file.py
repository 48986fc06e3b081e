"""Exports a policy to one ONNX file that describes itself completely.

The graph is the network with its normalizers built in, `obs (n, inputs) -> actions (n, 12)`; the
actions are joint targets [rad]. The metadata has the keys that mjlab's exporter writes, as
comma-separated lists, and one key `surefoot` with JSON at full precision
(`deploy.description.PolicyDescription`). Read `pipeline` for a graph that begins at the sensors,
and `docs/export.md` for the keys.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from surefoot.config import Config
from surefoot.config.json_io import to_json
from surefoot.deploy.description import (
    EXPORT_FORMAT,
    KEY,
    NO_HASH,
    Kind,
    PolicyDescription,
    StartRange,
    layout_terms,
)
from surefoot.deploy.kinematics import KinematicTable
from surefoot.files import sha256_of, write_atomic
from surefoot.learning.joint_limits import finite_or_none
from surefoot.learning.onnx_graph import onnx_graph
from surefoot.learning.policy import Policy
from surefoot.mpc.gaits import gait_in_words
from surefoot.robots.model import RobotModel
from surefoot.robots.profile import position_limits, speed_limits
from surefoot.robots.rigid import legs_of, masses_of
from surefoot.rotations import roll_pitch, rotation
from surefoot.scenarios.starts import StartSet
from surefoot.types import JOINTS, TICKS_PER_SECOND, Array, to_ticks

OnnxModel = Any
"""An `onnx.ModelProto`."""
INPUT = "obs"
"""Name of the graph's input, as mjlab has it."""
OUTPUT = "actions"
"""Name of the graph's output, as mjlab has it."""
MJLAB_NAMES = {
    "gravity": "projected_gravity",
    "linear_velocity": "base_lin_vel",
    "angular_velocity": "base_ang_vel",
    "joint_position": "joint_pos",
    "joint_velocity": "joint_vel",
}
"""What mjlab calls those parts of an observation that it has too."""


def kinematic_table(robot: RobotModel) -> KinematicTable:
    """The geometry and the masses of a robot, as an exported file stores them.

    Args:
        robot: The robot.
    """
    legs = legs_of(robot)
    masses = masses_of(robot)
    return KinematicTable(
        joint_axes=_nested(legs.axis),
        joint_positions=_nested(legs.center),
        foot_positions=_nested(legs.foot),
        foot_radius=robot.foot_radius,
        base_mass=float(masses.base),
        base_com=_nested(masses.base_moment / masses.base),
        link_masses=_nested(masses.link),
        link_coms=_nested(masses.link_moment / masses.link[..., None]),
    )


def describe(
    policy: Policy,
    policy_file: Path,
    robot: RobotModel,
    config: Config,
    stored: Sequence[StartSet] = (),
    kind: Kind = "network",
) -> PolicyDescription:
    """The description of a policy in its exported file, still without the file's own hash.

    Args:
        policy: The policy.
        policy_file: Its file, for the hash.
        robot: Its robot; the limits are never wider than those of its hardware profile, if it has
            one, and those that the policy was trained within.
        config: The configuration that it was trained with, for the split in which episodes began,
            the delay, and the terrain, on which all heights are above the feet.
        stored: The sets of initial states that it was trained from, one for each of its gaits;
            empty if they are unknown.
        kind: What the graph will hold.

    Raises:
        ValueError: The policy, or a set of initial states, belongs to another robot, or the sets
            are for other gaits, or two of them for the same.
    """
    if policy.robot != robot.name:
        raise ValueError(
            f"{policy_file} is a policy of the robot {policy.robot!r}, and the configuration has "
            f"{robot.name!r}; export it in the folder of the run that trained it"
        )
    _check_starts(stored, policy)
    torque, speed, position = _limits(robot, policy)
    spec = policy.spec.observation
    if config.simulation.terrain is not None:  # a rollout on it measured all heights so
        spec = replace(spec, height="above_feet", foot_radius=robot.foot_radius)
    terms = layout_terms(spec)
    low, high = policy.command_range.tolist()
    return PolicyDescription(
        format=EXPORT_FORMAT,
        kind=kind,
        robot=robot.name,
        joints=JOINTS,
        source_joints=robot.spec.source_joints,
        rate_hz=TICKS_PER_SECOND,
        kp=(policy.spec.kp,) * len(JOINTS),
        kd=(policy.spec.kd,) * len(JOINTS),
        layout=spec.layout.name,
        observation=terms.observation,
        history=terms.history,
        goal=terms.goal,
        phase=spec.phase,
        height=spec.height,
        gaits=spec.gaits,
        command_range=(tuple(low), tuple(high)),
        torque_limit=tuple(torque.tolist()),
        speed_limit=finite_or_none(speed),
        position_limit=tuple(zip(*map(finite_or_none, position.T), strict=True)),
        profile=None if robot.profile is None else robot.profile.name,
        nominal=tuple(robot.nominal[7:].tolist()),
        start_range=start_range(stored, config.starts) if stored else None,
        delay_ms=max(config.collection.delay, config.pretraining.delay),
        kinematics=kinematic_table(robot),
        provenance=to_json(policy.provenance),
        policy_sha256=sha256_of(policy_file),
        bounds=policy.bounds,
    )


def _check_starts(stored: Sequence[StartSet], policy: Policy) -> None:
    """Check that sets of initial states are for a policy's robot, and one for each of its gaits.

    Raises:
        ValueError: They are not.
    """
    if not stored:
        return
    gaits = policy.spec.observation.gaits
    names = ", ".join(gait.name for gait in gaits)
    timings = {(gait.period_ticks, gait.duty, gait.offsets) for gait in gaits}
    missing = set(timings)
    for each in stored:
        if each.robot != policy.robot:
            raise ValueError(
                f"the initial states {each.name} are of the robot {each.robot!r}, and the policy "
                f"is one of {policy.robot!r}; name those that it was trained from"
            )
        timing = (to_ticks(each.gait.period), each.gait.duty, each.gait.offsets)
        if timing not in timings:
            raise ValueError(
                f"the initial states {each.name} are of {gait_in_words(each.gait)}, and the policy "
                f"walks in {names}; name those that it was trained from"
            )
        if timing not in missing:
            raise ValueError(
                f"there are two sets of initial states of {gait_in_words(each.gait)}, the second "
                f"one {each.name}; name one set for each gait of the policy ({names})"
            )
        missing.discard(timing)
    if missing:
        raise ValueError(
            f"the policy walks in {len(gaits)} gaits ({names}), and there are initial states of "
            f"{len(gaits) - len(missing)}; name a set of each"
        )


def _limits(robot: RobotModel, policy: Policy) -> tuple[Array, Array, Array]:
    """The limits of the joints within which a policy may drive a robot.

    Args:
        robot: The robot, possibly with a hardware profile.
        policy: The policy, whose file may hold the limits that it was trained within.

    Returns:
        Torques ``(12,)`` [N m], rates ``(12,)`` [rad/s] and angles ``(12, 2)`` [rad].
    """
    torque = robot.torque_limit
    speed = robot.speed_limit
    position = robot.position_limit
    if robot.profile is not None:
        speed = np.minimum(speed, speed_limits(robot.profile))
        position = _within(position, position_limits(robot.profile))
    own = policy.limits
    if own is not None:
        # A policy with a history has seen its targets clipped to these limits.
        torque = np.fmin(torque, np.array(own.torque, dtype=float))
        speed = np.fmin(speed, np.array(own.speed, dtype=float))
        position = _within(position, np.array(own.position, dtype=float))
    return torque, speed, position


def _within(ranges: Array, others: Array) -> Array:
    """The intersection of two ranges, ``(12, 2)``; an unknown end does not limit it."""
    return np.column_stack(
        [np.fmax(ranges[:, 0], others[:, 0]), np.fmin(ranges[:, 1], others[:, 1])]
    )


def start_range(stored: Sequence[StartSet], split: str) -> StartRange:
    """The range of postures among the initial states that a policy was trained from.

    Args:
        stored: The set of each of its gaits.
        split: The split that rollouts began in; the settled gait cycle is included too.
    """
    q = np.concatenate([part.q for each in stored for part in (each["nominal"], each[split])])
    angles = np.column_stack([roll_pitch(rotation(q[:, 3:7])), q[:, 7:]])
    pairs = np.column_stack([angles.min(axis=0), angles.max(axis=0)]).tolist()
    return StartRange(
        roll=tuple(pairs[0]),
        pitch=tuple(pairs[1]),
        joints=tuple(tuple(pair) for pair in pairs[2:]),
        starts=", ".join(each.name for each in stored),
    )


def network_model(policy: Policy) -> OnnxModel:
    """The network of a policy as an ONNX model, without metadata.

    Args:
        policy: The policy.
    """
    import onnx

    layers = [(weight.numpy(), bias.numpy()) for weight, bias in policy.network.folded()]
    model = onnx.load_from_string(onnx_graph(layers))
    names = {"input": INPUT, "target": OUTPUT}
    for tensor in (*model.graph.input, *model.graph.output):
        tensor.name = names[tensor.name]
    for node in model.graph.node:
        for tensors in (node.input, node.output):
            for place, name in enumerate(tensors):
                tensors[place] = names.get(name, name)
    return model


def write_onnx(
    model: OnnxModel,
    description: PolicyDescription,
    path: Path,
    further: Mapping[str, str] | None = None,
) -> PolicyDescription:
    """Write a model with its description to one file, whole or not at all.

    Args:
        model: The ONNX model.
        description: The description of the policy; the hash of the file is filled in.
        path: The file.
        further: Further metadata, by key.

    Returns:
        The description, with the hash of the file.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    values = to_json(description) | {"sha256": NO_HASH}
    texts = {**mjlab_keys(description), **(further or {})}
    texts[KEY] = json.dumps(values, allow_nan=False)
    del model.metadata_props[:]
    for key, text in texts.items():
        entry = model.metadata_props.add()
        entry.key = key
        entry.value = text
    content = model.SerializeToString(deterministic=True)
    digest = sha256(content).hexdigest()
    place = content.index(f'"sha256": "{NO_HASH}"'.encode()) + len('"sha256": "')
    write_atomic(path, content[:place] + digest.encode() + content[place + len(digest) :])
    return replace(description, sha256=digest)


def mjlab_keys(description: PolicyDescription) -> dict[str, str]:
    """The metadata that mjlab's exporter writes, at full precision: comma-separated lists.

    Controllers for mjlab add `default_joint_pos` to the actions and subtract it from the joint
    angles; here both are absolute, so it is zero. The standing posture is `nominal` in `surefoot`.

    Args:
        description: The description of the policy.
    """
    history = () if description.history is None else ("history",)
    terms = [MJLAB_NAMES.get(term.name, term.name) for term in description.observation]
    terms += [*history, *(term.name for term in description.goal)]
    run = description.provenance.get("run", "")
    return {
        "run_path": str(run),
        "joint_names": _csv(description.joints),
        "joint_stiffness": _csv(description.kp),
        "joint_damping": _csv(description.kd),
        "default_joint_pos": _csv([0.0] * len(JOINTS)),
        "command_names": "command",
        "observation_names": _csv(terms),
        "observation_terms_scale": _csv([1.0] * len(terms)),
        "observation_terms_flatten_history_dim": _csv([1.0] * len(terms)),
        "observation_terms_history_length": _csv([0.0] * len(terms)),
        "observation_terms_clip": _csv(["-inf;inf"] * len(terms)),
        "action_scale": _csv([1.0] * len(JOINTS)),
    }


def _csv(values: Iterable[object]) -> str:
    """Values separated by commas."""
    return ",".join(str(value) for value in values)


def _nested(array: Any) -> Any:
    """An array as nested tuples."""
    if np.ndim(array) == 0:
        return float(array)
    return tuple(_nested(part) for part in array)
