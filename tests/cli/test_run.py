"""The commands run and twin: a policy in a file drives a twin over real UDP, in lockstep."""

import json
import subprocess
import sys
import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from threading import Thread

import numpy as np
import pytest

from surefoot.bench.engine import standing_policy
from surefoot.cli.run import (
    RunPolicy,
    expert_config,
    gait_number,
    gate_bounds,
    warn_of_unknown_starts,
    what_to_do,
)
from surefoot.cli.twin import RunTwin, seen
from surefoot.config import Config, Gait, PolicyConfig
from surefoot.config.deploy import RuntimeConfig
from surefoot.config.twin import LinkConfig, TwinConfig
from surefoot.deploy.bridge import UdpChannel
from surefoot.deploy.description import StartRange, layout_terms
from surefoot.deploy.drive import DriveReport
from surefoot.deploy.interfaces import Sensors
from surefoot.deploy.policy import OnnxPolicy, load
from surefoot.deploy.recorder import load_flight
from surefoot.deploy.udp_robot import address_text
from surefoot.files import WriteError
from surefoot.interop.onnx.file import describe, network_model, write_onnx
from surefoot.learning.joint_limits import SafetyBounds
from surefoot.learning.observation import GaitTiming, ObservationSpec
from surefoot.learning.policy import save
from surefoot.mpc.gaits import with_gait
from surefoot.robots.bounds import table_bounds
from surefoot.robots.load import load_robot
from surefoot.robots.scaling import with_own_values
from surefoot.scenarios import gains
from surefoot.twin.serve import make_twin
from surefoot.types import Command

SHORT = ("--config.stand", 0.3, "--config.stand-kp", 6.0)


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    """The file of a policy that holds the nominal pose, without safety bounds."""
    return standing_file(tmp_path_factory.mktemp("policy"))


def standing_file(folder: Path, bounds: SafetyBounds | None = None) -> Path:
    """The file of a policy that holds the nominal pose."""
    config = Config(policy=PolicyConfig(hidden=(16, 16)))
    standing = standing_policy(config)
    save(standing, folder / "policy.safetensors")
    robot = load_robot("solo12")
    description = describe(standing, folder / "policy.safetensors", robot, config)
    file = folder / "policy.onnx"
    write_onnx(network_model(standing), replace(description, bounds=bounds), file)
    return file


@pytest.fixture
def twin():
    """A twin in lockstep in a thread, and its address."""
    channel = UdpChannel()
    twin = make_twin(load_robot("solo12"), TwinConfig(), channel)
    going = [True]
    thread = Thread(target=twin.serve, args=(True, lambda: going[0]))
    thread.start()
    yield twin, address_text(channel.address)
    going[0] = False
    thread.join()


def wait_for(condition) -> bool:
    """Whether something happens within a minute."""
    end = time.monotonic() + 60.0
    while not condition() and time.monotonic() < end:
        time.sleep(0.01)
    return condition()


def test_a_policy_drives_a_twin_and_is_stopped(surefoot, policy, twin, tmp_path, capsys):
    simulated, address = twin
    file = tmp_path / "run.json"
    recording = tmp_path / "flight.npz"
    options = ("--lockstep", "--start", "--seconds", 0.5, "--recording", recording, "--keep")
    assert surefoot("run", policy, "--robot", address, *options, *SHORT, "--json", file) == 0
    report = json.loads(file.read_text())
    assert set(report) == set(DriveReport.__dataclass_fields__)
    assert report["fault"] == ""
    assert report["seconds"] == pytest.approx(0.2, abs=0.01)
    assert report["ticks"] >= 500
    assert len(load_flight(recording).tick) >= 500
    assert wait_for(lambda: simulated.bridge.commands >= 499)
    assert "latched: the runtime asked for it" in seen(simulated)


