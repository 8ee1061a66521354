"""The reasons in the exceptions of links: facts for users, without numbers of the operating system."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterator

import pytest

import orinkit
from orinkit import aio
from orinkit.core.errors import ConnectFailed, ConnectionLost
from orinkit.transport.link_errors import connect_failed, lost

ADDRESS = "tcp://10.0.0.1:5007"


@pytest.fixture
def unused() -> Iterator[int]:
    """A port on which no program listens, and which no other program gets meanwhile."""
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        yield bound.getsockname()[1]


async def connect(url: str) -> None:
    await aio.connect(url)


def check_refused(error: ConnectFailed, url: str) -> None:
    assert f"{error}".startswith(f"cannot connect to {url}")
    assert ": no program listens at this address. Try: check the address" in f"{error}"


@pytest.mark.parametrize("scheme", ["tcp", "http"])
def test_a_refused_connection_is_stated_as_a_fact_with_a_remedy(unused: int, scheme: str) -> None:
    url = f"{scheme}://127.0.0.1:{unused}"
    with pytest.raises(ConnectFailed) as sync:
        orinkit.connect(url)
    check_refused(sync.value, url)
    with pytest.raises(ConnectFailed) as asynchronous:
        asyncio.run(connect(url))
    check_refused(asynchronous.value, url)


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused"), "no program listens at this address"),
        (TimeoutError(), "the peer does not respond"),
        (OSError(errno.ETIMEDOUT, "x"), "the peer does not respond"),
        (OSError(errno.EHOSTUNREACH, "x"), "the peer cannot be reached"),
        (OSError(errno.ENETUNREACH, "x"), "the network of the peer cannot be reached"),
        (socket.gaierror(socket.EAI_NONAME, "Name or service not known"), "the host name is unknown"),
        (socket.gaierror(socket.EAI_AGAIN, "Temporary failure"), "Temporary failure"),
        (OSError(errno.EACCES, "x"), "Permission denied"),
        (
            OSError("Multiple exceptions: [Errno 111] a ('::1', 1), [Errno 111] b ('127.0.0.1', 1)"),
            "no program listens",
        ),
        (OSError("Multiple exceptions: [Errno 111] a, [Errno 101] b"), "Multiple exceptions"),
        (ValueError("embedded null"), "embedded null"),
        (OSError(), "OSError"),
    ],
)
def test_a_link_that_cannot_be_opened_has_a_reason(error: Exception, reason: str) -> None:
    assert f"cannot connect to {ADDRESS}: {reason}" in f"{connect_failed(ADDRESS, error)}"


def test_the_reason_of_a_lost_connection_has_no_number() -> None:
    assert (
        f"{lost(ConnectionResetError(errno.ECONNRESET, 'x'))}" == "connection lost: the peer has reset the connection"
    )
    assert f"{lost(BrokenPipeError(errno.EPIPE, 'x'))}" == "connection lost: the peer has closed the connection"
    assert f"{lost(ConnectionLost('it is away'))}" == "connection lost: it is away"
