"""The exchange of one call in C: the same outcome as in Python for any reply and any value, signals, and the socket."""

from __future__ import annotations

import signal
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from math import inf, nan
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit import functions as f
from orinkit.bcap.client import BcapConversation
from orinkit.cao.table import Function
from orinkit.core.errors import ConnectionClosed, ConnectionLost
from orinkit.core.speedups import EXTENSION, PURE
from orinkit.transport import direct
from orinkit.transport.direct import Unfinished
from orinkit.transport.sockets.socket_link import SocketLink
from orinkit.values import codec
from orinkit.values.codec import DEFAULT_LIMITS, PacketLimits
from support.speedups import alike, needs_extension, outcome
from support.strategies import variants

pytestmark = [
    needs_extension,
    pytest.mark.skipif(not hasattr(EXTENSION, "call"), reason="the exchange in C is for Linux only"),
]
PATIENT = 20.0
POSE = [0.125, 45.0, 90.0, 0.25, 45.0, 0.5, 0.0, 0.0]
FUNCTIONS = [f.robot_execute, f.variable_get_value, f.variable_get_name, f.variable_get_id, f.variable_put_value]


class Pair:
    """A link, its conversation, and the socket of the peer."""

    def __init__(self, limits: PacketLimits = DEFAULT_LIMITS, kind: type[SocketLink] = SocketLink) -> None:
        ours, self.peer = socket.socketpair()
        self.link = kind(ours)
        self.conversation = BcapConversation(limits)

    def call(self, name: str, function: Function[..., Any], arguments: tuple[Any, ...], *, exact: bool = False) -> Any:
        call = direct.call if name == "C" else PURE["call"]
        return call(self.conversation, self.link, function, arguments, PATIENT, exact)

    def call_prepared(self, value: Any, seconds: float = PATIENT) -> Any:
        template = self.conversation.template(f.robot_execute, (5, "slvMove"))
        assert template is not None
        assert template.native is not None
        return direct.call_prepared(self.conversation, self.link, f.robot_execute, template, value, seconds)

    def close(self) -> None:
        self.link.close()
        self.peer.close()


@pytest.fixture
def pair() -> Iterator[Pair]:
    pair = Pair()
    yield pair
    pair.close()


def packet(body: bytes, count: int, serial: int = 1, code: int = 0) -> bytes:
    return struct.pack("<BIHHIH", 1, len(body) + 16, serial, 0, code, count) + body + b"\4"


def arguments_of(function: Function[..., Any]) -> tuple[Any, ...]:
    return (5, "slvMove", POSE) if function is f.robot_execute else (5, 1)[: len(function.arguments)]


def outcome_of(
    name: str, function: Function[..., Any], reply: bytes, *, exact: bool, limits: PacketLimits = DEFAULT_LIMITS
) -> tuple[Any, ...]:
    """Call a function whose reply has already arrived; return everything that can be observed."""
    pair = Pair(limits)
    try:
        pair.peer.sendall(reply)
        if not reply:
            pair.peer.shutdown(socket.SHUT_WR)
        before = time.monotonic()
        found = outcome(lambda: pair.call(name, function, arguments_of(function), exact=exact))
        if isinstance(found[1], Unfinished):
            assert before + PATIENT <= found[1].end <= time.monotonic() + PATIENT
            found = ("unfinished", found[1].serial, found[1].received)
        conversation = pair.conversation
        return (*found, pair.peer.recv(65536), conversation.serial, conversation.stray_replies, conversation.direct)
    finally:
        pair.close()


def check_same_reply(
    function: Function[..., Any], reply: bytes, *, exact: bool = False, limits: PacketLimits = DEFAULT_LIMITS
) -> None:
    native, pure = (outcome_of(name, function, reply, exact=exact, limits=limits) for name in ("C", "pure"))
    assert alike(native, pure), f"{function.name}, {reply.hex()}: {native}, in Python: {pure}"


@given(st.sampled_from(FUNCTIONS), variants(), st.booleans())
def test_any_result_is_read_alike(function, item, exact):
    check_same_reply(function, packet(codec.encode(item), 1), exact=exact)


