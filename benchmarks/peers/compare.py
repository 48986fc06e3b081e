"""Speed of surefoot's collection, compared with imitation's and Stable-Baselines3's.

All libraries advance the same MuJoCo model of a standing Solo12 at 1 kHz with a 3 x 512 network in
the loop. The measure is robot-milliseconds per second of CPU time, over all processes of a
contender: this is the speed per core of one process or of many, and waiting for a busy core is not
counted. The contenders take turns, each soon after surefoot; the results are medians over the
rounds. The README in this folder says what makes the comparison fair.
"""

from __future__ import annotations

import gc
import os
import sys
import time
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from imitation.data import rollout as imitation  # pyright: ignore[reportMissingImports]
from imitation.data.wrappers import RolloutInfoWrapper  # pyright: ignore[reportMissingImports]
from solo12_env import Solo12Env, UsualSolo12Env
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv, VecEnv

from surefoot.config import Config
from surefoot.files import write_json
from surefoot.learning.network import PolicyNetwork
from surefoot.learning.observation import INPUT_SIZE, network_input
from surefoot.learning.policy import Policy, pd, policy_spec
from surefoot.robots.load import load_robot
from surefoot.robots.model import RobotModel, clip_torque, standing
from surefoot.robots.scaling import with_own_values
from surefoot.rollouts.arbiters import SafetySwitch
from surefoot.rollouts.engine import rollout
from surefoot.rollouts.episodes import Episodes, Rollout
from surefoot.rollouts.outcome import Outcome
from surefoot.runs.versions import processor
from surefoot.safety.gates import Bounds
from surefoot.safety.monitor import SafetyMonitor
from surefoot.scenarios.starts import at_rest
from surefoot.sim import make_simulator
from surefoot.sim.mujoco import to_mujoco
from surefoot.sim.mujoco_model import build_model
from surefoot.types import JOINTS, to_ticks

VERSIONS = ("imitation", "stable-baselines3", "gymnasium", "mujoco", "torch", "numpy")


@dataclass(frozen=True)
class Contender:
    """One way to collect.

    Attributes:
        library: Name of the library.
        what: The call, as the table names it.
        robots: Number of robots that are advanced together.
        collect: Runs one episode of every robot and returns what it kept.
        cpu: Returns the CPU time that all processes which take part have used so far [s].
        keeps: True if the frames are there afterwards.
        usual: True if it is set up as in the libraries' tutorials, not as fast as possible.
    """

    library: str
    what: str
    robots: int
    collect: Callable[[], Any]
    cpu: Callable[[], float]
    keeps: bool = True
    usual: bool = False


@dataclass(frozen=True)
class Row:
    """The speed of one contender; `ratio`, `cores` and the speed are medians over the rounds.

    Attributes:
        library: Name of the library.
        what: The call, as the table names it.
        robots: Number of robots that are advanced together.
        usual: True if it is set up as in the libraries' tutorials.
        keeps: True if the frames are there afterwards.
        robot_ms_per_cpu_s: Robot-milliseconds per second of CPU time.
        all_rounds: The same in each round.
        ratio: Speed of surefoot just before, divided by this speed.
        cores: CPU time divided by wall time.
        bytes_per_frame: Memory that a frame takes; None where it was not measured.
    """

    library: str
    what: str
    robots: int
    usual: bool
    keeps: bool
    robot_ms_per_cpu_s: float
    all_rounds: tuple[float, ...]
    ratio: float
    cores: float
    bytes_per_frame: float | None


@dataclass(frozen=True)
class Comparison:
    """The speeds of all contenders.

    Attributes:
        rows: One row for each contender; the first is surefoot's.
        ratio: Speed of surefoot, divided by that of the fastest other contender.
        ratio_keeping: The same for the fastest contender that keeps its frames.
        ratio_usual: The same for the fastest of these in the usual form.
        rounds: Number of turns of each contender.
        seconds: Duration of an episode [s].
        versions: Version of each package.
        processor: Model of the processor.
    """

    rows: tuple[Row, ...]
    ratio: float
    ratio_keeping: float
    ratio_usual: float
    rounds: int
    seconds: float
    versions: dict[str, str]
    processor: str