def test_numpy_onnx_runtime_and_tyro_are_enough_to_drive(twin, tmp_path):
    simulated, address = twin
    bounds = SafetyBounds((0.1, 0.5), (-0.5, 0.5), (-0.5, 0.5), ((-4.0, 4.0),) * 12)
    bounded = standing_file(tmp_path, bounds)
    file = tmp_path / "run.json"
    recording = ("--recording", tmp_path / "flight.npz", "--keep")
    # A velocity out of range is warned of, since the log is shown without bars too.
    options = ("--lockstep", "--start", "--seconds", 0.5, "--gate", "damp", "--vx", 9.0)
    run = ("run", bounded, "--robot", address, *options, *recording, *SHORT, "--json", file)
    program = [sys.executable, "-m", "tests.fakes.robot_computer", *map(str, run)]
    child = subprocess.run(program, capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    assert "lies outside of what the policy was trained on" in child.stderr
    assert "does not hold the initial states it was trained from" in child.stderr
    assert json.loads(file.read_text())["seconds"] == pytest.approx(0.2, abs=0.01)
    assert len(load_flight(tmp_path / "flight.npz").tick) >= 500
    assert wait_for(lambda: simulated.bridge.commands >= 499)


def test_a_file_without_initial_states_is_warned_of_in_a_line(policy, caplog):
    """Otherwise nobody would know that the fault posture cannot occur."""
    warn_of_unknown_starts(load(policy))
    (record,) = caplog.records
    assert "does not hold the initial states it was trained from" in record.message
    assert "surefoot export --starts" in record.message and "\n" not in record.message
    caplog.clear()
    known = StartRange((-0.1, 0.1), (-0.1, 0.1), ((-3.0, 3.0),) * 12, "solo12-trot-v1")
    warn_of_unknown_starts(with_description(policy, start_range=known))
    assert not caplog.records


def test_a_second_runtime_finds_the_robot_set_up_again(surefoot, policy, twin, tmp_path):
    simulated, address = twin
    options = ("--lockstep", "--start", "--seconds", 0.5, *SHORT)
    recording = ("--recording", tmp_path / "flight.npz")
    lying = simulated.driver.read()
    assert surefoot("run", policy, "--robot", address, *options, *recording) == 0
    assert simulated.driver.read() != lying
    # A second of the robot's has to pass, after which it is set up again.
    assert wait_for(lambda: simulated.driver.time_ns > 1_900_000_000)
    assert surefoot("run", policy, "--robot", address, *options, *recording) == 0
    assert wait_for(lambda: simulated.bridge.commands >= 499)


def test_a_fault_ends_with_status_1_and_is_recorded(surefoot, policy, twin, tmp_path, capsys):
    _, address = twin
    recording = tmp_path / "flight.npz"
    options = ("--lockstep", "--start", "--seconds", 5, "--recording", recording)
    limits = ("--config.tilt", 0.0)
    assert surefoot("run", policy, "--robot", address, *options, *SHORT, *limits) == 1
    printed = capsys.readouterr()
    assert '"tilt"' in printed.out
    assert f"`surefoot play {recording}` says why again" in printed.err
    assert "--lockstep" not in printed.err
    assert str(load_flight(recording).fault) == "tilt"


@pytest.mark.parametrize(
    ("lowest", "fault", "driven"),
    [(0.1, "", pytest.approx(0.2, abs=0.01)), (0.3, "gate", pytest.approx(0.001))],
)
def test_outside_of_its_policys_bounds_a_robot_is_damped_if_that_is_asked_for(
    surefoot, twin, tmp_path, lowest, fault, driven
):
    simulated, address = twin
    bounds = SafetyBounds((lowest, 0.5), (-0.5, 0.5), (-0.5, 0.5), ((-4.0, 4.0),) * 12)
    bounded = standing_file(tmp_path, bounds)
    file = tmp_path / "run.json"
    options = ("--lockstep", "--start", "--seconds", 0.5, "--recording", tmp_path / "flight.npz")
    run = ("run", bounded, "--robot", address, "--gate", "damp", *options, *SHORT)
    assert surefoot(*run, "--json", file) == int(bool(fault))
    report = json.loads(file.read_text())
    assert report["fault"] == fault
    assert report["seconds"] == driven
    assert wait_for(lambda: "latched: the runtime asked for it" in seen(simulated))


def test_a_gate_without_bounds_is_refused(surefoot, policy, capsys):
    options = ("--robot", "udp://127.0.0.1:1", "--start", "--seconds", 1, "--gate", "damp")
    assert surefoot("run", policy, *options) == 2
    message = "--gate damp: the policy's file does not hold the safety bounds"
    assert message in capsys.readouterr().err


def test_a_fault_is_told_though_its_recording_cannot_be_written(
    surefoot, policy, twin, tmp_path, capsys, monkeypatch
):
    def full(path, flight):
        raise WriteError(f"{path} cannot be written (the disk is full)")

    monkeypatch.setattr("surefoot.deploy.drive.save_flight", full)
    _, address = twin
    options = ("--lockstep", "--start", "--seconds", 5, "--recording", tmp_path / "flight.npz")
    assert surefoot("run", policy, "--robot", address, *options, *SHORT, "--config.tilt", 0.0) == 2
    printed = capsys.readouterr()
    assert '"tilt"' in printed.out
    assert "flight.npz cannot be written (the disk is full)" in printed.err


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (("--robot", "udp://127.0.0.1"), "no address of a bridge; use udp://127.0.0.1:PORT"),
        (("--robot", "127.0.0.1:5151"), "no address of a bridge"),
        (("--robot", "udp://127.0.0.1:1", "--start"), "--start and --seconds belong together"),
        (("--robot", "udp://127.0.0.1:1", "--seconds", 3), "--start and --seconds belong together"),
        (("--robot", "udp://127.0.0.1:1", "--heartbeat", 0), "--heartbeat 0: use at least"),
        (
            (*("--robot", "udp://127.0.0.1:1", "--heartbeat", 1), "--start", "--seconds", 3),
            "--heartbeat needs somebody who types; leave out --start",
        ),
        (("--robot", "udp://127.0.0.1:1", "--vx", "nan"), "--vx is nan"),
        (("--robot", "udp://127.0.0.1:1", "--recording", "a.txt"), "must end in .npz"),
    ],
)
def test_options_that_make_no_sense_are_refused(surefoot, policy, capsys, args, message):
    assert surefoot("run", policy, *args) == 2
    assert message in capsys.readouterr().err