@given(st.sampled_from(FUNCTIONS), variants(), st.data())
def test_a_damaged_reply_is_treated_alike(function, item, data):
    reply = bytearray(packet(codec.encode(item), data.draw(st.integers(0, 2)), data.draw(st.integers(0, 2))))
    for _ in range(data.draw(st.integers(0, 2))):
        reply[data.draw(st.integers(0, len(reply) - 1))] = data.draw(st.integers(0, 255))
    behind = data.draw(st.sampled_from([b"", b"", b"\1", bytes(reply)]))
    check_same_reply(function, bytes(reply)[: data.draw(st.integers(0, len(reply)))] + behind)


@given(st.sampled_from(FUNCTIONS), st.binary(max_size=60))
def test_any_received_bytes_are_treated_alike(function, reply):
    check_same_reply(function, reply)


@pytest.mark.parametrize("code", [0, 1, 0x900, 0x7FFFFFFF, 0x80000000, 0x80004005, 0xFFFFFFFF], ids=hex)
@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.name)
def test_any_return_code_is_treated_alike(function, code):
    for body, count in ((b"", 0), (codec.encode(7), 1), (codec.encode("a"), 1), (codec.encode(None), 1)):
        check_same_reply(function, packet(body, count, code=code))


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda function: function.name)
@pytest.mark.parametrize("limit", [139, 140, 141, 150, 159, 160])
def test_the_limit_of_a_packet_applies_alike(function, limit):
    """A packet may exceed the limit although its argument does not."""
    for body in (bytes(134), "x" * 65, [0.5] * 16, [0.5] * 17):
        reply = packet(codec.encode(body), 1)
        assert 154 <= len(reply) <= 162
        check_same_reply(function, reply, limits=PacketLimits(packet=limit))


@pytest.mark.parametrize("limits", [PacketLimits(variants=0), PacketLimits(depth=0), PacketLimits(variants=-(2**63))])
def test_the_limits_of_values_apply_alike(limits):
    for value in ("a", ["a"], [1] * 16, [[1]], [1.0] * 20, 5):
        check_same_reply(f.variable_get_value, packet(codec.encode(value), 1), limits=limits)


def test_a_reply_larger_than_the_buffer():
    for size in (8150, 8166, 8167, 8180, 16_000, 100_000):
        native, _ = (outcome_of(name, f.variable_get_value, packet(codec.encode(bytes(size)), 1), exact=False)
                     for name in ("C", "pure"))  # fmt: skip
        assert native[0] == ("result" if size + 26 <= 8192 else "unfinished")


@given(
    st.one_of(
        st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=50), st.binary(max_size=50),
        st.lists(st.one_of(st.floats(), st.integers(), st.text(max_size=5), st.none(), st.lists(st.floats())), max_size=9),
        variants(),
    )
)  # fmt: skip
def test_the_request_of_a_prepared_call_is_that_of_any_call(value):
    pair = Pair()
    try:
        pair.peer.sendall(packet(b"", 0))
        if pair.call_prepared(value) is None:
            assert pair.conversation.serial == 1  # no serial was used
            pair.peer.setblocking(False)
            with pytest.raises(BlockingIOError):  # nothing was sent
                pair.peer.recv(65536)
            return
        _, expected = BcapConversation().begin(f.robot_execute, (5, "slvMove", value))
        assert pair.peer.recv(65536) == expected
    finally:
        pair.close()


def test_the_serial_wraps(pair):
    for serial, following in ((0xFFFE, 0xFFFF), (0xFFFF, 1)):
        pair.conversation.serial = serial
        pair.peer.sendall(packet(codec.encode(POSE), 1, serial))
        assert pair.call_prepared(POSE) == (0, POSE)
        assert pair.conversation.serial == following


