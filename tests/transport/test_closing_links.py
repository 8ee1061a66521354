"""Closing a link while another thread may use its descriptor, whose number must not belong to another file meanwhile."""

from __future__ import annotations

import gc
import os
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

import orinkit
from orinkit import functions as f
from orinkit.client._sync.client import Client
from orinkit.core.errors import ConnectionClosed
from orinkit.transport.sockets import socket_link
from orinkit.transport.sockets.socket_link import SocketLink
from support.waiting import PATIENCE

pytestmark = pytest.mark.skipif(os.name == "nt", reason="on Windows, only closing a socket ends a receive")


class Guarded:
    """A link of a client, the socket of the peer, and the lock that a thread holds during a call."""

    def __init__(self) -> None:
        ours, self.peer = socket.socketpair()
        self.peer.settimeout(PATIENCE)
        self.number = ours.fileno()
        self.link = SocketLink(ours)
        self.client = Client(self.link, timeout=PATIENCE)
        self.lock = self.client._lock

    @property
    def is_open(self) -> bool:
        """True if the descriptor has not been closed."""
        try:
            os.fstat(self.number)
        except OSError:
            return False
        return True

    def require_end_of_stream(self) -> None:
        """Fail unless the peer receives the end of the stream."""
        assert self.peer.recv(1) == b""


@pytest.fixture
def guarded() -> Iterator[Guarded]:
    guarded = Guarded()
    yield guarded
    guarded.client.close()
    guarded.peer.close()


@contextmanager
def in_thread(function: Callable[[], None]) -> Iterator[threading.Thread]:
    """Run a function in another thread, and wait for its end."""
    thread = threading.Thread(target=function)
    thread.start()
    try:
        yield thread
    finally:
        thread.join(PATIENCE)
    assert not thread.is_alive()


def test_the_descriptor_is_closed_after_the_call_of_another_thread(guarded, monkeypatch):
    monkeypatch.setattr(socket_link, "_ENDING", PATIENCE)
    guarded.lock.acquire()  # a call is in progress
    with in_thread(guarded.client.close) as closing:
        try:
            guarded.require_end_of_stream()  # the connection ends at once
            closing.join(0.05)
            assert closing.is_alive()
            assert guarded.is_open
        finally:
            guarded.lock.release()
    assert not guarded.is_open


def test_a_call_in_another_thread_does_not_keep_the_descriptor_for_ever(monkeypatch):
    """The thread of the call has a reference to the link; afterwards, nothing uses the descriptor."""
    monkeypatch.setattr(socket_link, "_ENDING", 0.01)
    guarded = Guarded()
    with guarded.peer, guarded.lock:
        with in_thread(guarded.client.close):
            guarded.require_end_of_stream()
        assert guarded.is_open
        del guarded.link, guarded.client
        gc.collect()
        assert not guarded.is_open


def test_the_thread_of_the_call_closes_at_once(guarded):
    with guarded.lock:
        guarded.client.close()
        assert not guarded.is_open


def test_a_link_without_a_client_is_closed_at_once():
    ours, peer = socket.socketpair()
    with peer:
        link = SocketLink(ours)
        link.close()
        assert peer.recv(1) == b""
        assert ours.fileno() == -1


def test_closing_ends_the_call_of_another_thread(guarded):
    errors: list[Exception] = []

    def call() -> None:
        try:
            guarded.client.call(f.controller_get_name, 1)
        except ConnectionClosed as error:
            errors.append(error)

    with in_thread(call):
        assert guarded.peer.recv(4096)  # the call waits for its reply
        guarded.client.close()
    assert len(errors) == 1
    assert not guarded.is_open


def test_closing_does_not_wait_for_a_call_over_udp(monkeypatch):
    """The call ends with its time-out: the shutdown of a datagram socket does not end it."""
    monkeypatch.setattr(socket_link, "_ENDING", 2 * PATIENCE)
    with socket.socket(type=socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        client = orinkit.open_client(f"udp://127.0.0.1:{peer.getsockname()[1]}")
        with client._lock, in_thread(client.close):
            pass
