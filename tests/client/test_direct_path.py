"""The direct path of a call over TCP: the same outcome, for the program and for the connection, as the generator path."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from types import FrameType
from typing import Any

import pytest

import orinkit
from orinkit import aio
from orinkit import functions as f
from orinkit.bcap.packet import Packet
from orinkit.cao.dialect import VE026A
from orinkit.client._async.objects import AsyncVariable
from orinkit.client._async.robot import AsyncRobot
from orinkit.client._sync.client import call_prepared_by_client
from orinkit.client._sync.objects import Variable
from orinkit.client._sync.robot import Robot
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, ConnectionClosed, InvalidValue, ObjectReleased, OrinError
from orinkit.core.speedups import EXTENSION
from orinkit.values.poses import J
from orinkit.values.variant import Variant, VarType
from support.both import LISTEN_AT, Both
from support.peers import BadPeer, Line, executing, reply
from support.speedups import needs_extension

PATIENT = 20.0  # a time-out that must not expire
SHORT = 0.15  # a time-out that is expected to expire
POSE = [0.125, 45.0, 90.0, 0.25, 45.0, 0.5, 0.0, 0.0]


@pytest.fixture
def listen_at() -> str:
    """Return a TCP address: only streams have a direct path."""
    return LISTEN_AT["tcp"]


def echo(request: Packet) -> bytes:
    """Return the last argument."""
    return reply(request, *request.arguments[-1:])


def wrong_type(request: Packet) -> bytes:
    return reply(request, 5)


ANSWERS: dict[str, Callable[[Packet], Sequence[bytes]]] = {
    "good": lambda request: [reply(request, POSE)],
    "no result": lambda request: [reply(request)],
    "error": lambda request: [reply(request, code=hresult.E_HANDLE)],
    "executing": lambda request: [executing(request), executing(request), reply(request, 5)],
    "executing with the reply": lambda request: [executing(request) + reply(request, 5)],
    "halves": lambda request: [reply(request, POSE)[:20], reply(request, POSE)[20:]],
    "twice": lambda request: [reply(request, POSE) * 2],
    "reply and a part": lambda request: [reply(request, POSE) + reply(request, 1, serial=request.serial + 9)[:9],
                                         reply(request, 1, serial=request.serial + 9)[9:]],
    "stray": lambda request: [reply(request, 1, serial=request.serial + 9), reply(request, POSE)],
    "only stray": lambda request: [reply(request, 1, serial=request.serial + 9)],
    "garbage": lambda request: [b"HTTP/1.1 400 Bad Request\r\n\r\n"],
    "no EOT": lambda request: [reply(request, POSE)[:-1] + b"\x05"],
    "huge": lambda request: [reply(request, bytes(300_000))],
    "unknown type": lambda request: [b"\x01\x1e\0\0\0" + request.serial.to_bytes(2, "little")
                                     + b"\0\0\0\0\0\0\1\0\x0a\0\0\0\x63\0\1\0\0\0\0\0\0\0\x04"],
    "two results": lambda request: [reply(request, 1, 2)],
    "nothing": lambda request: [],
}  # fmt: skip


def scripted(answer: Callable[[Packet], Sequence[bytes]], *, ends: bool) -> Callable[[Line], None]:
    def script(line: Line) -> None:
        request = line.request()
        line.send_in_pieces(*answer(request))
        if not ends:
            line.serve(echo)

    return script


def outcome(both: Both, call: Callable[[], Any]) -> Any:
    """Return the result of a call, or its error."""
    try:
        return both.run(call())
    except OrinError as error:
        return type(error), str(error), getattr(error, "code", None), getattr(error, "subject", None)


def observed(
    both: Both, script: Callable[[Line], None], *, direct: bool, prepared: bool = False, timeout: float = PATIENT
) -> list[Any]:
    """Return the outcome of a call, of the following one, and the state of the connection."""
    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=timeout)
        if not direct:
            client._direct = None
        variable = variable_of(both, client)
        call = variable.get_value if prepared else partial(client.call, f.variable_get_value, 3)
        seen = [outcome(both, call)]
        seen.append((client._conversation.serial, client.stray_replies))
        client.timeout = PATIENT
        seen.append(outcome(both, partial(client.call, f.controller_execute, 1, "Echo", "next")))
        seen.append((client._conversation.serial, client.stray_replies))
        both.run(client.close())
    return seen


@pytest.mark.parametrize("prepared", [False, True], ids=["call", "prepared"])
@pytest.mark.parametrize("ends", [False, True], ids=["open", "closed"])
@pytest.mark.parametrize("name", ANSWERS)
def test_any_answer_has_the_same_outcome(both: Both, name: str, ends: bool, prepared: bool) -> None:
    timeout = SHORT if name in ("nothing", "only stray") and not ends else PATIENT
    script = scripted(ANSWERS[name], ends=ends)
    ours, theirs = (
        observed(both, script, direct=direct, prepared=prepared, timeout=timeout) for direct in (True, False)
    )
    if ends:  # the end of the stream may be noticed by the send or by the receive
        ours[2] = theirs[2] = ours[2][0] == theirs[2][0]
        del ours[3], theirs[3]
    assert ours == theirs


def test_a_reply_that_ends_at_any_byte(both: Both) -> None:
    for count in range(len(reply(Packet(1, 0), POSE))):
        script = scripted(lambda request, count=count: [reply(request, POSE)[:count]], ends=True)
        ours, theirs, prepared = (
            observed(both, script, direct=direct, prepared=prepared)[:2]
            for direct, prepared in ((True, False), (False, False), (True, True))
        )
        assert ours == theirs == prepared


def test_a_late_reply_belongs_to_no_later_call(both: Both) -> None:
    def script(line: Line) -> None:
        first, second = line.request(), line.request()
        line.send(echo(first) + echo(second))
        line.serve(echo)

    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        client.timeout = SHORT
        with pytest.raises(CallTimeout):
            both.run(client.call(f.controller_execute, 1, "Echo", "late"))
        client.timeout = PATIENT
        for text in ("second", "third"):
            assert both.run(client.call(f.controller_execute, 1, "Echo", text)) == text
        assert (client.stray_replies, client._conversation.direct) == (1, True)
        both.run(client.close())


@contextmanager
def signals_every(seconds: float) -> Iterator[None]:
    previous = signal.signal(signal.SIGALRM, lambda *_: None)
    signal.setitimer(signal.ITIMER_REAL, seconds, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="Windows has no interval timers")
def test_signals_do_not_prolong_the_time_out() -> None:
    both = Both("sync")
    with BadPeer(scripted(ANSWERS["nothing"], ends=False)) as peer:
        client = both.client(peer.url, timeout=SHORT)
        with signals_every(0.005), pytest.raises(CallTimeout):
            client.call(f.variable_get_value, 3)
        client.close()


def test_a_request_larger_than_the_buffers_of_the_system(both: Both) -> None:
    value = bytes(range(256)) * 40_000  # 10 MB
    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        assert both.run(client.call(f.controller_execute, 1, "Echo", value)) == value
        assert both.run(client.call(f.controller_execute, 1, "Echo", 1)) == 1
        both.run(client.close())


def test_a_peer_that_reads_nothing() -> None:
    both, end = Both("sync"), threading.Event()
    with BadPeer(lambda line: end.wait(PATIENT) and None) as peer:
        seen = []
        for direct in (True, False):
            client = both.client(peer.url, timeout=SHORT)
            if not direct:
                client._direct = None
            seen.append(outcome(both, partial(client.call, f.variable_put_value, 3, bytes(15_000_000))))
            seen.append(outcome(both, partial(client.call, f.variable_get_value, 3)))
        end.set()
    assert seen[:2] == seen[2:]
    assert "did not accept" in seen[0][1]


def test_a_value_whose_own_code_fails_leaves_the_connection_open(both: Both) -> None:
    class Odd(Sequence[int]):
        def __len__(self) -> int:
            return 1

        def __getitem__(self, index: Any) -> Any:
            raise RuntimeError("not to be read")

    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        robot = robot_of(both, client)
        for call in (
            lambda: client.call(f.variable_put_value, 3, Odd()),
            lambda: robot.execute("slvMove", Odd()),
            lambda: robot.prepare("slvMove")(Odd()),
        ):
            with pytest.raises(RuntimeError, match="not to be read"):
                both.run(call())
        assert both.run(robot.execute("slvMove", POSE)) == POSE
        both.run(client.close())


# --- prepared calls -------------------------------------------------------------------------------------------------


def robot_of(both: Both, client: Any) -> Any:
    """Return a robot with handle 3, as if it had been connected."""
    return (Robot if both.loop is None else AsyncRobot)(client, 3, "Arm")


def variable_of(both: Both, client: Any) -> Any:
    return (Variable if both.loop is None else AsyncVariable)(client, 4, "I1")


def recorder(requests: list[Packet]) -> Callable[[Line], None]:
    def answer(request: Packet) -> bytes:
        requests.append(request)
        return echo(request)

    return lambda line: line.serve(answer)


def test_prepared_commands_send_what_execute_sends(both: Both) -> None:
    requests: list[Packet] = []
    parameters = (POSE, tuple(POSE), None, 1, 1.5, True, "P1", J(1, 2, 3), [J(1, 2, 3), "x"], [1, 2], [], b"ab",
                  Variant(VarType.I2, 7), 2**31 - 1)  # fmt: skip
    with BadPeer(recorder(requests)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        robot = robot_of(both, client)
        slv_move = robot.prepare("slvMove")
        assert slv_move.command == "slvMove"
        for parameter in parameters:
            results = both.run(slv_move(parameter)), both.run(robot.execute("slvMove", parameter))
            client._direct, direct = None, client._direct
            by_generator = both.run(robot.execute("slvMove", parameter))
            client._direct = direct
            assert results == (by_generator, by_generator)
            assert len({repr((each.code, each.arguments)) for each in requests[-3:]}) == 1
        assert [each.serial for each in requests] == list(range(1, 3 * len(parameters) + 1))
        both.run(client.close())


def test_values_of_variables(both: Both) -> None:
    requests: list[Packet] = []
    with BadPeer(recorder(requests)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        variable = variable_of(both, client)
        for value in (POSE, 5, 0.5, True, "text", None):
            both.run(variable.put_value(value))
            assert both.run(variable.get_value()) == 4
        assert [(each.code, each.arguments) for each in requests[:4]] == [
            (f.variable_put_value.id, [4, POSE]), (f.variable_get_value.id, [4]),
            (f.variable_put_value.id, [4, 5]), (f.variable_get_value.id, [4]),
        ]  # fmt: skip
        both.run(client.close())


def test_signs_of_life_during_calls_that_were_prepared_before(both: Both) -> None:
    """Signs of life are sent during a call, so these calls no longer take the direct path."""
    requests: list[Packet] = []

    def next_call(line: Line) -> Packet:
        """Return the next call of the test; reply to the signs of life between its calls."""
        while (request := line.request()).code == f.controller_get_name.id:
            line.send(reply(request, "RC8") if request.serial else reply(request, code=hresult.E_BUSY_PROC))
        requests.append(request)
        return request

    def script(line: Line) -> None:
        line.send(echo(next_call(line)))
        for _ in range(3):
            request = next_call(line)
            sign = line.request()
            assert (sign.serial, sign.code, sign.arguments) == (0, f.controller_get_name.id, [7])
            line.send_in_pieces(reply(sign, code=hresult.E_BUSY_PROC), echo(request))
        line.wait_for_end()

    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        robot, variable = robot_of(both, client), variable_of(both, client)
        call = robot.prepare("slvMove")
        assert both.run(call(POSE)) == POSE
        both.run(client.start_keep_alive(0.2, 7))
        assert both.run(call(POSE)) == POSE
        assert both.run(robot.execute("slvMove", [0.5] * 8)) == [0.5] * 8
        assert both.run(variable.get_value()) == 4
        assert client.stray_replies >= 3
        both.run(client.close())
    assert [each.arguments for each in requests] == [
        [3, "slvMove", POSE], [3, "slvMove", POSE], [3, "slvMove", [0.5] * 8], [4],
    ]  # fmt: skip


@pytest.mark.parametrize("seconds", [0, -1, 0.0, float("nan"), float("inf"), True, "1"])
def test_invalid_time_outs_of_prepared_calls(both: Both, seconds: Any) -> None:
    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        call = client.prepare(f.variable_put_value, 5)
        with pytest.raises(InvalidValue, match="timeout must be"):
            both.run(client.call_prepared(call, 1, seconds))
        assert both.run(client.call_prepared(call, 1, 20)) is None
        both.run(client.close())


def test_errors_of_prepared_calls(both: Both) -> None:
    with BadPeer(lambda line: line.serve(lambda request: reply(request, code=hresult.E_HANDLE))) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        robot = robot_of(both, client)
        slv_move = robot.prepare("slvMove")
        with pytest.raises(CallError, match="Arm") as caught:
            both.run(slv_move(POSE))
        assert (caught.value.subject, caught.value.function, caught.value.arguments) == (
            "Arm", "Robot_Execute", (3, "slvMove", POSE),
        )  # fmt: skip
        with pytest.raises(InvalidValue, match=r"Robot_Execute, argument 3 \(parameter\): 2147483648"):
            both.run(slv_move(2**31))
        with pytest.raises(InvalidValue, match=r"argument 2 \(command\): 5"):
            both.run(robot.prepare(5)())
        robot._open = False
        with pytest.raises(ObjectReleased):
            both.run(slv_move(POSE))
        both.run(client.close())


def test_prepared_commands_record_that_the_arm_may_have_moved(both: Both) -> None:
    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        robot = robot_of(both, client)
        moving, holding = robot.prepare("slvMove"), robot.prepare(" TakeArm")
        robot._track.sure = robot._track.at_rest = True
        both.run(holding([0, 0]))
        assert (robot._track.sure, robot._track.at_rest) == (True, True)
        both.run(moving(POSE))
        assert (robot._track.sure, robot._track.at_rest) == (False, False)
        both.run(client.close())


def test_prepared_commands_follow_the_settings_of_the_client(both: Both) -> None:
    """Time-out, deadline and dialect may change after a command was prepared."""

    def script(line: Line) -> None:
        while True:
            request = line.request()
            if request.arguments[-1] != "silence":
                line.send(echo(request))

    with BadPeer(script) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        call = robot_of(both, client).prepare("Motor")
        assert both.run(call(1)) == 1
        client.timeout = SHORT
        with pytest.raises(CallTimeout, match=f"{SHORT}"):
            both.run(call("silence"))
        client.timeout, client.deadline = PATIENT, SHORT
        with pytest.raises(CallTimeout):
            both.run(call("silence"))
        client.deadline = None
        assert both.run(call(2)) == 2
        client.use_dialect(VE026A)
        client.timeout = SHORT
        longest = VE026A.command_timeouts["motor"]
        assert longest > SHORT
        assert client.command_timeout("Motor") == longest
        assert both.run(call(3)) == 3
        both.run(client.close())


@pytest.mark.parametrize("kind", ["sync", "async"])
def test_many_callers_share_a_prepared_command(kind: str) -> None:
    both = Both(kind)
    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        call = robot_of(both, client).prepare("Echo")

        async def caller(number: int) -> None:
            for turn in range(50):
                token = [float(number), float(turn)]
                assert await both.now(call(token)) == token

        both.side_by_side(*(caller(number) for number in range(6)))
        assert client.stray_replies == 0
        both.run(client.close())
    if both.loop is not None:
        both.loop.close()


@pytest.mark.parametrize("loop", ["asyncio", "uvloop"])
def test_cancelled_calls_leave_the_connection_usable(loop: str) -> None:
    run = asyncio.run if loop == "asyncio" else pytest.importorskip("uvloop").run

    async def body() -> None:
        with BadPeer(lambda line: line.serve(echo)) as peer:
            client = await aio.open_client(peer.url, timeout=PATIENT)
            call = AsyncRobot(client, 3, "Arm").prepare("Echo")
            for turn in range(100):
                task = asyncio.create_task(call([float(turn)]))
                for _ in range(turn % 7):
                    await asyncio.sleep(0)
                task.cancel()
                with suppress(asyncio.CancelledError):
                    assert await task == [float(turn)]
                assert await call([-1.0]) == [-1.0]
            await client.close()

    run(body())


@needs_extension
@pytest.mark.skipif(not hasattr(EXTENSION, "call"), reason="the exchange in C is for Linux only")
def test_frequent_calls_execute_no_python_functions_below_their_own() -> None:
    """If a program sleeps between two calls, each Python function costs several times as much as in a loop."""
    both = Both("sync")
    functions: list[str] = []

    def called(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            functions.append(frame.f_code.co_name)

    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = both.client(peer.url, timeout=PATIENT)
        robot, variable = robot_of(both, client), variable_of(both, client)
        prepared = robot.prepare("slvMove")
        for call, expected in (
            (partial(robot.execute, "slvMove", POSE), ["execute"]),
            (partial(prepared, POSE), ["__call__"]),
            (variable.get_value, ["get_value"]),
            (partial(variable.put_value, 5), ["put_value"]),
        ):
            call()
            sys.setprofile(called)
            call()
            sys.setprofile(None)
            assert functions == expected
            functions.clear()
        client.close()


@needs_extension
@pytest.mark.skipif(not hasattr(EXTENSION, "call"), reason="the exchange in C is for Linux only")
def test_other_clients_and_other_arguments_use_the_python_function() -> None:
    """The function in C reads the attributes of any object, and passes anything unusual to the function in Python."""
    with BadPeer(lambda line: line.serve(echo)) as peer:
        client = orinkit.open_client(peer.url, timeout=PATIENT)
        call = client.prepare(f.controller_execute, 1, "Echo")
        assert call_prepared_by_client(client, call, 5) == 5
        assert call_prepared_by_client(client, call) is None
        assert call_prepared_by_client(client, call, 5, 10) == 5
        with pytest.raises(InvalidValue, match="timeout must be"):
            call_prepared_by_client(client, call, 5, -1)
        for arguments in ((), (client,), (None, call, 5), (client, None, 5), (object(), object(), object())):
            with pytest.raises((TypeError, AttributeError)):
                call_prepared_by_client(*arguments)
        assert call_prepared_by_client(client, call, 6) == 6, "the lock was not released"
        client.close()
        with pytest.raises(ConnectionClosed):
            call_prepared_by_client(client, call, 5)


@pytest.mark.skipif(not hasattr(signal, "pthread_kill"), reason="Windows cannot signal a thread")
def test_ctrl_c_during_a_prepared_call_closes_the_connection() -> None:
    asked = threading.Event()

    def script(line: Line) -> None:
        line.send(echo(line.request()))
        line.request()
        asked.set()
        line.wait_for_end()

    def interrupt() -> None:
        asked.wait(PATIENT)
        time.sleep(0.05)
        os.kill(os.getpid(), signal.SIGINT)

    with BadPeer(script) as peer:
        client = orinkit.open_client(peer.url, timeout=PATIENT)
        call = Robot(client, 3, "Arm").prepare("slvMove")
        assert call(POSE) == POSE
        interrupting = threading.Thread(target=interrupt)
        interrupting.start()
        with pytest.raises(KeyboardInterrupt):
            call(POSE)
        interrupting.join()
        with pytest.raises(OrinError, match="closed"):
            call(POSE)
        client.close()
