"""The command robot: checks a description, prints what is made of it, and draws it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from surefoot.cli.outputs import Output, check_outputs
from surefoot.config import RobotConfig
from surefoot.files import write_json

if TYPE_CHECKING:
    from surefoot.robots.examine import RobotReport


@dataclass(frozen=True)
class ShowRobot:
    """Check a robot's description, say what is missing or odd, and draw it in its nominal pose.

    A robot of your own is a JSON or TOML file with the fields of `surefoot.RobotSpec`.

    JSON keys: name, urdf, mass [kg]; size [mass_ratio and length_ratio to Solo12, com_height and
    base_height m]; own [the gains, heights and weights that follow from its size]; joints [name,
    source, nominal, low, high rad, torque_limit N m, speed_limit rad/s, link_mass kg]; feet [x, y
    from the base, z above the ground m]; remarks [sentences].
    """

    robot: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="NAME|FILE")]
    """The name of a robot of the package (solo12, go2, go1, a1, anymal_c or hyq), or a file."""
    json: Path | None = None
    """Write what is printed to this file, as JSON."""
    image: Path | None = None
    """Draw the robot in its nominal pose to this file, a PNG."""

    def __call__(self) -> int:
        """Print the report; write and draw it where asked."""
        from surefoot.robots.examine import examine_robot
        from surefoot.robots.load import load_robot
        from surefoot.viz.film import portrait

        outputs = [Output("--json", self.json), Output("--image", self.image, (".png",))]
        check_outputs(self, outputs)
        config = RobotConfig(model=self.robot)
        report = examine_robot(config)
        print("\n".join(lines_of(report)))
        if self.json is not None:
            write_json(self.json, report)
        if self.image is not None:
            print(f"picture: {portrait(load_robot(config), self.image)}")
        return 0


def lines_of(report: RobotReport) -> list[str]:
    """The report as lines of text.

    Args:
        report: What the package makes of a robot.
    """
    size = report.size
    own = report.own
    lines = [
        f"{report.name}: {report.mass:.3f} kg, {report.urdf}",
        f"size: {size.mass_ratio:.3f} times Solo12's mass, {size.length_ratio:.3f} times its legs; "
        f"it stands with its base at {size.base_height:.3f} m, its center of mass at "
        f"{size.com_height:.3f} m",
        "",
        f"{'joint':<8}{'in the description':<22}{'nominal':>8}{'low':>8}{'high':>8}"
        f"{'torque':>9}{'speed':>9}{'link':>8}",
        f"{'':<30}{'rad':>8}{'rad':>8}{'rad':>8}{'N m':>9}{'rad/s':>9}{'kg':>8}",
    ]
    lines += [
        f"{row.name:<8}{row.source:<22}{row.nominal:>8.3f}{_or_none(row.low):>8}"
        f"{_or_none(row.high):>8}{row.torque_limit:>9.2f}{_or_none(row.speed_limit):>9}"
        f"{row.link_mass:>8.3f}"
        for row in report.joints
    ]
    outward = "where the nominal feet are, about their center"
    if own.hip_outward is not None:
        outward = f"{own.hip_outward} m outside the hips"
    lines += [
        "",
        "feet [m]: " + "  ".join(f"({x:.3f} {y:.3f} {z:.3f})" for x, y, z in report.feet),
        f"expert: kp {own.kp:g} N m/rad, kd {own.kd:g} N m s/rad; policy: kp {own.policy_kp:g}, "
        f"kd {own.policy_kd:g}",
        f"gait: center of mass at {own.com_height:g} m, base {own.base_height:g} m, steps "
        f"{own.step_height:g} m high, footholds {outward}",
        f"momentum weight {own.momentum_weight:g}, capture time {own.capture_time:g} s",
        "",
    ]
    if report.remarks:
        lines += [f"- {remark}" for remark in report.remarks]
    else:
        lines.append("nothing is missing or odd")
    return lines


def _or_none(value: float | None) -> str:
    """A number of a table, or a dash."""
    return "-" if value is None else f"{value:.2f}"
