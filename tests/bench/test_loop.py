"""The speed of the loop on the robot."""

from surefoot.bench.loop import bench_loop
from surefoot.config import Config, PolicyConfig


def test_a_tick_contains_the_policy_and_the_policy_the_network():
    times = bench_loop(Config(policy=PolicyConfig(hidden=(64, 64))), 300)
    assert times.ticks == 300
    assert times.tick_processor_median > times.policy_median > times.network_median > 0.0
    assert times.tick_p99 >= times.tick_median
    assert times.tick_processor_p99 >= times.tick_processor_median
