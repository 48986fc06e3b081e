"""The policy: a network that turns observation and goal into joint targets for a low-impedance PD.

Observation and goal (``observation.py``) are normalised inside the network; 3 x 512 units with
BatchNorm and ReLU give twelve joint targets a, and the joints get tau = kp (a - q) - kd qdot at
1 kHz. Training inverts that law to turn an expert's torque into a label. A policy file holds all
that running it needs: weights, normalisers, layouts, gains, rate, gait period and where it is from.
"""

from __future__ import annotations

import copy
import hashlib
import json
import warnings
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as to_bytes
from torch import Tensor

from surefoot.config import PolicyConfig
from surefoot.files import write_atomic
from surefoot.learning.network import MINIMUM_ROWS, PolicyNetwork
from surefoot.learning.observation import GOAL_SIZES, INPUT_SIZE, OBSERVATION_SIZES, network_input
from surefoot.learning.onnx_graph import onnx_graph, runner
from surefoot.types import JOINTS, TICKS_PER_SECOND, Array, BoolArray, IntArray, State

FORMAT = 2
"""Version of the policy file."""


def pd(target: Array | NDArray[np.float32], q: Array, v: Array, config: PolicyConfig) -> Array:
    """Joint torques ``(..., 12)`` [Nm] that draw the joints to their targets, damped to rest.

    Args:
        target: ``(..., 12)`` joint targets a [rad].
        q: ``(..., 19)`` configuration.
        v: ``(..., 18)`` velocity.
        config: kp and kd.
    """
    return config.kp * (target - q[..., 7:]) - config.kd * v[..., 6:]


def label(torque: Array, q: Array, v: Array, config: PolicyConfig) -> Array:
    """The joint targets ``(..., 12)`` [rad] with which ``pd`` gives this torque [Nm]."""
    return (torque + config.kd * v[..., 6:]) / config.kp + q[..., 7:]


class Policy:
    """A trained network as a ``Controller`` of B robots at 1 kHz. It has no memory.

    A robot's torque does not depend on the other robots in the batch, nor on their number.

    Args:
        network: is copied: training it further does not change the policy.
        config: kp and kd, and how the phase is given.
        period_ticks: gait period [ms].
        command_range: ``(2, 3)`` smallest and largest vx, vy [m/s], yaw rate [rad/s] trained on.
        robot: name of the robot.
        provenance: anything that JSON can hold on where the policy comes from.
    """

    def __init__(
        self,
        network: PolicyNetwork,
        config: PolicyConfig,
        period_ticks: int,
        command_range: ArrayLike,
        robot: str = "solo12",
        provenance: dict[str, Any] | None = None,
    ) -> None:
        self.network = copy.deepcopy(network).eval()
        self.config = config
        self.period_ticks = period_ticks
        self.command_range = np.array(command_range, float).reshape(2, 3)
        self.robot = robot
        self.provenance = provenance or {}
        self._batch = 0

    def __getstate__(self) -> dict[str, Any]:
        """For other processes, which make their own session."""
        return {name: value for name, value in vars(self).items() if name != "forward"}

    @cached_property
    def forward(self) -> Callable[[NDArray[np.float32]], NDArray[np.float32]]:
        """The network alone, ``(n, 47)`` inputs to ``(n, 12)`` joint targets [rad]."""
        layers = [(weight.numpy(), bias.numpy()) for weight, bias in self.network.folded()]
        return runner(onnx_graph(layers))

    def reset(self, batch: int) -> None:
        """``batch`` robots follow."""
        self._batch = batch

    def target(self, state: State, tick: IntArray, command: Array) -> NDArray[np.float32]:
        """Joint targets ``(B, 12)`` [rad]; the arguments are those of ``torque``."""
        batch = len(state.q)
        inputs = np.zeros((max(batch, MINIMUM_ROWS), INPUT_SIZE), np.float32)
        with np.errstate(over="ignore", invalid="ignore"):  # of a robot that has blown up
            rows = inputs[:batch]
            network_input(state, tick, command, self.period_ticks, self.config.phase, rows)
        return self.forward(inputs)[:batch]

    def torque(self, state: State, tick: IntArray, command: Array, mask: BoolArray) -> Array:
        """Torques ``(B, 12)`` [Nm], before any clipping; rows outside the mask are arbitrary."""
        if not mask.any():
            return np.zeros((len(mask), len(JOINTS)))
        return pd(self.target(state, tick, command), state.q, state.v, self.config)

    @property
    def diverged(self) -> BoolArray:
        """``(B,)`` all False: a policy always answers."""
        return np.zeros(self._batch, bool)


