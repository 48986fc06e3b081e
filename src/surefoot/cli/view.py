"""The command view: drive a robot in the browser, push it, and look at a run's episodes."""

from __future__ import annotations

import os
import sys
import webbrowser
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from surefoot.cli.options import OnSimulator, check_port


@dataclass(frozen=True)
class View(OnSimulator):
    """Drive a robot in the browser: how it walks, who drives, pushes; and scrub a run's episodes.

    The page can be reached from this machine only. It needs the extra viz: pip install
    'surefoot[viz]'. Ctrl-C ends it.
    """

    target: Annotated[Path | None, tyro.conf.Positional] = None
    """The folder of a run, of which the best policy drives, or a policy file; without either, the
    policy that comes with the package drives."""
    robot: str | None = None
    """The robot: the name of one of the package, or a JSON or TOML file with one of your own;
    without it, the policy's own, or Solo12. The expert drives another one than the policy's."""
    gait: str | None = None
    """The gait to begin in: trot, walk, crawl, amble, pace, bound, pronk or stand; without it, the
    policy's first one, or the trot. The expert drives in one that the policy does not walk."""
    port: int = 8080
    """The port of the page; if it is taken, the next one that is free. 0 takes any."""
    browser: bool = True
    """Open the page in the browser, where there is a screen."""

    def __call__(self) -> int:
        """Show the page until it is interrupted.

        Raises:
            RuntimeError: The page's thread has ended with an error.
        """
        from surefoot.viz.browser import Page
        from surefoot.viz.live_setup import find_setup

        check_port(self.port)
        setup = find_setup(self.target, self.robot, self.gait)
        setup = replace(setup, config=self.simulated(setup.config))
        run = self.target if self.target is not None and self.target.is_dir() else None
        page = Page(setup, run, self.port)
        if self.port and not page.address.endswith(f":{self.port}"):
            print(f"the port {self.port} is taken, so another one is used", file=sys.stderr)
        print(f"{page.address} (Ctrl-C ends it)", flush=True)
        if self.browser and has_screen():
            webbrowser.open(page.address)
        try:
            page.loop.wait()
            # Nothing but an error ends the thread before the page is closed.
            raise RuntimeError(f"the page has stopped: {page.loop.failure}")
        except KeyboardInterrupt:
            return 0
        finally:
            page.close()


def has_screen() -> bool:
    """Whether a browser has a screen here; without one, it might take over the terminal."""
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
