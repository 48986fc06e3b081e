"""surefoot's collection beside imitation's and Stable-Baselines3's: one robot, network and run.

Everybody advances the same MuJoCo model of a standing Solo12 at 1 kHz with a 3 x 512 network in the
loop. Counted are robot-milliseconds per second of CPU time, over all processes of the contender:
that is speed per core, of one process or of many, and waiting for a busy core is not counted. The
contenders take turns, each soon after surefoot; medians over the rounds. The README beside this
file says what is fair.
"""

from __future__ import annotations

import gc
import json
import os
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from imitation.data import rollout as imitation
from imitation.data.wrappers import RolloutInfoWrapper
from solo12_env import Solo12Env, UsualSolo12Env
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from surefoot.config import Config
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE, network_input
from surefoot.learning.policy import Policy
from surefoot.robots.model import RobotModel, clip_torque, standing
from surefoot.robots.solo12 import solo12
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.engine import Episodes, Rollout, rollout
from surefoot.rollouts.outcome import Outcome
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import at_rest
from surefoot.sim import make_simulator
from surefoot.sim.mujoco import build_model, to_mujoco
from surefoot.types import JOINTS, to_ticks

VERSIONS = ("imitation", "stable-baselines3", "gymnasium", "mujoco", "torch", "numpy")


@dataclass(frozen=True)
class Contender:
    """One way to collect.

    Attributes:
        library: whose.
        what: the call, as the table says it.
        robots: advanced together.
        collect: runs one episode of every robot and returns what it kept.
        cpu: [s] of CPU time used so far, by all processes that take part.
        keeps: the frames are there afterwards.
        usual: set up as the libraries' tutorials do, not as fast as can be.
    """

    library: str
    what: str
    robots: int
    collect: Callable[[], Any]
    cpu: Callable[[], float]
    keeps: bool = True
    usual: bool = False


def surefoot_contender(config: Config, robot: RobotModel, robots: int, seconds: float) -> Contender:
    """Algorithm 4's collection: the policy drives, the monitor watches, everything is recorded."""
    network = PolicyNetwork(config.policy)
    hold_nominal(network.linear[-1], robot)
    policy = Policy(network, config.policy, to_ticks(config.gait.period), np.zeros((2, 3)))
    simulator = make_simulator(robot, robots, config.simulation)
    starts = at_rest(standing(robot), np.zeros((robots, 3)))
    arbiter = SafetySwitch(SafetyMonitor(Bounds(config.safety), 2.0))

    def collect() -> Rollout:
        # A standing robot violates no bound, so that the expert, here the policy, is never asked.
        episodes = Episodes(starts, seconds)
        record = rollout(simulator, episodes, arbiter, policy, policy, config.safety)
        if record.expert_drove.any() or (record.outcome == Outcome.FELL).any():
            raise RuntimeError("surefoot: a robot fell or was taken over; figures would mislead")
        return record

    return Contender("surefoot", "rollout, monitor on", robots, collect, time.process_time)


@dataclass(frozen=True)
class Venue:
    """A vector environment, what to call it, and which libraries collect in it.

    Attributes:
        name: as the table says it.
        venv: the environments.
        libraries: who collects here.
        usual: see `Contender`.
    """

    name: str
    venv: VecEnv
    libraries: tuple[str, ...] = ("imitation", "stable-baselines3")
    usual: bool = False


def peers(config: Config, robot: RobotModel, venue: Venue, seconds: float) -> list[Contender]:
    """What imitation and Stable-Baselines3 can do in a vector environment."""
    venv = venue.venv
    ticks, n = to_ticks(seconds), venv.num_envs
    model = ppo(config, robot, venv, ticks)
    module = ReluNetwork(config, robot)
    _, callback = model._setup_learn(n * ticks)

    def trajectories(policy: Any, deterministic: bool) -> Any:
        kept = imitation.generate_trajectories(
            policy,
            venv,
            imitation.make_sample_until(min_episodes=n),
            np.random.default_rng(0),
            deterministic_policy=deterministic,
        )
        check_whole(sum(len(one) for one in kept), n * ticks)
        return kept

    def evaluate() -> None:
        _, lengths = evaluate_policy(model.policy, venv, n, return_episode_rewards=True, warn=False)
        check_whole(sum(lengths), n * ticks)  # type: ignore[arg-type]

    def buffer() -> Any:
        model._last_obs = venv.reset()  # type: ignore[assignment]
        model._last_episode_starts = np.ones(n, bool)
        model.collect_rollouts(venv, callback, model.rollout_buffer, ticks)
        check_whole(int(model.rollout_buffer.episode_starts.sum()), n)
        return model.rollout_buffer

    cpu = partial(cpu_of, venv)
    ways = [
        ("imitation", "generate_trajectories, SB3 policy", partial(trajectories, model, True)),
        ("imitation", "generate_trajectories, bare network", partial(trajectories, module, False)),
        ("stable-baselines3", "PPO.collect_rollouts", buffer),
        ("stable-baselines3", "evaluate_policy, keeps nothing", evaluate),
    ]
    return [
        Contender(
            library, f"{what}, {venue.name}", n, collect, cpu, collect is not evaluate, venue.usual
        )
        for library, what, collect in ways
        if library in venue.libraries
    ]