def surefoot_contender(config: Config, robot: RobotModel, robots: int, seconds: float) -> Contender:
    """The collection of Algorithm 4: the policy drives, the monitor watches, all is recorded."""
    network = PolicyNetwork(config.policy)
    hold_nominal(network.linear[-1], robot)
    policy = Policy(network, policy_spec(config), np.zeros((2, 3)), robot.name)
    simulator = make_simulator(robot, robots, config.simulation)
    episodes = Episodes(at_rest(standing(robot), np.zeros((robots, 3))), seconds)
    arbiter = SafetySwitch(SafetyMonitor(Bounds(config.safety), 2.0))

    def collect() -> Rollout:
        # A standing robot violates no bound, so that the expert, here the policy, is never asked.
        rollouts = rollout(simulator, episodes, arbiter, policy, policy, safety=config.safety)
        if rollouts.expert_drove.any() or (rollouts.outcome == Outcome.FELL).any():
            raise RuntimeError(
                "surefoot: a robot fell, or the expert took over: nothing to compare"
            )
        return rollouts

    return Contender("surefoot", "rollout, monitor on", robots, collect, time.process_time)


@dataclass(frozen=True)
class Venue:
    """A vector environment, its name, and the libraries that collect in it.

    Attributes:
        name: Its name in the table.
        venv: The environments.
        libraries: Names of the libraries that collect in it.
        usual: See `Contender`.
    """

    name: str
    venv: VecEnv
    libraries: tuple[str, ...] = ("imitation", "stable-baselines3")
    usual: bool = False


def peers(config: Config, robot: RobotModel, venue: Venue, seconds: float) -> list[Contender]:
    """The ways in which imitation and Stable-Baselines3 collect in a vector environment."""
    venv = venue.venv
    ticks = to_ticks(seconds)
    n = venv.num_envs
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
        check_frames(sum(len(trajectory) for trajectory in kept), n * ticks)
        return kept

    def evaluate() -> None:
        _, lengths = evaluate_policy(model.policy, venv, n, return_episode_rewards=True, warn=False)
        check_frames(sum(lengths), n * ticks)  # type: ignore[arg-type]

    def buffer() -> Any:
        model._last_obs = venv.reset()  # type: ignore[assignment]
        model._last_episode_starts = np.ones(n, bool)
        model.collect_rollouts(venv, callback, model.rollout_buffer, ticks)
        check_frames(int(model.rollout_buffer.episode_starts.sum()), n)
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

    Its critic, which surefoot does not have, is one linear layer; the exploration noise is 2e-9
    rad.
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
    """The same layers without a policy class, as a callable for imitation."""

    def __init__(self, config: Config, robot: RobotModel) -> None:
        sizes = (INPUT_SIZE, *config.policy.hidden)
        layers: list[torch.nn.Module] = []
        for inputs, outputs in pairwise(sizes):
            layers += [torch.nn.Linear(inputs, outputs), torch.nn.ReLU(inplace=True)]
        last = torch.nn.Linear(sizes[-1], len(JOINTS))
        hold_nominal(last, robot)
        self._module = torch.nn.Sequential(*layers, last).eval()

    def __call__(self, obs: np.ndarray, state: Any, done: Any) -> tuple[np.ndarray, Any]:
        """Actions ``(n, 12)`` for observations ``(n, 47)``."""
        with torch.inference_mode():
            return self._module(torch.from_numpy(obs)).numpy(), state


def hold_nominal(layer: Any, robot: RobotModel) -> None:
    """Make a last layer return the nominal pose, whatever the hidden layers compute."""
    with torch.no_grad():
        layer.weight.zero_()
        layer.bias.copy_(torch.from_numpy(robot.nominal[7:]))


