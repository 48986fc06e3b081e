"""The page: a robot that is driven in the browser, or an episode of a run that is scrubbed.

`Page` puts scene, instruments, controls and episodes together; everything that touches the
simulation runs in the thread of its `LiveLoop`. The simulation and the recordings do not depend on
the page: read `live` and `playback` for them, and `browser_server` for who can reach the page.
"""

from __future__ import annotations

from pathlib import Path

from surefoot.robots.scaling import size_of
from surefoot.types import Command
from surefoot.viz.browser_controls import Controls
from surefoot.viz.browser_episodes import EpisodeList
from surefoot.viz.browser_panels import Instruments, failure_html, gait_text, status_html
from surefoot.viz.browser_scene import RobotScene
from surefoot.viz.browser_server import address_of, open_server
from surefoot.viz.live import DriverName, LiveSimulation
from surefoot.viz.live_loop import LiveLoop
from surefoot.viz.live_setup import LiveSetup, start, with_choice
from surefoot.viz.playback import Playback, open_episode

PICTURES_PER_READING = 4
"""The instruments are updated in every fourth picture, six times a second."""


class Page:
    """A page with a simulation, and the episodes of a run if there is one.

    Args:
        setup: What is driven first.
        run: Folder of the run whose episodes can be opened; None if there is no run.
        port: The port of the server; 0 takes any.

    Attributes:
        address: The address of the page.
        live: The simulation; only the loop's own thread may use it.
        loop: The thread in which time passes.

    Raises:
        ImportError: viser, or the physics engine, is missing.
        RunError: There is no such run.
        ValueError: The run has collected nothing yet.
    """

    def __init__(self, setup: LiveSetup, run: Path | None = None, port: int = 8080) -> None:
        self._first = setup
        self._setup = setup
        self._run = run
        self._busy = ""
        self._error = ""
        self._episode = 0
        self._pictures = 0
        self.live: LiveSimulation = start(setup)
        self._server = open_server(port)
        self.address = address_of(self._server)
        self._instruments = Instruments(self._server)
        self._controls, self._episodes = self._add_controls()
        self._scene = RobotScene(self._server, self.live.robot)
        self._scene.look()
        self.loop = LiveLoop(self.live, self._draw, self._report, self._fail)
        self._show_choice()
        self._fit()
        self.loop.start()

    def _add_controls(self) -> tuple[Controls, EpisodeList | None]:
        """Add the controls, with a separate tab for the episodes of a run."""
        controls = Controls(self._server, self)
        if self._run is None:
            controls.add_driving()
            return controls, None
        tabs = self._server.gui.add_tab_group()
        with tabs.add_tab("Simulation"):
            controls.add_driving()
        with tabs.add_tab("Episodes"):
            episodes = EpisodeList(self._server, self._run, self)
        return controls, episodes

    def close(self) -> None:
        """Stop the simulation and the server."""
        self.loop.stop()
        self._server.stop()

    def tell(self, command: Command) -> None:
        """Tell the robot how to walk."""
        self.loop.call(lambda: self.live.set_command(command))

    def let_drive(self, driver: DriverName) -> None:
        """Choose who drives."""
        self.loop.call(lambda: self.live.set_driver(driver))

    def push(self, size: float, direction: float) -> None:
        """Push the robot with an impulse [N s] in a direction [deg]."""
        self.loop.call(lambda: self.live.push(size, direction))

    def pause(self) -> None:
        """Stop time, or let it pass again."""
        self.loop.call(self._pause)

    def _pause(self) -> None:
        self.loop.paused = not self.loop.paused

    def set_speed(self, speed: float) -> None:
        """Set how much time passes per time on the clock."""
        self.loop.call(lambda: self._set_speed(speed))

    def _set_speed(self, speed: float) -> None:
        self.loop.pace.speed = speed

    def reset(self) -> None:
        """Begin again: the simulation from standing, an episode from its first tick."""
        self.loop.call(self._reset)

    def _reset(self) -> None:
        self._error = ""
        self.loop.paused = False
        if isinstance(self.loop.source, Playback):
            self.loop.source.seek(0)
        else:
            self.live.reset()

    def choose(self, robot: str, gait: str) -> None:
        """Ask for another gait, or begin again with another robot; this may take seconds."""
        self.loop.call(lambda: self._choose(robot, gait))

    def _choose(self, robot: str, gait: str) -> None:
        setup = self._setup
        if robot != setup.robot or gait not in setup.gaits:
            self._show_busy(f"measuring the command gains of {robot} in a {gait} ...")
        try:
            self._drive(with_choice(self._first, setup, robot, gait))
        finally:
            self._busy = ""
            self._show_choice()

    def _drive(self, setup: LiveSetup) -> None:
        """Drive what was chosen; a robot that can walk on does, and begins the gait when it can."""
        before = self._setup
        known = setup.config is before.config
        # A robot that has fallen begins again from standing.
        goes_on = known or (setup.extends(before) and not self.live.snapshot().ended)
        if not known:
            live = start(setup)
            if goes_on:
                live.go_on_from(self.live)
            self.live = live
        self._setup = setup
        self._error = ""
        if self.loop.source is not self.live:
            self._show_live()
        if goes_on:
            self.live.set_gait(setup.begin)
        else:
            self._fit()

    def _show_choice(self) -> None:
        """Make the controls show which robot is driven, and which gait was asked for."""
        setup = self._setup
        gait = setup.gaits[self.live.asked_gait]
        self._controls.show_choice(setup.robot, gait, setup.gaits)

    def open_episode(self, episode: int) -> None:
        """Show an episode of the run, which takes seconds to play out again."""
        self.loop.call(lambda: self._open_episode(episode))

    def _open_episode(self, episode: int) -> None:
        if self._run is None:
            return
        self._show_busy(f"episode {episode} is played out again ...")
        try:
            playback = open_episode(self._run, episode)
        finally:
            self._busy = ""
        self._episode = episode
        self._error = ""
        self.loop.source = playback
        self.loop.paused = False
        self._draw_robot(playback)

    def seek(self, tick: int) -> None:
        """Show another tick of the episode [ms]."""
        self.loop.call(lambda: self._seek(tick))

    def _seek(self, tick: int) -> None:
        if isinstance(self.loop.source, Playback):
            self.loop.paused = True
            self.loop.source.seek(tick)

    def go_live(self) -> None:
        """Show the simulation again."""
        self.loop.call(self._show_live)

    def _show_live(self) -> None:
        self._error = ""
        self.loop.source = self.live
        self.loop.paused = False
        self._draw_robot(self.live)

    def _draw_robot(self, source: LiveSimulation | Playback) -> None:
        """Draw the robot of a source, if it is a different one, and fit the charts to its range."""
        if source.robot.name != self._scene.robot.name:
            self._instruments.fit(size_of(source.robot).com_height)
            self._server.scene.reset()
            self._scene = RobotScene(self._server, source.robot)
            self._scene.look()

    def _fit(self) -> None:
        """Fit controls and charts to what is driven, and set the driver and command they show."""
        size = size_of(self.live.robot)
        self._instruments.fit(size.com_height)
        # This push makes robots of all sizes equally fast relative to their size.
        push_scale = size.mass_ratio * size.length_ratio**0.5
        self._controls.fit(self.live.drivers, self._setup.commands, push_scale)
        self.live.set_driver(self.live.drivers[0])
        self.live.set_command(self._controls.command)

    def _report(self, error: str) -> None:
        """Show the error of a call that was asked for; other notes may follow its period."""
        self._error = f"{error.rstrip('.')}."

    def _fail(self, error: str) -> None:
        """Show the error that ended the thread; the source itself may be broken."""
        self._instruments.say(failure_html(error))

    def _show_busy(self, text: str) -> None:
        """Say what takes so long; nothing else is drawn meanwhile."""
        self._busy = text
        self._say()

    def _draw(self) -> None:
        """Show the source: the scene in every picture, the instruments in some."""
        source = self.loop.source
        self._scene.show(source.snapshot())
        self._pictures += 1
        if self._pictures % PICTURES_PER_READING:
            return
        self._instruments.show(source.snapshot(), source.trace)
        self._say()
        if self._episodes is not None:
            self._episodes.show(source if isinstance(source, Playback) else None)

    def _say(self) -> None:
        """Show who drives what, and any notes."""
        source = self.loop.source
        snapshot = source.snapshot()
        notes = [self._busy, self._error]
        if isinstance(source, Playback):
            title = f"episode {self._episode}"
            gait = ""
        else:
            title = self._setup.title
            gait = gait_text(snapshot, self._setup.gaits)
            notes.extend(self._setup.notes)
        speed = 0.0 if self.loop.paused else self.loop.pace.speed
        self._instruments.say(
            status_html(
                snapshot,
                title,
                None if source.over else speed,
                self.loop.pace.rate,
                " ".join(filter(None, notes)),
                gait,
            )
        )