def test_all_paths_use_the_socket_in_turn(pair):
    """The modes of the socket differ: blocking with time-outs of the system, and non-blocking."""
    for _ in range(3):
        pair.peer.sendall(packet(codec.encode(1), 1, pair.conversation.serial))
        assert pair.call_prepared(None) == (0, 1)
        pair.peer.sendall(packet(codec.encode(2), 1, pair.conversation.serial))
        assert pair.call("pure", f.variable_get_value, (5,)) == (0, 2)
        pair.link.send(b"x", PATIENT)
        assert pair.link.receive(0.01) is None
        pair.peer.sendall(b"y")
        assert pair.link.receive(PATIENT) == b"y"


def test_other_threads_run_during_the_wait(pair):
    def answer() -> None:
        pair.peer.recv(65536)
        pair.peer.sendall(packet(codec.encode(POSE), 1))

    thread = threading.Thread(target=answer)
    thread.start()
    try:
        assert pair.call_prepared(POSE) == (0, POSE)
    finally:
        thread.join()


@pytest.mark.parametrize("blocking", [True, False])
def test_a_time_out(pair, blocking):
    """Another process that shares the socket may have changed its mode."""
    pair.peer.sendall(packet(codec.encode(POSE), 1))
    pair.call_prepared(POSE, 0.2)
    pair.link._socket.setblocking(blocking)
    begin = time.monotonic()
    outcome = pair.call_prepared(POSE, 0.2)
    assert outcome == Unfinished(2, None, outcome.end)
    assert begin + 0.2 <= outcome.end <= time.monotonic()


@pytest.fixture
def every_10_ms() -> Iterator[Callable[[Callable[[], None]], None]]:
    """Return a function that sets the handler of a signal that this thread receives every 10 ms."""
    before = signal.getsignal(signal.SIGALRM)

    def start(handler: Callable[[], None]) -> None:
        signal.signal(signal.SIGALRM, lambda *_: handler())
        signal.setitimer(signal.ITIMER_REAL, 0.01, 0.01)

    yield start
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, before)


def test_signals_do_not_prolong_the_time_out(pair, every_10_ms):
    """If a signal began the wait again, this test would never end."""
    calls: list[float] = []
    every_10_ms(lambda: calls.append(time.monotonic()))
    outcome = pair.call_prepared(POSE, 0.3)
    assert outcome.received is None
    assert [moment for moment in calls if moment < outcome.end]  # the handlers were run during the wait


def test_the_reply_is_received_after_signals(pair, every_10_ms):
    calls: list[int] = []

    def handler() -> None:
        calls.append(1)
        if len(calls) == 5:
            pair.peer.sendall(packet(codec.encode(POSE), 1))

    every_10_ms(handler)
    assert pair.call_prepared(POSE) == (0, POSE)


def test_an_exception_of_a_signal_handler_ends_the_wait(pair, every_10_ms):
    def handler() -> None:
        if pair.conversation.serial == 1:  # the signal is earlier than the call
            return
        signal.setitimer(signal.ITIMER_REAL, 0)
        raise KeyboardInterrupt

    every_10_ms(handler)
    with pytest.raises(KeyboardInterrupt):
        pair.call_prepared(POSE)
    assert pair.conversation.serial == 2  # so that the client closes the link: received bytes may be lost


class SignalledLink(SocketLink):
    """A link that is closed, by another thread as it were, during the wait after a signal."""

    reads = 0
    _number = -1

    @property
    def descriptor(self) -> int:  # type: ignore[override]  # as in the class that it replaces
        self.reads += 1
        return self._number if self.reads < 3 else -1

    @descriptor.setter
    def descriptor(self, number: int) -> None:
        self._number = number


def test_a_descriptor_that_is_closed_during_the_wait_after_a_signal_is_not_read(every_10_ms):
    """The number may belong to another connection, whose data must not be lost."""
    pair = Pair(kind=SignalledLink)

    def handler() -> None:
        if pair.conversation.serial == 1:  # the signal is earlier than the call
            return
        signal.setitimer(signal.ITIMER_REAL, 0)
        pair.peer.sendall(b"of another connection")

    pair.link.use_kernel_timeout(PATIENT)
    every_10_ms(handler)
    try:
        with pytest.raises(ConnectionLost, match="Bad file descriptor"):
            pair.call_prepared(POSE)
        assert pair.link.reads == 3
        assert pair.link._number == -1  # closed
    finally:
        pair.close()


