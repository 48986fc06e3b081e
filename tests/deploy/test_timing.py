"""How missed deadlines are counted, by the robot's clock."""

from surefoot.deploy.timing import Deadlines, TickClock
from tests.deploy.test_handover import sensors


def seen(*milliseconds: float) -> Deadlines:
    """What is counted of measurements at these times."""
    deadlines = Deadlines(1000)
    for number, at in enumerate(milliseconds):
        deadlines.see(sensors(time_ns=round(1e6 * at), sequence=number))
        deadlines.count()
    return deadlines


def test_a_first_measurement_has_missed_nothing():
    deadlines = seen(5000)
    assert (deadlines.unseen, deadlines.missed, deadlines.steady) == (0, 0, False)


def test_gaps_of_the_robots_clock_are_ticks_that_nobody_saw():
    deadlines = seen(10, 11, 15)
    assert (deadlines.unseen, deadlines.missed, deadlines.in_a_row) == (3, 3, 3)
    assert not deadlines.steady
    deadlines = seen(10, 11, 15, 17, 18)
    assert (deadlines.unseen, deadlines.missed, deadlines.in_a_row) == (0, 4, 0)
    assert deadlines.steady


def test_a_clock_that_jitters_has_missed_nothing():
    assert seen(0.0, 1.4, 1.9, 3.1, 3.9).missed == 0


def test_a_jitter_of_half_a_tick_and_more_does_not_add_up():
    late_and_early = [number + 0.6 * (number % 2) for number in range(100)]
    deadlines = seen(*late_and_early)
    assert deadlines.missed <= 1
    assert abs(deadlines.passed - 100) <= 1


def test_a_measurement_that_is_seen_again_is_no_tick():
    deadlines = seen(0, 1)
    for _ in range(5):
        deadlines.see(sensors(time_ns=1_000_000, sequence=1))
    assert deadlines.passed == 2
    deadlines.see(sensors(time_ns=4_000_000, sequence=2))
    assert (deadlines.passed, deadlines.unseen) == (5, 2)


def test_a_clock_that_runs_fast_hides_nothing():
    clock = TickClock(1e6)
    times = [round(0.9e6 * number) for number in range(1000)]
    assert sum(clock.unseen(time) for time in times) == 0
    assert clock.unseen(times[-1] + 10_000_000) == 8


def test_a_command_that_took_longer_than_a_tick_is_missed_once():
    deadlines = seen(0, 1)
    deadlines.worked(1_200_000)
    deadlines.see(sensors(time_ns=3_000_000, sequence=9))
    deadlines.count()
    assert (deadlines.missed, deadlines.in_a_row) == (1, 1)


def test_a_command_that_is_written_again_in_time_ends_a_row():
    deadlines = seen(0, 5)
    assert deadlines.in_a_row == 4
    deadlines.wait()
    assert (deadlines.in_a_row, deadlines.missed, deadlines.unseen) == (0, 4, 0)