def cpu_of(venv: VecEnv) -> float:
    """CPU time of this process and of those that hold the environments [s]."""
    total = time.process_time()
    if isinstance(venv, SubprocVecEnv):
        total += sum(venv.env_method("process_time"))
    return total


def check_frames(counted: int, expected: int) -> None:
    """Check that no episode ended early.

    Raises:
        RuntimeError: A robot fell, so that there are fewer frames than expected.
    """
    if counted != expected:
        raise RuntimeError(f"{counted} frames instead of {expected}: a robot fell")


def check_same_robot(config: Config, robot: RobotModel, env: Solo12Env) -> None:
    """Check that the environment gives surefoot's own observations, tick by tick.

    Raises:
        RuntimeError: An observation differs.
    """
    simulator = make_simulator(robot, 1, config.simulation)
    simulator.reset(standing(robot)[None], np.zeros((1, 18)))
    rng = np.random.default_rng(0)
    spec = policy_spec(config)
    expected = network_input(simulator.state, 0, np.zeros(3), spec.observation)[0]
    observation, _ = env.reset()
    for tick in range(1, 201):
        if not np.allclose(expected, observation, atol=1e-5):
            raise RuntimeError(f"the environment differs from surefoot at tick {tick - 1}")
        action = (robot.nominal[7:] + 0.3 * rng.standard_normal(12)).astype(np.float32)
        state = simulator.state
        torque = pd(action, state.q, state.v, spec)
        simulator.step(clip_torque(torque, robot.torque_limit))
        expected = network_input(simulator.state, tick, np.zeros(3), spec.observation)[0]
        observation = env.step(action)[0]


def bytes_per_frame(contender: Contender, frames: int) -> float | None:
    """Memory that a frame takes, including Python's objects; None if no frames are kept."""
    if not contender.keeps:
        return None
    if contender.library == "stable-baselines3":  # it reuses one buffer
        values = vars(contender.collect()).values()
        return sum(value.nbytes for value in values if isinstance(value, np.ndarray)) / frames
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
    """The environments: 8 and 20 robots in this process, 8 in one process each, the usual form."""
    model = build_model(robot, config.simulation)
    qpos = to_mujoco(standing(robot)[None], np.zeros((1, 18)))[0][0]
    fast = partial(Solo12Env, model, qpos, seconds, config)
    usual = partial(UsualSolo12Env, model, qpos, seconds, config)
    check_same_robot(config, robot, fast())
    check_same_robot(config, robot, usual())
    # The tutorials make environments with Monitor, and for imitation with RolloutInfoWrapper.
    wrapped = make_vec_env(usual, 20, wrapper_class=RolloutInfoWrapper)
    all_venues = [
        Venue("DummyVecEnv", DummyVecEnv([fast] * 8)),
        Venue("DummyVecEnv", DummyVecEnv([fast] * 20)),
        # A fork takes milliseconds: nothing is imported or compiled again.
        Venue("SubprocVecEnv", SubprocVecEnv([fast] * 8, "fork")),
        Venue("usual form", wrapped, ("imitation",), usual=True),
        Venue("usual form", make_vec_env(usual, 20), ("stable-baselines3",), usual=True),
    ]
    try:
        yield all_venues
    finally:
        for venue in all_venues:
            venue.venv.close()


@dataclass(frozen=True)
class Turn:
    """One turn of a contender.

    Attributes:
        rate: Robot-milliseconds per second of CPU time.
        cores: CPU time divided by wall time.
        ratio: Speed of surefoot just before, divided by this rate.
    """

    rate: float
    cores: float
    ratio: float = 1.0