def test_without_a_standard_input_nobody_could_stop_the_robot(
    surefoot, policy, capsys, monkeypatch
):
    monkeypatch.setattr(sys, "stdin", None)  # as after `<&-`
    assert surefoot("run", policy, "--robot", "udp://127.0.0.1:1") == 2
    message = "there is no standard input, so nobody could stop the robot; use --start --seconds"
    assert capsys.readouterr().err == f"surefoot: {message}\n"


def test_a_bridge_that_is_not_there_is_one_clear_line(surefoot, policy, capsys):
    channel = UdpChannel()
    address = address_text(channel.address)
    channel.close()
    assert surefoot("run", policy, "--robot", address, "--start", "--seconds", 1) == 2
    assert f"surefoot: no bridge answers at {address} within 2 s" in capsys.readouterr().err


def test_the_expert_is_that_of_the_policys_robot_gait_and_commands(policy):
    config = expert_config(load(policy))
    assert config.robot.model == "solo12"
    assert config.gait.timing == Config().gait.timing
    assert config.expert.kp == 3.0


def test_a_twin_says_where_it_listens_and_ends_in_time(surefoot, capsys):
    args = ("--robot", "go2", "--port", 0, "--seconds", 0.02, "--watch")
    assert surefoot("twin", *args, "--config.pose", "standing") == 0
    first, second = capsys.readouterr().out.splitlines()[:2]
    assert first.startswith("the twin of go2 listens at udp://127.0.0.1:")
    assert "height 0.334 m" in second and second.endswith("0 commands, idle")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--seconds", "nan"), "--seconds nan: use more than 0"),
        (("--seconds", -1), "--seconds -1: use more than 0"),
        (("--port", 99999), "--port 99999: use 0 to 65535"),
        (("--host", "192.0.2.1"), "--host 192.0.2.1, --port 5151: nothing can listen there"),
        (("--lockstep", "--config.link.delay", 1), "--lockstep excludes --config.link.delay"),
        (("--lockstep", "--config.link.jitter", 1), "--lockstep excludes --config.link.delay"),
    ],
)
def test_a_twin_that_cannot_be_is_refused_with_its_option(surefoot, capsys, options, message):
    assert surefoot("twin", *options) == 2
    assert message in capsys.readouterr().err


def test_a_twin_in_lockstep_may_lose_datagrams_and_have_slow_motors(surefoot, capsys):
    options = ("--lockstep", "--config.delay", 3, "--config.link.loss", 0.1)
    RunTwin(lockstep=True, config=TwinConfig(delay=3, link=LinkConfig(loss=0.1))).check_options()
    assert surefoot("twin", *options, "--port", 99999) == 2
    assert "--port 99999" in capsys.readouterr().err


def test_a_twin_may_have_a_hardware_profile(surefoot, capsys):
    options = ("--profile", "odri", "--port", 0, "--seconds", 0.01)
    assert surefoot("twin", *options) == 0
    assert surefoot("twin", "--robot", "go2", *options) == 2
    assert "belongs to the robot solo12" in capsys.readouterr().err
    assert RunTwin().host == "127.0.0.1"


def with_description(policy, **changes) -> OnnxPolicy:
    """A policy with another description and no network."""
    return OnnxPolicy(replace(load(policy).description, **changes), lambda inputs: inputs)


