"""Exported policies, smooth synthetic logs whose rates are exact, and walks to make logs of."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from surefoot.config import Config, LayoutName, PolicyConfig
from surefoot.deploy.description import Kind
from surefoot.interop.logs.replay import run_runtime
from surefoot.interop.logs.sensor_log import SensorLog
from surefoot.interop.onnx.file import describe, network_model, write_onnx
from surefoot.interop.onnx.pipeline import exploy_keys, pipeline_model
from surefoot.learning.layouts import LAYOUTS
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import GaitTiming, ObservationSpec
from surefoot.learning.policy import Policy, PolicySpec, load, save
from surefoot.robots.load import load_robot
from surefoot.rollouts.arbiters import PolicyOnly
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes
from surefoot.runs.policies import PACKAGED_POLICY
from surefoot.scenarios.starts import load_starts
from surefoot.sim import make_simulator
from tests.fakes.drivers import FakeController

TROT = GaitTiming("trot", 500)
GAITS = (TROT, GaitTiming("walk", 1000, 0.8, (0.5, 0.0, 0.25, 0.75)))
NOMINAL = np.array([0.0, 0.8, -1.6] * 2 + [0.0, -0.8, 1.6] * 2)


@cache
def robot_of(name="solo12"):
    """A robot of the package, loaded once."""
    return load_robot(name)


def policy_of(layout: LayoutName = "full", robot="solo12", gaits=(TROT,), hidden=(32, 32), seed=1):
    """A policy with a random network that answers like a trained one: about the nominal pose."""
    spec = ObservationSpec("circle", gaits, LAYOUTS[layout])
    network = PolicyNetwork(PolicyConfig(hidden=hidden), seed, spec.input_size)
    generator = torch.Generator().manual_seed(seed)
    size = spec.input_size
    mean = 0.1 * torch.randn(size, generator=generator).double()
    network.set_normalizers(mean, 0.5 + torch.rand(size, generator=generator).double())
    with torch.no_grad():
        last: Any = network.linear[-1]
        last.weight *= 0.2
        last.bias.copy_(torch.from_numpy(NOMINAL))
    box = [[0.0, -0.1, -0.3], [0.3, 0.1, 0.3]]
    return Policy(network.eval(), PolicySpec(spec, 2.0, 0.1), box, robot, {"run": "a-run"})


def exported(
    folder: Path, layout: LayoutName = "full", kind: Kind = "network", policy=None, **changes
):
    """The file of an exported policy in a folder, and the policy."""
    policy = policy or policy_of(layout)
    folder.mkdir(parents=True, exist_ok=True)
    file = folder / "policy.safetensors"
    save(policy, file)
    trot = policy.robot == "solo12" and policy.spec.observation.gaits == (TROT,)
    stored = (load_starts(),) if trot else ()
    description = describe(policy, file, robot_of(policy.robot), Config(), stored, kind)
    description = replace(description, **changes)
    path = folder / f"{kind}.onnx"
    if kind == "network":
        write_onnx(network_model(policy), description, path)
    else:
        model = pipeline_model(policy, description)
        write_onnx(model, description, path, exploy_keys(description))
    return path, policy


def described(layout: LayoutName):
    """The description of an exported network."""
    policy = policy_of(layout)
    with TemporaryDirectory() as folder:
        file = Path(folder) / "policy.safetensors"
        save(policy, file)
        return describe(policy, file, robot_of(), Config(), (load_starts(),), "network")


def walked(starts, seconds):
    """Episodes in which the packaged policy walks."""
    simulator = make_simulator(robot_of(), len(starts), Config().simulation)
    episodes = Episodes(starts, seconds)
    return rollout(simulator, episodes, PolicyOnly(), FakeController(), load(PACKAGED_POLICY))


def smooth_log(T=300, yaw=0.8):
    """A log of sensors alone: joints and base swing, and every rate is the derivative it is."""
    t = np.arange(T) / 1000.0
    rng = np.random.default_rng(5)
    frequency = rng.uniform(8.0, 20.0, 12)
    phase = rng.uniform(0.0, 6.0, 12)
    angle = frequency * t[:, None] + phase
    position = NOMINAL + 0.3 * np.sin(angle)
    velocity = 0.3 * frequency * np.cos(angle)
    swing = np.array([11.0, 13.0, 7.0])
    size = np.array([0.25, 0.2, 0.6])
    roll, pitch, turn = (size * np.sin(swing * t[:, None])).T
    droll, dpitch, dturn = (size * swing * np.cos(swing * t[:, None])).T
    base = Rotation.from_euler("ZYX", np.column_stack([turn + yaw, pitch, roll]))
    gyro = np.column_stack(
        [
            droll - dturn * np.sin(pitch),
            dpitch * np.cos(roll) + dturn * np.sin(roll) * np.cos(pitch),
            -dpitch * np.sin(roll) + dturn * np.cos(roll) * np.cos(pitch),
        ]
    )
    return SensorLog(
        time_ns=(10**9 + np.arange(T) * 10**6),
        tick=20 + np.arange(T),
        command=np.tile([0.2, 0.05, -0.1], (T, 1)),
        joint_position=position,
        joint_velocity=velocity,
        orientation=base.as_quat(),
        angular_velocity=gyro,
        base_height=0.25 + 0.02 * np.sin(9.0 * t),
        linear_velocity=np.column_stack([0.2 + 0.1 * np.sin(5 * t), 0.1 * np.cos(6 * t), 0.1 * t]),
    )


def answered_log(policy, T=160):
    """A smooth log with the network's input and the joint targets of an `OnnxPolicy`."""
    log = smooth_log(T)
    inputs, _, applied = run_runtime(policy, log)
    return replace(log, joint_target=applied, network_input=inputs)
