"""What the command evaluate prints: robustness, pushes, changes of gait and differences, in lines.

Read `evaluate` first, which measures.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from surefoot.evaluation.gaits import GaitSpeed, Switching
    from surefoot.evaluation.latching import Latching
    from surefoot.evaluation.push_limits import PushResult
    from surefoot.evaluation.report import EvaluationReport
    from surefoot.evaluation.robustness import Robustness, VelocityError


def print_controller(name: str, robustness: Robustness, pushes: PushResult | None) -> None:
    """Print one controller's robustness in a few lines, and its pushes in one more."""
    low, high = robustness.success_interval
    print(
        f"{name}: {robustness.successes} of {robustness.episodes} {robustness.split} initial "
        f"states ({100 * low:.1f} to {100 * high:.1f} %), {robustness.falls} fell, "
        f"{robustness.stalls} stalled, {robustness.diverged} diverged"
    )
    if robustness.covered is not None:
        print(f"  up, and 70 % of the distance commanded: {robustness.covered}")
    if robustness.body_contacts is not None:
        print(
            f"  touched the ground with something other than a foot: {robustness.body_contacts}, "
            f"of them {robustness.body_contact_successes} among the successes"
        )
    if robustness.latching is not None:
        print(f"  {_latching_line(robustness.latching)}")
    print(f"  velocity MSE vx, vy, yaw rate (successes): {_numbers(robustness.mse)}")
    print(f"  velocity MSE vx, vy, yaw rate (all, from 1 s on): {_numbers(robustness.settled_mse)}")
    if pushes is not None:
        print(f"  {_pushes_line(pushes)}")
    for gait in robustness.gaits or ():
        low, high = gait.success_interval
        print(
            f"  {gait.speed.gait}: {gait.successes} of {gait.episodes} "
            f"({100 * low:.1f} to {100 * high:.1f} %), {gait.falls} fell; {_speed_text(gait.speed)}"
        )


def print_switching(switching: Switching) -> None:
    """Print what became of robots that changed their gait."""
    low, high = switching.success_interval
    print(
        f"  {switching.switches} changes of gait in {switching.seconds:g} s: "
        f"{switching.successes} of {switching.episodes} ({100 * low:.1f} to {100 * high:.1f} %), "
        f"{switching.falls} fell"
    )
    for speed in switching.speeds:
        print(f"    {speed.gait}: {_speed_text(speed)}")


def _speed_text(speed: GaitSpeed) -> str:
    """How robots followed their commands in one gait."""
    vx, vy, yaw_rate = ("-" if each is None else f"{each:.3f}" for each in speed.error)
    return (
        f"{speed.on_speed} of {speed.robots} at the speed commanded, mean error {vx}, {vy} m/s, "
        f"{yaw_rate} rad/s"
    )


def print_differences(report: EvaluationReport) -> None:
    """Print how policy and expert differ, with 95 % intervals."""
    success = report.success_difference
    if success is not None:
        line = f"policy minus expert: {100 * success.difference:+.1f} points of success"
        if success.interval is not None:
            low, high = success.interval
            line += f" ({100 * low:+.1f} to {100 * high:+.1f})"
        print(line)
    if report.push_difference is not None:
        low, high = report.push_difference.interval
        difference = report.push_difference.difference
        print(f"policy minus expert: {difference:+.2f} N s ({low:+.2f} to {high:+.2f})")


def _latching_line(latching: Latching) -> str:
    """How many robots would have switched themselves off."""
    line = (
        f"under the profile {latching.profile}: {latching.latched} would have latched "
        f"(joint position {latching.by_position}, speed {latching.by_speed}, torque "
        f"{latching.by_torque}), {latching.latched_successes} of them among the successes"
    )
    if latching.outside:
        line += f"; {latching.outside} initial states lie outside it: {latching.outside_states}"
    return line


def _numbers(mse: VelocityError) -> str:
    """The velocity errors; a dash where there is none."""
    return ", ".join("-" if error is None else f"{error:.5f}" for error in mse)


def _pushes_line(pushes: PushResult) -> str:
    """The impulses that one controller withstands."""
    low, high = pushes.mean_interval
    directions = ", ".join(
        f"{direction:.0f}: {impulse:.2f} ({weakest:.2f} to {strongest:.2f})"
        for direction, impulse, (weakest, strongest) in zip(
            pushes.direction_deg, pushes.fitted_impulse, pushes.interval, strict=True
        )
    )
    return (
        f"push that {100 * pushes.share:.0f} % survive [N s]: "
        f"{pushes.mean_fitted_impulse:.2f} ({low:.2f} to {high:.2f}); by direction: {directions}"
    )
