"""Who can reach the page: this machine, and pages of its own."""

import logging
import socket

import pytest

from tests.fakes.chromium import needs_viser

pytestmark = needs_viser


@pytest.fixture
def server():
    from surefoot.viz.browser_server import open_server

    server = open_server(0)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    yield server
    server.stop()


def opened(server, origin) -> bool:
    """Whether a page of this origin may open a websocket."""
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    protocol = Subprotocol(f"viser-v{viser.__version__}")
    try:
        address = f"ws://127.0.0.1:{server.get_port()}"
        with connect(address, origin=origin, subprotocols=[protocol]):
            return True
    except InvalidStatus as refusal:
        assert refusal.response.status_code == 403
        return False


def test_the_server_listens_on_loopback_only(server):
    from surefoot.viz.browser_server import address_of

    assert server.get_host() == "127.0.0.1"
    assert address_of(server) == f"http://127.0.0.1:{server.get_port()}"
    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None)}
    for address in others:
        if not str(address).startswith("127.") and ":" not in str(address):
            with pytest.raises(OSError):
                socket.create_connection((str(address), server.get_port()), timeout=2).close()


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_its_own_page_may_open_a_websocket(server, host):
    assert opened(server, f"http://{host}:{server.get_port()}")


@pytest.mark.parametrize(
    "origin",
    ["https://example.com", "http://localhost.example.com", "http://127.0.0.1.example.com", "null"],
)
def test_pages_of_other_sites_may_not(server, origin):
    assert not opened(server, origin)


def test_nobody_gets_a_tunnel(server):
    assert server.request_share_url() is None


def test_other_servers_of_the_program_are_left_alone(server):
    from websockets.asyncio import server as websockets_server

    assert isinstance(websockets_server.serve, type)
