"""The page's server: on this machine only, and only for its own pages.

viser serves the page and keeps it up to date over a websocket. Its other services are switched off:
a tunnel to the internet, which any page could ask for, and websockets for pages of other sites,
which a browser would open on their behalf. Messages from a page hold numbers and names, nothing
that is executed. Read `browser` next.
"""

from __future__ import annotations

import io
import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from functools import partial
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import viser

HOST = "127.0.0.1"
"""The page can be reached from this machine only."""
OWN_PAGES = re.compile(r"http://(127\.0\.0\.1|localhost)(:\d+)?")
"""The origins of pages that may open a websocket."""


def open_server(port: int) -> viser.ViserServer:
    """Start a server for pages on this machine.

    Args:
        port: The port; if it is taken, the next free one is used. 0 takes any.

    Raises:
        ImportError: viser is missing.
    """
    try:
        import viser
    except ImportError as error:
        message = f"the page needs viser, which is missing ({error}): pip install 'surefoot[viz]'"
        raise ImportError(message) from error

    class LocalServer(viser.ViserServer):
        """A server that cannot be reached from outside."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            """Refuse what a page may ask for: a tunnel through which anybody could reach it."""
            return None

    # Browsers open connections that they do not use; each would be reported as a failure.
    logging.getLogger("websockets.server").setLevel(logging.CRITICAL)
    with _own_pages_only(), redirect_stdout(io.StringIO()):  # it prints a table of addresses
        server = LocalServer(host=HOST, port=port, label="surefoot", verbose=False)
    server.gui.configure_theme(
        show_logo=False, show_share_button=False, control_width="medium", brand_color=(0, 114, 178)
    )
    server.gui.main_panel.dock_right()
    return server


def address_of(server: viser.ViserServer) -> str:
    """The address of a server's page."""
    return f"http://{HOST}:{server.get_port()}"


@contextmanager
def _own_pages_only() -> Iterator[None]:
    """Make servers that start meanwhile refuse websockets for pages of other sites.

    viser passes on no origins, but websockets would check them. Programs other than browsers send
    none.
    """
    from websockets.asyncio import server

    serve = server.serve
    server.serve = partial(serve, origins=[None, OWN_PAGES])
    try:
        yield
    finally:
        server.serve = serve
