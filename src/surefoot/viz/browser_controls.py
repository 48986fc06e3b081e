"""The page's controls: who drives, how to walk and in which gait, pushes, time and robot.

Values from a page are clipped to the range of their control before they are used, because a page
may send anything. Read `browser` next, which does what the controls ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from surefoot.config.gait_table import GAITS
from surefoot.config.robot_table import ROBOTS
from surefoot.types import Command
from surefoot.viz.live import DRIVERS, DriverName

if TYPE_CHECKING:
    import viser

    from surefoot.viz.browser import Page

AXES = ("vx [m/s]", "vy [m/s]", "yaw rate [rad/s]")
"""The sliders of a command."""
KEY_PAIRS = (("W", "S"), ("Q", "E"), ("A", "D"))
"""The keys that move each slider up and down."""
KEY_SHARE = 0.1
"""A key moves a slider by this fraction of its range."""
FIRST_SPEED = 0.2
"""[m/s] The forward speed that a robot is commanded first, if that is in its range."""
SPEEDS = {"real time": 1.0, "1/2": 0.5, "1/4": 0.25, "1/10": 0.1, "1/25": 0.04}
"""The speeds at which time may pass, by name."""
MOST_PUSH = 3.0
"""[N s] The strongest push on a Solo12; on other robots it scales with their weight and speed."""
FIRST_PUSH = 0.8
"""[N s] The initial size of a push, on a Solo12: most policies recover from it."""


def clipped(value: float, low: float, high: float) -> float:
    """The nearest number within a range; ``low`` for NaN."""
    return min(max(value, low), high) if value == value else low


class Controls:
    """The controls of one page, added at the page's current place for controls.

    Args:
        server: The page's server.
        page: The page, which does what the controls ask for.
    """

    def __init__(self, server: viser.ViserServer, page: Page) -> None:
        self._gui = server.gui
        self._page = page
        self._low = Command()
        self._high = Command()
        self._push_scale = 1.0
        self._walked: tuple[str, ...] = ()
        self._fitting = False
        self._add_time()

    def add_driving(self) -> None:
        """Add the controls of the simulation, at the page's current place for controls."""
        self._add_command()
        self._add_pushing()
        self._add_choice()

    def _add_command(self) -> None:
        """Add the controls for the driver, the gait and the command."""
        with self._gui.add_folder("Drive"):
            self._driver = self._gui.add_dropdown("driver", DRIVERS)
            self._driver.on_update(lambda _: self._let_drive())
            self._gait = self._gui.add_dropdown("gait", tuple(GAITS), hint="key G: the next one")
            self._gait.on_update(lambda _: self._choose())
            self._sliders = [
                self._gui.add_slider(name, -1.0, 1.0, 0.01, 0.0, hint=f"keys {' and '.join(pair)}")
                for name, pair in zip(AXES, KEY_PAIRS, strict=True)
            ]
            for slider in self._sliders:
                slider.on_update(lambda _: self._tell())
        for axis, (name, pair) in enumerate(zip(AXES, KEY_PAIRS, strict=True)):
            for key, sign in zip(pair, (1.0, -1.0), strict=True):
                word = "More" if sign > 0.0 else "Less"
                self._add_key(f"{word} {name}", key, lambda a=axis, s=sign: self._nudge(a, s))
        self._add_key("Stand still", "X", self._stand)
        self._add_key("Next gait of those that are walked", "G", self._next_gait)

    def _add_pushing(self) -> None:
        """Add the controls for pushes."""
        with self._gui.add_folder("Push"):
            self._size = self._gui.add_slider("size [N s]", 0.0, MOST_PUSH, 0.1, FIRST_PUSH)
            self._direction = self._gui.add_slider(
                "towards [deg]",
                -180.0,
                180.0,
                5.0,
                90.0,
                hint="0 is forward, 90 to the robot's left, -90 to its right",
            )
            button = self._gui.add_button("Push", color="orange", hint="key F")
            button.on_click(lambda _: self._push())
        self._add_key("Push the robot", "F", self._push)

    def _add_time(self) -> None:
        """Add the controls for time."""
        with self._gui.add_folder("Time"):
            self._speed = self._gui.add_dropdown("speed", tuple(SPEEDS))
            self._speed.on_update(lambda _: self._set_speed())
            buttons = self._gui.add_button_group(
                "", ("Pause", "Reset"), hint="keys P and R; a second Pause goes on"
            )
            buttons.on_click(lambda event: self._press(event.target.value))
        self._add_key("Pause or go on", "P", self._page.pause)
        self._add_key("Reset", "R", self._page.reset)

    def _press(self, button: str) -> None:
        """Do what a button for time says."""
        if button == "Pause":
            self._page.pause()
        elif button == "Reset":
            self._page.reset()

    def _add_choice(self) -> None:
        """Add the control for the robot."""
        with self._gui.add_folder("Robot"):
            self._robot = self._gui.add_dropdown("robot", tuple(ROBOTS))
            self._robot.on_update(lambda _: self._choose())

    def _add_key(self, label: str, key: Any, function: Callable[[], None]) -> None:
        """Make a key call a function; Ctrl-K lists the keys."""
        command: Any = self._gui.add_command(label, hotkey=key)
        command.on_trigger(lambda _: function())

    def show_choice(self, robot: str, gait: str, walked: Sequence[str]) -> None:
        """Show which robot is driven, and which gait was asked for.

        Args:
            robot: Name of the robot.
            gait: Name of the gait.
            walked: Names of the gaits that can begin without another simulation.
        """
        self._fitting = True  # values set here are not somebody's choice
        self._walked = tuple(walked)
        self._robot.options = with_names(tuple(ROBOTS), (robot,))
        self._robot.value = robot
        self._gait.options = with_names(tuple(GAITS), walked)
        self._gait.value = gait
        self._fitting = False

    def fit(
        self,
        drivers: Sequence[DriverName],
        commands: tuple[Command, Command],
        push_scale: float,
    ) -> None:
        """Fit the controls to what is driven now.

        Afterwards they show the command of a slow walk.

        Args:
            drivers: Who can drive; the first one does.
            commands: The smallest and the largest command.
            push_scale: How much stronger pushes are than on a Solo12.
        """
        self._fitting = True
        self._low, self._high = commands
        self._push_scale = push_scale
        self._driver.options = tuple(drivers)
        self._driver.value = drivers[0]
        first = Command(vx=FIRST_SPEED)
        for slider, low, high, value in zip(
            self._sliders, self._low, self._high, first, strict=True
        ):
            slider.min = low
            slider.max = high
            slider.visible = low < high
            slider.value = clipped(value, low, high)
        self._size.max = round(MOST_PUSH * push_scale, 1)
        self._size.step = 0.1 if push_scale < 3.0 else 1.0
        self._size.value = round(FIRST_PUSH * push_scale, 1)
        self._fitting = False

    @property
    def command(self) -> Command:
        """The command that the sliders show, clipped to its range."""
        values = [slider.value for slider in self._sliders]
        limits = zip(values, self._low, self._high, strict=True)
        return Command(*(clipped(value, low, high) for value, low, high in limits))

    def _tell(self) -> None:
        """Tell the robot what the sliders show."""
        if not self._fitting:
            self._page.tell(self.command)

    def _let_drive(self) -> None:
        """Let the chosen driver drive."""
        if not self._fitting:
            self._page.let_drive(self._driver.value)

    def _nudge(self, axis: int, sign: float) -> None:
        """Move a slider by a step."""
        low = self._low[axis]
        high = self._high[axis]
        value = self._sliders[axis].value + sign * KEY_SHARE * (high - low)
        self._sliders[axis].value = round(clipped(value, low, high), 3)

    def _stand(self) -> None:
        """Set all sliders to zero, or as near as their ranges allow."""
        for slider, low, high in zip(self._sliders, self._low, self._high, strict=True):
            slider.value = clipped(0.0, low, high)

    def _next_gait(self) -> None:
        """Ask for the next gait after the one shown, among those that are walked."""
        if self._gait.value in self._walked:
            place = self._walked.index(self._gait.value) + 1
            self._gait.value = self._walked[place % len(self._walked)]

    def _push(self) -> None:
        """Push the robot as the sliders show."""
        size = clipped(self._size.value, 0.0, MOST_PUSH * self._push_scale)
        self._page.push(size, clipped(self._direction.value, -180.0, 180.0))

    def _set_speed(self) -> None:
        """Let time pass at the chosen speed."""
        self._page.set_speed(SPEEDS.get(self._speed.value, 1.0))

    def _choose(self) -> None:
        """Ask for the chosen robot and gait."""
        if not self._fitting:
            self._page.choose(self._robot.value, self._gait.value)


def with_names(names: tuple[str, ...], further: Sequence[str]) -> tuple[str, ...]:
    """Names, and further ones that are not among them."""
    return tuple(dict.fromkeys((*names, *further)))
