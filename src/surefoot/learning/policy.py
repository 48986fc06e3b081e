"""The policy: a network that turns observation and goal into joint targets for a low-impedance PD.

Observation and goal (``observation.py``) are normalized inside the network; 3 x 512 units with
BatchNorm and ReLU give twelve joint targets a, and the joints get tau = kp (a - q) - kd qdot at
1 kHz. Training inverts that law: `target_of` turns an expert's torque into the target to learn. A
policy whose layout has a history remembers the last ticks, so `Policy.observe` has to be called in
every tick, whoever drove. A policy file has everything that is needed to run the policy, and
records what it was trained for (``policy_header.py``). Read next: ``train.py``.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike
from torch import Tensor

from surefoot.config import Config, PolicyConfig
from surefoot.config.checked import check_values, known
from surefoot.config.json_io import Plain, to_json
from surefoot.config.robot_table import tuning_of
from surefoot.learning.joint_limits import JointLimits, SafetyBounds
from surefoot.learning.memory import Memory
from surefoot.learning.network import MINIMUM_ROWS, PolicyNetwork, network_from_tensors
from surefoot.learning.observation import (
    Float32Array,
    ObservationSpec,
    network_input,
    observation_spec,
)
from surefoot.learning.onnx_graph import onnx_graph, runner
from surefoot.learning.policy_header import (
    FORMAT,
    PolicyFileError,
    PolicyHeader,
    check_interface,
    layout_keys,
    read_header,
)
from surefoot.learning.tensor_file import is_intact, read_tensor_file, write_tensor_file
from surefoot.types import JOINTS, TICKS_PER_SECOND, Array, BoolArray, IntArray, State

SUFFIX = ".safetensors"
"""How the names of policy files end."""
ROWS_AT_ONCE = 8192
"""Rows that a policy evaluates at a time: hidden layers take 4 kB a row, 4 GB for a million."""


@dataclass(frozen=True)
class PolicySpec:
    """What training, engine and policy file share in addition to the weights.

    Attributes:
        observation: How states, ticks and commands become the network's input.
        kp: Proportional gain of the PD [N m/rad].
        kd: Derivative gain of the PD [N m s/rad].

    Raises:
        ValueError: A gain is not a number, or outside the range that `PolicyConfig` allows.
    """

    observation: ObservationSpec
    kp: float
    kd: float

    @property
    def remembers(self) -> bool:
        """Whether the layout has a history, for which all ticks of an episode are needed."""
        return self.observation.layout.history is not None

    def __post_init__(self) -> None:
        """Check the gains: training divides by kp, and policy files allow only such gains."""
        gains = [
            ("kp", known(self.kp, "policy.kp")),
            ("kd", known(self.kd, "policy.kd")),
        ]
        check_values(PolicyConfig, gains, PolicyConfig.section)


def policy_spec(config: Config) -> PolicySpec:
    """The policy spec of a configuration.

    Raises:
        ValueError: A gain is None, and the robot has no tuned gain to use instead; call
            `with_own_values` first, which derives it from the robot's model.
    """
    own = tuning_of(config.robot)
    kp = own.policy_kp if config.policy.kp is None else config.policy.kp
    kd = own.policy_kd if config.policy.kd is None else config.policy.kd
    return PolicySpec(observation_spec(config), known(kp, "policy.kp"), known(kd, "policy.kd"))


def pd(target: Array | Float32Array, q: Array, v: Array, spec: PolicySpec) -> Array:
    """Joint torques ``(..., 12)`` [N m] that pull the joints to their targets, with damping.

    Args:
        target: ``(..., 12)`` joint targets a [rad].
        q: ``(..., 19)`` configuration.
        v: ``(..., 18)`` velocity.
        spec: The gains kp and kd.
    """
    return spec.kp * (target - q[..., 7:]) - spec.kd * v[..., 6:]


def target_of(torque: Array, q: Array, v: Array, spec: PolicySpec) -> Array:
    """The joint targets ``(..., 12)`` [rad] for which `pd` gives this torque [N m].

    Args:
        torque: ``(..., 12)`` joint torques [N m].
        q: ``(..., 19)`` configuration.
        v: ``(..., 18)`` velocity.
        spec: The gains kp and kd.
    """
    return (torque + spec.kd * v[..., 6:]) / spec.kp + q[..., 7:]


class Policy:
    """A trained network as a ``Controller`` of B robots at 1 kHz.

    A robot's torque does not depend on the other robots in the batch, nor on their number. The
    policy has no memory unless the layout has a history: then call `observe` after every tick.

    Args:
        network: The network; a copy is kept, so training it further does not change the policy.
        spec: The network's input, and the gains of the PD.
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        robot: Name of the robot.
        provenance: Anything that JSON can hold about the origin of the policy.
        limits: Limits of the robot's joints; None if unknown.
        bounds: The safety bounds that it was trained with; None if unknown.

    Raises:
        ValueError: The network does not have as many inputs as the layout.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        spec: PolicySpec,
        command_range: ArrayLike,
        robot: str,
        provenance: Mapping[str, Plain] | None = None,
        limits: JointLimits | None = None,
        bounds: SafetyBounds | None = None,
    ) -> None:
        inputs = spec.observation.input_size
        if len(network.mean) != inputs:
            raise ValueError(
                f"a network of {len(network.mean)} inputs for the layout "
                f"{spec.observation.layout.name!r}, which has {inputs}; make it with "
                f"PolicyNetwork(config, inputs={inputs})"
            )
        self.network = copy.deepcopy(network).eval()
        self.spec = spec
        self.command_range = np.array(command_range, float).reshape(2, 3)
        self.robot = robot
        self.provenance = dict(provenance or {})
        self.limits = limits
        self.bounds = bounds
        self._batch = 0
        self._memory: Memory | None = None
        self._gait: IntArray | int = 0

    @property
    def gait(self) -> IntArray | int:
        """``(B,)`` number of the spec's gait that each robot is to walk; 0 after a reset."""
        return self._gait

    @gait.setter
    def gait(self, gait: IntArray | int) -> None:
        """Command the gaits.

        Raises:
            ValueError: The policy has no gait of that number.
        """
        gaits = self.spec.observation.gaits
        wrong = np.extract((np.asarray(gait) < 0) | (np.asarray(gait) >= len(gaits)), gait)
        if wrong.size:
            names = ", ".join(each.name for each in gaits)
            raise ValueError(
                f"the gait number {wrong[0]} of a policy of {names}; use 0 to {len(gaits) - 1}"
            )
        self._gait = gait

    def __getstate__(self) -> dict[str, object]:
        """What is sent to other processes: all but the ONNX session, which they make themselves."""
        return {name: value for name, value in vars(self).items() if name != "forward"}

    @cached_property
    def forward(self) -> Callable[[Float32Array], Float32Array]:
        """The network alone, ``(n, inputs)`` to ``(n, 12)`` joint targets [rad]."""
        layers = [(weight.numpy(), bias.numpy()) for weight, bias in self.network.folded()]
        return runner(onnx_graph(layers))

    def answers(self, inputs: Float32Array) -> Float32Array:
        """The outputs of the network alone for any number of inputs, in bounded memory.

        Args:
            inputs: ``(n, inputs)`` observations and goals.

        Returns:
            Joint targets ``(n, 12)`` [rad].
        """
        rows = len(inputs)
        if rows < MINIMUM_ROWS:
            inputs = np.pad(inputs, ((0, MINIMUM_ROWS - rows), (0, 0)))
        parts = np.array_split(inputs, math.ceil(len(inputs) / ROWS_AT_ONCE))
        return np.concatenate([self.forward(part) for part in parts])[:rows]

    def reset(self, batch: int) -> None:
        """Forget everything, and get ready for ``batch`` robots."""
        history = self.spec.observation.layout.history
        self._batch = batch
        self._memory = None if history is None else Memory(history, batch)
        self.gait = 0

    def target(self, state: State, tick: IntArray, command: Array) -> Float32Array:
        """Joint targets ``(B, 12)`` [rad]; the arguments are those of ``torque``.

        Raises:
            ValueError: The layout has a history, and `reset` has not prepared for B robots.
        """
        batch = len(state.q)
        spec = self.spec.observation
        inputs = np.zeros((max(batch, MINIMUM_ROWS), spec.input_size), np.float32)
        with np.errstate(over="ignore", invalid="ignore"):  # the simulation may have blown up
            history = self._remembered(state)
            network_input(state, tick, command, spec, inputs[:batch], history, self.gait)
        return self.forward(inputs)[:batch]

    def _remembered(self, state: State) -> Float32Array | None:
        """The history of the robots; None if the layout has none."""
        if not self.spec.remembers:
            return None
        if self._memory is None or self._memory.batch != len(state.q):
            raise ValueError(
                f"a policy with a history is asked about {len(state.q)} robots, but was made ready "
                f"for {self._batch}: call reset({len(state.q)}) where the episode begins"
            )
        return self._memory.read(state)

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """Torques ``(B, 12)`` [N m], before any clipping; rows outside the mask are arbitrary."""
        if not mask.any():
            return np.zeros((len(mask), len(JOINTS)))
        return pd(self.target(state, tick, command), state.q, state.v, self.spec)

    def observe(self, state: State, tick: IntArray, torque: Array) -> None:
        """Remember a tick, if the layout has a history; call this once at the end of every tick.

        Args:
            state: The states of B robots, as they measured them.
            tick: ``(B,)`` gait clock [ms].
            torque: ``(B, 12)`` the torques that were commanded, by whoever drove, clipped [N m];
                where they are NaN, none yet, the joint angles replace the targets.
        """
        if self._memory is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                target = target_of(torque, state.q, state.v, self.spec)
                target = np.where(np.isnan(torque), state.q[..., 7:], target)
                self._memory.store(state, target)

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` all False: a policy always answers."""
        return np.zeros(self._batch, bool)


def save(policy: Policy, path: Path | str) -> None:
    """Write the policy to one self-contained safetensors file, whole or not at all.

    Raises:
        WriteError: The disk is full, or read-only.
    """
    header = {
        "format": FORMAT,
        "robot": policy.robot,
        "rate": TICKS_PER_SECOND,
        "joints": list(JOINTS),
        "limits": to_json(policy.limits),
        "gaits": to_json(policy.spec.observation.gaits),
        "command_range": policy.command_range.tolist(),
        "bounds": to_json(policy.bounds),
        **layout_keys(policy.spec.observation),
        "hidden": policy.network.hidden,
        "kp": policy.spec.kp,
        "kd": policy.spec.kd,
        "provenance": to_json(policy.provenance),
    }
    write_tensor_file(path, policy.network.state_dict(), header)


def load(path: Path | str, robot: str | None = None, layout: str | None = None) -> Policy:
    """Read a policy file of this format or of format 2; nothing in it is ever executed.

    Args:
        path: The file.
        robot: Name of the robot that the policy must be made for; None accepts any robot.
        layout: Name of the layout that it must have; None accepts any layout.

    Raises:
        FileNotFoundError: There is no such file.
        PolicyFileError: The file is damaged, or made for another robot, layout or version.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(
            f"there is no policy file {path}; if its run has lost it, `surefoot train ... "
            "--resume` trains it again, bit for bit (a study keeps those of some runs)"
        )
    if path.is_dir():
        raise PolicyFileError(
            f"{path} is a folder; of a run, take sf.open_run(folder).best_policy_path, or name the "
            "file in its folder policies"
        )
    try:
        tensors, header = read_tensor_file(path)
    except ValueError as error:
        if path.suffix != SUFFIX:  # a file of a run that no training makes again
            raise PolicyFileError(
                f"{path} is no policy file; name the folder of a run, or a file in its folder "
                f"policies, which end in {SUFFIX}"
            ) from error
        raise PolicyFileError(
            f"{path} is not a whole surefoot policy file ({error}); copy it again, or delete "
            "it in its run's folder: `surefoot train ... --resume` trains it again, bit for bit"
        ) from error
    try:
        check_interface(header, robot, layout)
    except ValueError as error:
        raise PolicyFileError(f"{path} {error}") from error
    try:
        if not is_intact(tensors, header):
            raise ValueError("its contents do not match their hash")
        return _policy(tensors, read_header(header))
    except ValueError as error:
        raise PolicyFileError(
            f"{path} is not a complete policy ({error}); copy it again, or delete it in its run's "
            "folder: `surefoot train ... --resume` trains it again, bit for bit"
        ) from error


def _policy(tensors: Mapping[str, Tensor], header: PolicyHeader) -> Policy:
    """The policy in a file.

    Raises:
        ValueError: The header is out of range, or does not fit the tensors.
    """
    config = PolicyConfig(header.hidden, header.kp, header.kd, header.phase)
    low, high = np.array(header.command_range)
    if not (np.isfinite(low) & np.isfinite(high) & (low <= high)).all():
        raise ValueError(f"command_range is {low.tolist()} to {high.tolist()}; use a finite range")
    spec = PolicySpec(header.spec, header.kp, header.kd)
    network = network_from_tensors(config, tensors, spec.observation.input_size)
    return Policy(
        network,
        spec,
        header.command_range,
        header.robot,
        header.provenance,
        header.limits,
        header.bounds,
    )
