"""A real browser without a screen, driven as a person would: it looks, clicks and presses keys.

Chromium is spoken to by its own protocol over a websocket; nothing but Chromium itself is needed.
"""

from __future__ import annotations

import base64
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import time
import urllib.request
from pathlib import Path
from typing import Any

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
EXECUTABLE = next(filter(None, map(shutil.which, NAMES)), None)
needs_viser = pytest.mark.skipif(
    importlib.util.find_spec("viser") is None, reason="viser is an optional extra"
)
OPTIONS = (
    "--headless=new",
    "--no-sandbox",
    "--remote-debugging-port=0",
    "--hide-scrollbars",
    "--window-size=1180,860",
    # WebGL without a GPU
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
)
PATIENCE = 400.0
"""[s] The machine may be busy."""
FIND = """
(() => {
  const innermost = [...document.body.querySelectorAll("*")].reverse();
  const matches = (each) => each.textContent.trim() === TEXT || each.value === TEXT;
  const found = innermost.find((each) => matches(each) && each.offsetParent);
  if (!found) return null;
  found.scrollIntoView({block: "center"});
  const box = found.getBoundingClientRect();
  const point = [box.x + box.width / 2, box.y + box.height / 2];
  return found.contains(document.elementFromPoint(...point)) ? point : null;
})()
"""
"""Where the innermost element with this text is; nothing if another one would get the click."""


def needs_chromium(test: Any) -> Any:
    """Mark a test of a page in Chromium: `make test-pages` runs it, or skips it without one."""
    reason = "there is no Chromium: `make system` installs it on Debian"
    return pytest.mark.page(pytest.mark.skipif(EXECUTABLE is None, reason=reason)(test))


class Chromium:
    """A browser with one page; a context manager that closes it."""

    def __init__(self, address: str, profile: Path) -> None:
        from websockets.sync.client import connect

        self._log = profile / "log"
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [str(EXECUTABLE), *OPTIONS, f"--user-data-dir={profile}", address],
                stderr=log,
                stdout=subprocess.DEVNULL,
                start_new_session=True,
            )
        self._count = 0
        try:
            port = self._port(profile / "DevToolsActivePort")
            self._socket = connect(self._page(port), max_size=None)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Chromium:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        os.killpg(self._process.pid, signal.SIGKILL)  # with the processes that it has started
        self._process.wait()

    def _port(self, file: Path) -> int:
        return int(wait(lambda: file.exists() and file.read_text().splitlines())[0])

    def _page(self, port: int) -> str:
        def find() -> str | None:
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/json") as answer:
                pages = [page for page in json.load(answer) if page["type"] == "page"]
            return pages[0]["webSocketDebuggerUrl"] if pages else None

        return wait(find)

    def _ask(self, method: str, **parameters: object) -> Any:
        self._count += 1
        message = {"id": self._count, "method": method, "params": parameters}
        self._socket.send(json.dumps(message))
        while True:
            answer = json.loads(self._socket.recv(timeout=PATIENCE))
            if answer.get("id") == self._count:
                assert "error" not in answer, answer
                return answer["result"]

    def evaluate(self, script: str) -> Any:
        """The value of a JavaScript expression in the page."""
        answer = self._ask("Runtime.evaluate", expression=script, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def text(self) -> str:
        """All that can be read in the page."""
        return self.evaluate("document.body?.innerText ?? ''")

    def wait_for(self, *texts: str) -> str:
        """Wait until all of these can be read; the whole text then."""
        return wait(lambda: (text := self.text()) and all(part in text for part in texts) and text)

    def click(self, text: str) -> None:
        """Click with the mouse on the button, tab or choice or field with this text."""
        x, y = wait(lambda: self._resting_place(text))
        for kind in ("mousePressed", "mouseReleased"):
            self._ask("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def _resting_place(self, text: str) -> list[float] | None:
        """Where the element with this text is, if it does not move: a page is laid out in steps."""
        script = FIND.replace("TEXT", json.dumps(text))
        before = self.evaluate(script)
        time.sleep(0.3)
        return before if before == self.evaluate(script) else None

    def press(self, key: str) -> None:
        """Press a letter, with nothing selected."""
        self.evaluate("document.activeElement.blur()")
        code = {"key": key.lower(), "code": f"Key{key}", "windowsVirtualKeyCode": ord(key)}
        self._ask("Input.dispatchKeyEvent", type="keyDown", text=key.lower(), **code)
        self._ask("Input.dispatchKeyEvent", type="keyUp", **code)

    def screenshot(self, path: Path) -> Path:
        """A picture of the page as a PNG."""
        picture = self._ask("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(picture["data"]))
        return path


def wait(condition: Any, seconds: float = PATIENCE) -> Any:
    """Ask until the answer is true, and return it."""
    end = time.monotonic() + seconds
    while True:
        if answer := condition():
            return answer
        assert time.monotonic() < end, f"nothing after {seconds} s"
        time.sleep(0.1)
