"""The speed of the loop on the robot."""

from surefoot.bench import loop
from surefoot.bench.engine import standing_policy
from surefoot.bench.loop import bench_loop
from surefoot.config import Config, PolicyConfig
from surefoot.interop.onnx.file import describe, network_model, write_onnx
from surefoot.learning.policy import save
from surefoot.robots.load import load_robot
from surefoot.robots.model import standing


def test_a_tick_contains_the_policy_and_the_policy_the_network(monkeypatch):
    monkeypatch.setattr(loop, "KILLS", 0)
    times = bench_loop(Config(policy=PolicyConfig(hidden=(64, 64))), 300)
    assert times.ticks == 300
    assert times.tick_processor_median > times.policy_median > times.network_median > 0.0
    assert times.tick_p99 >= times.tick_median
    assert times.tick_processor_p99 >= times.tick_processor_median
    assert times.damped_20_ms_median is None


def test_a_runtime_that_is_killed_is_damped_after_the_bridges_timeout(tmp_path):
    config = Config(policy=PolicyConfig(hidden=(16, 16)))
    policy = standing_policy(config)
    robot = load_robot(config.robot)
    file = tmp_path / "policy.onnx"
    save(policy, tmp_path / "policy.safetensors")
    description = describe(policy, tmp_path / "policy.safetensors", robot, config)
    write_onnx(network_model(policy), description, file)
    # So long that a busy machine does not end the runtime before.
    damped = loop.time_to_damping(file, standing(robot), timeout=1.0)
    assert damped is not None
    assert 0.9e6 < damped < 3e6