def check_command(policy: Policy, command: ArrayLike) -> bool:
    """Whether commands ``(..., 3)`` lie in the range the policy was trained on; warns if not."""
    low, high = policy.command_range
    command = np.asarray(command, float)
    inside = bool(((command >= low - 1e-9) & (command <= high + 1e-9)).all())
    if not inside:
        warnings.warn(
            f"command {command.tolist()} lies outside what the policy was trained on: vx, vy, "
            f"yaw rate from {low.tolist()} to {high.tolist()}; expect poor tracking or a fall, "
            "or train with such commands",
            stacklevel=2,
        )
    return inside


class PolicyFileError(ValueError):
    """A policy file is damaged, or made for something else than asked for."""


def save(policy: Policy, path: Path | str) -> None:
    """Write the policy to one self-contained safetensors file, whole or not at all."""
    record = {
        **_interface(policy.robot),
        "hidden": policy.network.hidden,
        "kp": policy.config.kp,
        "kd": policy.config.kd,
        "phase": policy.config.phase,
        "period_ticks": policy.period_ticks,
        "command_range": policy.command_range.tolist(),
        "provenance": policy.provenance,
    }
    tensors = {name: t.contiguous().cpu() for name, t in policy.network.state_dict().items()}
    record["sha256"] = digest(tensors, record)
    write_atomic(path, to_bytes(tensors, {"surefoot": json.dumps(record)}))


def digest(tensors: Mapping[str, Tensor], record: Mapping[str, Any]) -> str:
    """SHA-256 of all that a file holds: safetensors notices a cut file, not a changed bit."""
    sha = hashlib.sha256(json.dumps(record, sort_keys=True).encode())
    for name in sorted(tensors):
        sha.update(name.encode())
        sha.update(tensors[name].numpy().tobytes())
    return sha.hexdigest()


def load(path: Path | str, robot: str = "solo12") -> Policy:
    """Read a policy file; nothing in it is ever run.

    Raises:
        FileNotFoundError: there is no such file.
        PolicyFileError: the file is damaged, or of another robot, layout or version.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(
            f"there is no policy file {path}; if its run has lost it, `surefoot train ... "
            "--resume` trains it again, bit for bit"
        )
    try:
        with safe_open(path, framework="pt") as file:
            record = json.loads(file.metadata()["surefoot"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, KeyError, TypeError, ValueError) as error:
        raise PolicyFileError(
            f"{path} is not a whole surefoot policy file ({error}); copy it again, or delete "
            "it in its run's folder: `surefoot train ... --resume` trains it again, bit for bit"
        ) from error
    for key, expected in _interface(robot).items():
        if record.get(key) != expected:
            raise PolicyFileError(
                f"{path} has {key} {record.get(key)!r}, expected {expected!r}; load a policy "
                "made for this, or train one"
            )
    try:
        if record.pop("sha256", None) != digest(tensors, record):
            raise ValueError("its contents do not match their hash")
        hidden, phase = tuple(record["hidden"]), record["phase"]
        if phase not in ("circle", "fraction"):
            raise ValueError(f"a phase given as {phase!r}")
        config = PolicyConfig(hidden, record["kp"], record["kd"], phase)
        network = PolicyNetwork(config)
        network.load_state_dict(tensors)
        if not all(tensor.isfinite().all() for tensor in tensors.values()):
            raise ValueError("weights that are not finite")
        return Policy(
            network,
            config,
            record["period_ticks"],
            record["command_range"],
            robot,
            record["provenance"],
        )
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise PolicyFileError(
            f"{path} is not a complete policy ({error}); copy it again, or delete it in its run's "
            "folder: `surefoot train ... --resume` trains it again, bit for bit"
        ) from error


def _interface(robot: str) -> dict[str, Any]:
    """What a file must agree on with whoever runs it, as JSON gives it back."""
    return {
        "format": FORMAT,
        "robot": robot,
        "rate": TICKS_PER_SECOND,
        "joints": list(JOINTS),
        "observation": [[name, size] for name, size in OBSERVATION_SIZES.items()],
        "goal": [[name, size] for name, size in GOAL_SIZES.items()],
    }