def test_the_gaits_of_a_policy_are_asked_for_by_name_and_others_refused(
    surefoot, policy, capsys, monkeypatch
):
    # Measuring the command gains of a walk takes seconds.
    monkeypatch.setattr(gains, "with_measured_gain", with_own_values)
    walk = GaitTiming("walk", 1000, 0.8, (0.5, 0.0, 0.25, 0.75))
    several = with_gaits(policy, walk)
    assert [gait_number(several, name) for name in (None, "trot", "walk")] == [0, 0, 1]
    assert [gait.period for gait in expert_config(several).gaits] == [0.5, 1.0]
    assert surefoot("run", policy, "--robot", "udp://127.0.0.1:1", "--gait", "walk") == 2
    assert "--gait: there is no gait 'walk'. Known: trot" in capsys.readouterr().err


def with_gaits(policy, *further) -> OnnxPolicy:
    """A policy of further gaits, without a network."""
    description = load(policy).description
    gaits = (*description.gaits, *further)
    goal = layout_terms(ObservationSpec(description.phase, gaits)).goal
    return with_description(policy, gaits=gaits, goal=goal)


def test_the_experts_gate_has_the_bounds_that_the_policy_was_trained_under(policy, caplog):
    bounds = SafetyBounds((0.2, 0.4), (-0.1, 0.2), (-0.3, 0.4), ((-2.0, 2.5),) * 12)
    bounded = with_description(policy, bounds=bounds)
    config = expert_config(bounded)
    low, high = gate_bounds(bounded, config)
    assert low.tolist() == [0.2, -0.1, -0.3, *[-2.0] * 12]
    assert high.tolist() == [0.4, 0.2, 0.4, *[2.5] * 12]
    assert caplog.text == ""
    own = gate_bounds(with_description(policy, bounds=None), config)
    np.testing.assert_array_equal(own, table_bounds(config.safety))
    assert "does not hold the safety bounds" in caplog.text
    with pytest.raises(ValueError, match=r"does not hold the safety bounds .* export the policy"):
        gate_bounds(with_description(policy, bounds=None))


@pytest.mark.parametrize("rate", [1000, 500])
def test_the_expert_drives_for_a_block_of_seconds_at_every_rate(policy, rate, monkeypatch):
    monkeypatch.setattr("surefoot.field.planner.PlannerProcess", NoPlanner)
    bounds = SafetyBounds((0.0, 1.0), (-0.1, 0.1), (-0.1, 0.1), ((-4.0, 4.0),) * 12)
    bounded = with_description(policy, bounds=bounds, rate_hz=rate)
    config = RuntimeConfig(block=0.1)
    run = RunPolicy(Path("policy.onnx"), "udp://127.0.0.1:1", gate="expert", config=config)
    with ExitStack() as closing:
        safeguard = run.safeguard(bounded, closing)
    assert safeguard is not None and safeguard.switch is not None and safeguard.expert is not None
    switch = safeguard.switch
    still = np.zeros(12)
    level = np.array([0.0, 0.0, 0.0, 1.0])
    safe = Sensors(0, 0, bounded.nominal, still, still, level, np.zeros(3), np.zeros(3), None)
    tilted = safe._replace(orientation=np.array([0.3, 0.0, 0.0, 0.954]))
    step = 1000 // rate
    assert switch.expert_drives(tilted, 0, Command())
    drove = [switch.expert_drives(safe, tick * step, Command()) for tick in range(1, rate)]
    assert 1 + sum(drove) == 0.1 * rate


class NoPlanner:
    """A planner that nobody asks."""

    def __init__(self, config: Config, realtime: bool) -> None:
        self.config = config

    def close(self) -> None:
        pass


def test_a_named_gait_has_its_own_steps_and_horizon(policy, monkeypatch):
    monkeypatch.setattr(gains, "with_measured_gain", lambda config: config)
    pace = GaitTiming("pace", 300, 0.5, (0.0, 0.5, 0.0, 0.5))
    named = expert_config(with_description(policy, gaits=(pace,)))
    assert named == replace(with_gait(Config(), "pace"), robot=named.robot, commands=named.commands)
    assert named.gait.step_height == 0.06
    other = expert_config(with_description(policy, gaits=(replace(pace, duty=0.55),)))
    assert other.gait.duty == 0.55
    assert other.gait.step_height == Gait().step_height
    assert other.expert.centroidal.nodes is None  # it follows the gait


def test_the_expert_of_a_robot_from_a_file_is_refused_with_what_to_do(policy):
    with pytest.raises(ValueError, match=r"one of 'mine', .*use --gate damp"):
        expert_config(with_description(policy, robot="mine"))


def test_of_missed_deadlines_a_busy_machine_may_be_the_cause():
    text = what_to_do("missed deadlines", "flight.npz", lockstep=False)
    assert "use --realtime" in text
    assert "--realtime" not in what_to_do("tilt", "flight.npz", lockstep=False)