def compare(rounds: int, seconds: float) -> Comparison:
    """Let all contenders take turns, and surefoot again before each vector environment."""
    config = with_own_values(Config())
    robot = load_robot(config.robot)
    ticks = to_ticks(seconds)
    turns: dict[Contender, list[Turn]] = {}
    with venues(config, robot, seconds) as all_venues:
        surefoot = surefoot_contender(config, robot, 20, seconds)
        groups = [peers(config, robot, venue, seconds) for venue in all_venues]
        for number in range(rounds):
            for group in groups:
                reference = timed(surefoot, ticks)
                turns.setdefault(surefoot, []).append(reference)
                for peer in group:
                    turn = timed(peer, ticks)
                    turn = replace(turn, ratio=reference.rate / turn.rate)
                    turns.setdefault(peer, []).append(turn)
            print(f"round {number + 1} of {rounds}", file=sys.stderr)
        rows = tuple(row_of(contender, turns[contender], ticks) for contender in turns)
    peer_rows = rows[1:]
    keeping = [row for row in peer_rows if row.keeps]
    return Comparison(
        rows,
        ratio=min(row.ratio for row in peer_rows),
        ratio_keeping=min(row.ratio for row in keeping),
        ratio_usual=min(row.ratio for row in keeping if row.usual),
        rounds=rounds,
        seconds=seconds,
        versions={name: version(name) for name in VERSIONS},
        processor=processor(),
    )


def timed(contender: Contender, ticks: int) -> Turn:
    """Let a contender collect once."""
    gc.collect()
    wall_before = time.perf_counter()
    cpu_before = contender.cpu()
    contender.collect()
    cpu = contender.cpu() - cpu_before
    wall = time.perf_counter() - wall_before
    return Turn(rate=contender.robots * ticks / cpu, cores=cpu / wall)


def row_of(contender: Contender, turns: list[Turn], ticks: int) -> Row:
    """Sum up the turns of a contender; with 20 robots, measure the memory too."""
    memory = None
    if contender.robots == 20:
        memory = bytes_per_frame(contender, 20 * ticks)
    return Row(
        library=contender.library,
        what=contender.what,
        robots=contender.robots,
        usual=contender.usual,
        keeps=contender.keeps,
        robot_ms_per_cpu_s=float(np.median([turn.rate for turn in turns])),
        all_rounds=tuple(turn.rate for turn in turns),
        ratio=float(np.median([turn.ratio for turn in turns])),
        cores=float(np.median([turn.cores for turn in turns])),
        bytes_per_frame=memory,
    )


def table(comparison: Comparison) -> str:
    """The rows as a Markdown table."""
    lines = [
        "| library | what | robots | robot-ms per CPU second | ratio: surefoot to this row | cores "
        "| bytes per frame |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in comparison.rows:
        memory = "-" if row.bytes_per_frame is None else f"{row.bytes_per_frame:.0f}"
        lines.append(
            f"| {row.library} | {row.what} | {row.robots} | {row.robot_ms_per_cpu_s:.0f} "
            f"| {row.ratio:.2f} | {row.cores:.2f} | {memory} |"
        )
    return "\n".join(lines)


def main(json_file: Path | None = None, rounds: int = 3, seconds: float = 2.0) -> None:
    """Compare, print a table, and write all results to a file if one is named.

    Args:
        json_file: File to write the results to.
        rounds: Number of turns of each contender; the results are medians over them.
        seconds: Duration of an episode [s].
    """
    if os.environ.get("OMP_NUM_THREADS") != "1":
        sys.exit("speed per core needs one thread: run it with OMP_NUM_THREADS=1, or `make peers`")
    torch.set_num_threads(1)
    comparison = compare(rounds, seconds)
    print(table(comparison))
    print(
        f"\nratio of surefoot to the fastest other library: {comparison.ratio:.2f}; to the fastest "
        f"that keeps frames: {comparison.ratio_keeping:.2f}; to the fastest that keeps frames in "
        f"the usual form: {comparison.ratio_usual:.2f}; on {comparison.processor}"
    )
    if json_file is not None:
        write_json(json_file, comparison)


if __name__ == "__main__":
    tyro.cli(main)