def fill(link: SocketLink) -> int:
    """Send until the peer, which does not read, can receive nothing more; return the number of bytes."""
    filled = 0
    link._socket.setblocking(False)
    try:
        while True:
            filled += link._socket.send(bytes(1000))
    except BlockingIOError:
        return filled


class ImpatientLink(SocketLink):
    """A link that does not send the rest of a request."""

    def finish_exchange(self, data: bytes, seconds: float, start: int) -> bytes | None:
        raise InterruptedError(start)


def test_the_send_does_not_wait_before_python_sends_the_rest():
    """Otherwise, a call would take twice its time-out."""
    pair = Pair(kind=ImpatientLink)
    try:
        fill(pair.link)
        begin = time.monotonic()
        with pytest.raises(InterruptedError, match="0"):
            pair.call_prepared(POSE)
        assert time.monotonic() - begin < PATIENT
    finally:
        pair.close()


@pytest.mark.parametrize("seconds", [0.0, -1.0, nan, inf, 1e300, 1e-9])
def test_any_time_out_can_be_set(pair, seconds):
    pair.link.use_kernel_timeout(seconds)
    (whole, part) = struct.unpack("@ll", pair.link._socket.getsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, 16))
    assert whole + part > 0  # 0 would mean no limit
    for arguments in ((), (1,), ("a", 1.0), (2**40, 1.0), (1, "a"), (1, 1.0, 1)):
        with pytest.raises((TypeError, OverflowError)):
            EXTENSION.set_timeout(*arguments)
    with pytest.raises(OSError, match="Bad file descriptor"):
        EXTENSION.set_timeout(-1, 1.0)


def test_a_peer_that_does_not_read(pair):
    fill(pair.link)
    with pytest.raises(ConnectionLost, match="did not accept"):
        pair.call_prepared(POSE, 0.1)
    with pytest.raises(ConnectionClosed):
        pair.call_prepared(POSE)


def test_the_rest_of_a_request_is_sent_after_the_peer_reads(pair):
    def read_and_answer() -> None:
        time.sleep(0.05)
        received = b""
        while not received.endswith(b"\4") or len(received) < filled + 1000:
            received += pair.peer.recv(65536)
        requests.append(received[filled:])
        pair.peer.sendall(packet(codec.encode(POSE), 1))

    requests: list[bytes] = []
    filled = fill(pair.link)
    numbers = [0.5] * 1500
    thread = threading.Thread(target=read_and_answer)
    thread.start()
    try:
        assert pair.call_prepared(numbers) == (0, POSE)
    finally:
        thread.join()
    _, expected = BcapConversation().begin(f.robot_execute, (5, "slvMove", numbers))
    assert requests == [expected]


def test_the_peer_is_gone(pair):
    pair.peer.close()
    with pytest.raises(ConnectionLost):
        pair.call_prepared(POSE)
    with pytest.raises(ConnectionClosed):
        pair.call_prepared(POSE)


def test_a_close_by_another_thread_ends_the_wait(pair):
    def close() -> None:
        pair.peer.recv(65536)
        pair.link.close()

    thread = threading.Thread(target=close)
    thread.start()
    try:
        with pytest.raises(ConnectionClosed):
            pair.call_prepared(POSE)
    finally:
        thread.join()


def test_a_link_without_a_socket_uses_the_functions_in_python():
    class Memory:
        def exchange(self, data: bytes, seconds: float) -> bytes | None:
            return packet(codec.encode(len(data)), 1, struct.unpack_from("<H", data, 5)[0])

        def close(self) -> None: ...

    conversation = BcapConversation()
    template = conversation.template(f.robot_execute, (5, "slvMove"))
    assert direct.call(conversation, Memory(), f.variable_get_value, (5,), 1.0, False) == (0, 30)
    assert direct.call_prepared(conversation, Memory(), f.robot_execute, template, POSE, 1.0) == (0, 132)
    assert conversation.serial == 3