def ppo(config: Config, robot: RobotModel, venv: VecEnv, ticks: int) -> PPO:
    """A PPO whose actor has surefoot's layers and holds the nominal pose.

    Its critic, which surefoot has not, is one linear layer; its exploration noise is 2e-9 rad.
    """
    layout = {"pi": list(config.policy.hidden), "vf": []}
    model = PPO(
        "MlpPolicy",
        venv,
        n_steps=ticks,
        batch_size=ticks,
        device="cpu",
        policy_kwargs={"net_arch": layout, "activation_fn": torch.nn.ReLU, "log_std_init": -20.0},
    )
    hold_nominal(model.policy.action_net, robot)
    return model


class ReluNetwork:
    """The same layers without a policy class around them, as imitation's callable."""

    def __init__(self, config: Config, robot: RobotModel) -> None:
        sizes = (INPUT_SIZE, *config.policy.hidden)
        layers: list[torch.nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layers += [torch.nn.Linear(inputs, outputs), torch.nn.ReLU(inplace=True)]
        last = torch.nn.Linear(sizes[-1], len(JOINTS))
        hold_nominal(last, robot)
        self._module = torch.nn.Sequential(*layers, last).eval()

    def __call__(self, obs: np.ndarray, state: Any, done: Any) -> tuple[np.ndarray, Any]:
        """Actions ``(n, 12)`` of observations ``(n, 47)``."""
        with torch.inference_mode():
            return self._module(torch.from_numpy(obs)).numpy(), state


def hold_nominal(layer: Any, robot: RobotModel) -> None:
    """A last layer that gives the nominal pose, whatever the hidden ones compute."""
    with torch.no_grad():
        layer.weight.zero_()
        layer.bias.copy_(torch.from_numpy(robot.nominal[7:]))


def cpu_of(venv: VecEnv) -> float:
    """[s] of CPU time of this process and of those that hold the environments."""
    others = venv.env_method("process_time") if isinstance(venv, SubprocVecEnv) else []
    return time.process_time() + sum(others)


def check_whole(got: int, expected: int) -> None:
    """Raises RuntimeError when an episode ended early."""
    if got != expected:
        raise RuntimeError(f"counted {got}, not {expected}: a robot fell; figures would mislead")


def check_same_robot(config: Config, robot: RobotModel, env: Solo12Env) -> None:
    """The environment sees what surefoot's simulator and observation give, tick by tick.

    Raises:
        RuntimeError: it does not.
    """
    simulator = make_simulator(robot, 1, config.simulation)
    simulator.reset(standing(robot)[None], np.zeros((1, 18)))
    rng, period = np.random.default_rng(0), to_ticks(config.gait.period)
    ours = network_input(simulator.state, 0, np.zeros(3), period)[0]
    theirs, _ = env.reset()
    for tick in range(1, 201):
        if not np.allclose(ours, theirs, atol=1e-5):
            raise RuntimeError(f"the environment differs from surefoot at tick {tick - 1}")
        action = (robot.nominal[7:] + 0.3 * rng.standard_normal(12)).astype(np.float32)
        state = simulator.state
        torque = config.policy.kp * (action - state.q[:, 7:]) - config.policy.kd * state.v[:, 6:]
        simulator.step(clip_torque(torque, robot.torque_limit))
        ours = network_input(simulator.state, tick, np.zeros(3), period)[0]
        theirs = env.step(action)[0]


def bytes_per_frame(contender: Contender, frames: int) -> float | None:
    """What a frame that was kept takes in memory, Python's objects included."""
    if not contender.keeps:
        return None
    if contender.library == "stable-baselines3":  # a buffer that lives on
        arrays = [a for a in vars(contender.collect()).values() if isinstance(a, np.ndarray)]
        return sum(a.nbytes for a in arrays) / frames
    gc.collect()
    tracemalloc.start()
    try:
        kept = contender.collect()
        gc.collect()
        held = tracemalloc.get_traced_memory()[0]
        del kept
    finally:
        tracemalloc.stop()
    return held / frames


@contextmanager
def venues(config: Config, robot: RobotModel, seconds: float) -> Iterator[list[Venue]]:
    """Where the peers collect: 8 and 20 robots in this process, 8 in one each; the usual form."""
    model = build_model(robot, config.simulation)
    qpos = to_mujoco(standing(robot)[None], np.zeros((1, 18)))[0][0]
    make, usual = (
        partial(kind, model, qpos, seconds, config) for kind in (Solo12Env, UsualSolo12Env)
    )
    for env in (make(), usual()):
        check_same_robot(config, robot, env)
    # Forked, the processes begin in milliseconds: nothing is imported or compiled again. With
    # Monitor, and for imitation RolloutInfoWrapper, is how the tutorials make environments.
    told = make_vec_env(usual, 20, wrapper_class=RolloutInfoWrapper)
    built = [
        *(Venue("DummyVecEnv", DummyVecEnv([make] * n)) for n in (8, 20)),
        Venue("SubprocVecEnv", SubprocVecEnv([make] * 8, "fork")),
        Venue("usual form", told, ("imitation",), usual=True),
        Venue("usual form", make_vec_env(usual, 20), ("stable-baselines3",), usual=True),
    ]
    try:
        yield built
    finally:
        for venue in built:
            venue.venv.close()


def compare(rounds: int, seconds: float) -> dict[str, Any]:
    """All contenders in turns; surefoot again before each vector environment.

    Returns:
        ``rows``, one for each contender: ``library``, ``what``, ``robots``, ``usual``, ``keeps``,
        ``robot_ms_per_cpu_s`` (median), ``all_rounds``, ``ratio`` (surefoot's speed just before
        over it, median), ``cores`` (CPU time over wall time, median), ``bytes_per_frame`` (of
        some); ``ratio``, over the fastest of all peers; ``ratio_keeping``, over the fastest that
        keeps frames; ``ratio_usual``, over the fastest of these in the usual form; ``versions``.
    """
    config = Config()
    robot, ticks = solo12(config.robot), to_ticks(seconds)
    with venues(config, robot, seconds) as where:
        ours = surefoot_contender(config, robot, 20, seconds)
        groups = [peers(config, robot, venue, seconds) for venue in where]
        turns: dict[Contender, list[tuple[float, float, float]]] = {}
        for turn in range(rounds):
            for group in groups:
                reference, cores = timed(ours, ticks)
                turns.setdefault(ours, []).append((reference, 1.0, cores))
                for peer in group:
                    rate, cores = timed(peer, ticks)
                    turns.setdefault(peer, []).append((rate, reference / rate, cores))
            print(f"round {turn + 1} of {rounds}", file=sys.stderr)
        rows = []
        for contender, figures in turns.items():
            rate, ratio, cores = np.median(figures, axis=0).tolist()
            row = {
                "library": contender.library,
                "what": contender.what,
                "robots": contender.robots,
                "usual": contender.usual,
                "keeps": contender.keeps,
                "robot_ms_per_cpu_s": rate,
                "all_rounds": [figure[0] for figure in figures],
                "ratio": ratio,
                "cores": cores,
                "bytes_per_frame": None,
            }
            if contender.robots == 20:
                row["bytes_per_frame"] = bytes_per_frame(contender, 20 * ticks)
            rows.append(row)
    peer_rows = rows[1:]
    return {
        "rows": rows,
        "ratio": min(row["ratio"] for row in peer_rows),
        "ratio_keeping": min(row["ratio"] for row in peer_rows if row["keeps"]),
        "ratio_usual": min(row["ratio"] for row in peer_rows if row["keeps"] and row["usual"]),
        "rounds": rounds,
        "seconds": seconds,
        "versions": {name: version(name) for name in VERSIONS},
    }


def timed(contender: Contender, ticks: int) -> tuple[float, float]:
    """Robot-ms per second of CPU time, and cores used, in one turn."""
    gc.collect()
    began, before = time.perf_counter(), contender.cpu()
    contender.collect()
    used, wall = contender.cpu() - before, time.perf_counter() - began
    return contender.robots * ticks / used, used / wall


def table(figures: dict[str, Any]) -> str:
    """The figures of `compare`, as Markdown."""
    lines = [
        "| library | what | robots | robot-ms per CPU second | surefoot over it | cores "
        "| bytes a frame |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in figures["rows"]:
        size = row["bytes_per_frame"]
        lines.append(
            f"| {row['library']} | {row['what']} | {row['robots']} "
            f"| {row['robot_ms_per_cpu_s']:.0f} | {row['ratio']:.2f} "
            f"| {row['cores']:.2f} | {'-' if size is None else f'{size:.0f}'} |"
        )
    return "\n".join(lines)


def main(json_file: Path | None = None, rounds: int = 3, seconds: float = 2.0) -> None:
    """Compare, print a table, and write all figures to a file if one is named.

    Args:
        json_file: where to write the figures.
        rounds: how often each contender takes its turn; figures are medians.
        seconds: of an episode.
    """
    if os.environ.get("OMP_NUM_THREADS") != "1":
        sys.exit("speed per core needs one thread: run it with OMP_NUM_THREADS=1, or `make peers`")
    torch.set_num_threads(1)
    figures = compare(rounds, seconds)
    print(table(figures))
    print(
        f"\nsurefoot over the fastest peer: {figures['ratio']:.2f}; over the fastest that keeps "
        f"frames: {figures['ratio_keeping']:.2f}; over the fastest that keeps frames in the usual "
        f"form: {figures['ratio_usual']:.2f}"
    )
    if json_file is not None:
        json_file.write_text(json.dumps(figures, indent=1) + "\n")


if __name__ == "__main__":
    tyro.cli(main)
