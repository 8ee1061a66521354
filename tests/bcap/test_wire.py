"""End to end without I/O: any function, from the client's conversation to the server's and a session, and back.

For arbitrary bytes, only the documented exceptions are raised.
"""

from __future__ import annotations

import struct

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from orinkit.bcap import packet
from orinkit.bcap.actions import Close, Execute, Send
from orinkit.bcap.client import BcapConversation
from orinkit.bcap.packet import Framer, Packet
from orinkit.bcap.server import ServerConversation
from orinkit.cao.arguments import read_arguments
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.outcomes import CallReply, Pending
from orinkit.cao.provider import ControllerObject, Provider, VariableObject
from orinkit.cao.provider_registry import ProviderRegistry
from orinkit.cao.session import Session
from orinkit.core import hresult
from orinkit.core.errors import CallError, CallTimeout, ConnectionLost, ProtocolError
from orinkit.values.codec import decode, encode
from orinkit.values.variant import Variant, VarType, variant
from support.strategies import same, strings, variants

pytestmark = pytest.mark.core

ENTRIES = list(FUNCTIONS.values())
I4 = st.integers(-(2**31), 2**31 - 1)
SINGLES = st.floats(width=32, allow_nan=False, allow_infinity=False)
OF_TYPE = {VarType.I4: I4, VarType.R4: SINGLES, VarType.BSTR: strings(), VarType.VARIANT: variants()}
RESULTS = {**OF_TYPE, None: st.none()}
CODES = {hresult.E_INVALIDRCVPACKET, hresult.E_INVALIDARGTYPE, hresult.E_PACKETSIZEOVER, hresult.E_ARGSIZEOVER}


@st.composite
def calls(draw):
    """A function with arguments; some optional ones are omitted."""
    function = draw(st.sampled_from(ENTRIES))
    given = draw(st.integers(function.required, len(function.arguments)))
    return function, tuple(draw(OF_TYPE[argument.vt]) for argument in function.arguments[:given])


def executed(server: ServerConversation, data: bytes) -> Execute:
    (action,) = list(server.receive(data, 0.0))
    assert isinstance(action, Execute)
    return action


@given(calls(), st.data())
@settings(max_examples=300)
def test_any_call_and_its_reply_arrive_unchanged(call, data):
    function, arguments = call
    bound = function.bind(arguments, {})
    operation = BcapConversation().call(function, bound, 1.0, exact=True)
    request, _ = next(operation)
    server = ServerConversation()
    action = executed(server, request) if function.id != 1 else None
    if action is None:  # an option of Service_Start may be refused
        (action,) = server.receive(request, 0.0)
        if isinstance(action, Send):
            assert packet.decode(action.data).code == hresult.E_INVALIDARG
            return
    assert action.function_id == function.id
    values = read_arguments(function, action.arguments)
    wanted = list(bound) + ["" for _ in function.arguments[len(bound) :]]
    wanted = [
        variant(value) if argument.vt is VarType.VARIANT else value
        for argument, value in zip(function.arguments, wanted, strict=True)
    ]
    assert same([read(value) for value in values], [read(value) for value in wanted])

    result = data.draw(RESULTS[function.result])
    code = data.draw(st.integers(0, 2**31 - 1).filter(lambda code: code != hresult.S_EXECUTING))
    typed = None if function.result is None else variant(result)
    with pytest.raises(StopIteration) as ended:
        operation.send(server.finish(action, code, typed))
    answered, value = ended.value.value
    assert answered == code
    assert same(value, typed)


def read(value):
    """Convert numbers to int or float, as the table specifies."""
    return float(value) if type(value) is int else value


class Echo(VariableObject):
    def __init__(self):
        super().__init__("v")
        self.value = Variant(VarType.EMPTY)

    def get_value(self):
        return self.value

    def put_value(self, value):
        self.value = value


class Controller(ControllerObject):
    def get_variable(self, name, option):
        return Echo()


class Device(Provider):
    provider_names = ("*",)

    def connect(self, name, machine, option, client):
        return Controller()


class Server:
    """A session and a conversation, connected as a listener does it."""

    def __init__(self) -> None:
        self.session = Session(ProviderRegistry(Device()))
        self.conversation = ServerConversation()
        self.closed = False

    def feed(self, data: bytes) -> bytes:
        answers = []
        for action in self.conversation.receive(data, 0.0):
            if isinstance(action, Execute):
                outcome = self.session.invoke(action.function_id, action.arguments)
                assert not isinstance(outcome, Pending)
                assert isinstance(outcome, CallReply)
                answers.append(self.conversation.finish(action, outcome.code, outcome.result))
            elif isinstance(action, Send):
                answers.append(action.data)
            else:
                assert isinstance(action, Close)
                self.closed = True
                break
        return b"".join(answers)


def script(*steps) -> list[bytes]:
    return [
        packet.encode(Packet(serial, number, list(arguments))) for serial, (number, *arguments) in enumerate(steps, 1)
    ]


SESSION = script(
    (1, "WDT=400,InvokeTimeout=180000"), (3, "b-CAP", "CaoProv.DENSO.VRC", "localhost", ""), (9, 2, "IO150", ""),
    (102, 3, [1.0, 2.0, 3.0]), (101, 3), (102, 3, [[1.0], "J", None]), (107, 3, "タグ"), (106, 3), (111, 3), (4, 2), (2,),
)  # fmt: skip


def test_the_session_itself_is_answered():
    server = Server()
    answers = [packet.decode(server.feed(data)) for data in SESSION]
    assert [answer.code for answer in answers] == [0] * 11
    assert [answer.serial for answer in answers] == list(range(1, 12))
    assert answers[4].arguments == [[1.0, 2.0, 3.0]]
    assert answers[7].arguments == ["タグ"]
    assert len(server.session) == 0


@st.composite
def mutated(draw, packets=None):
    """A valid packet with some bytes changed, deleted, duplicated or inserted."""
    data = bytearray(draw(st.sampled_from(packets or SESSION)))
    for _ in range(draw(st.integers(1, 4))):
        position = draw(st.integers(0, max(len(data) - 1, 0)))
        match draw(st.sampled_from(["set", "flip", "cut", "insert", "count", "double"])):
            case "set":
                data[position : position + 1] = bytes([draw(st.sampled_from([0, 1, 4, 0x20, 0x7F, 0x80, 0xFF]))])
            case "flip":
                data[position : position + 1] = bytes([(data[position] if data else 0) ^ 1 << draw(st.integers(0, 7))])
            case "cut":
                del data[position : position + draw(st.integers(1, 8))]
            case "insert":
                data[position:position] = draw(st.binary(max_size=8))
            case "count":
                data[position : position + 4] = struct.pack("<I", draw(st.integers(0, 2**32 - 1)))
            case "double":
                data += data[position:]
    if draw(st.booleans()) and len(data) >= 16:  # a valid frame around it, so that the content is decoded
        data[0], data[-1] = packet.SOH, packet.EOT
        struct.pack_into("<I", data, 1, len(data))
    return bytes(data)


@given(st.lists(mutated() | st.sampled_from(SESSION) | st.binary(max_size=30), max_size=8))
@settings(max_examples=300)
def test_corrupted_requests_are_answered_or_close_the_connection(stream):
    server, answers = Server(), Framer()
    for data in stream:
        reply = answers.feed(server.feed(data))
        while reply is not None:
            packet.decode(reply)
            reply = answers.next_frame()
        if server.closed:
            break
    assert (answers.pending, answers.skipped_bytes) == (0, 0)
    server.session.close()
    assert len(server.session) == 0


@st.composite
def sound_calls(draw):
    """A call whose handle may exist, and whose name may exist."""
    function, arguments = draw(calls())
    if function.arguments and function.arguments[0].is_handle:
        arguments = (draw(st.integers(1, 6)), *arguments[1:])
    return function, arguments


@given(
    st.lists(
        sound_calls() | st.just((FUNCTIONS[3], ("", "x", "", ""))) | st.just((FUNCTIONS[9], (2, "v"))), max_size=20
    )
)
def test_any_calls_in_any_order_are_each_answered_once(made):
    server = Server()
    for serial, (function, arguments) in enumerate(made, 1):
        answer = packet.decode(server.feed(packet.encode(Packet(serial, function.id, list(arguments)))), exact=True)
        assert answer.serial == serial
        if answer.code:
            assert [each.type for each in answer.arguments] == [VarType.EMPTY]
        else:
            assert len(answer.arguments) == (function.result is not None or function.method == "execute")
        if function.creates and not answer.code:
            assert answer.arguments[0].value in server.session._entries
    assert not server.closed
    server.session.close()


ANSWERS = [
    packet.encode(Packet(1, 0, [2])), packet.encode(Packet(1, 0)), packet.encode(Packet(1, 0, ["Arm"])),
    packet.encode(Packet(1, 0, [[1.0, 2.0]])), packet.encode(Packet(1, 0, [[1, "x", [None]]])),
    packet.encode(Packet(1, 0x80004005)), packet.encode(Packet(1, hresult.S_EXECUTING)), packet.encode(Packet(2, 0, [5])),
]  # fmt: skip


@given(
    st.sampled_from(ENTRIES), st.booleans(),
    st.lists(mutated(ANSWERS) | st.sampled_from(ANSWERS) | st.binary(min_size=1, max_size=30), max_size=5),
    st.sampled_from([None, b""]),
)  # fmt: skip
@settings(max_examples=300)
def test_corrupted_replies_raise_the_documented_exceptions(function, exact, stream, end):
    arguments = tuple({VarType.BSTR: "x", VarType.R4: 1.5}.get(argument.vt, 3) for argument in function.arguments)
    operation = BcapConversation().call(function, arguments, 1.0, exact=exact)
    assert next(operation)[1] == 1.0
    codes, said = set(), None
    try:
        for data in [*(data for data in stream if data), end]:
            waiting = operation.send(data)
            assert waiting in ((b"", None), (b"", 1.0))
    except StopIteration as ended:
        code, result = ended.value
        assert 0 <= code < 2**31
        kind = {VarType.I4: int, VarType.BSTR: str, None: type(None)}.get(function.result)
        content = result.value if exact and function.result else result
        assert kind is None or type(content) is kind
    except (CallError, CallTimeout, ConnectionLost) as error:
        said = str(error)
    except ProtocolError as error:
        codes.add(error.code)
    assert said is None or function.name in said
    assert codes <= CODES


@given(mutated([encode(item) for item in ([1.0, 2.0], "text", [1, ["a", None]], ["a", "b"], b"abc", None)]))
@example(b"")
def test_a_corrupted_argument_is_decoded_or_refused(data):
    codes = set()
    for exact in (False, True):
        try:
            decode(data, exact=exact)
        except ProtocolError as error:
            codes.add(error.code)
    assert codes <= CODES


@given(mutated())
def test_a_corrupted_packet_is_decoded_or_refused(data):
    codes = set()
    for crc in (False, True):
        try:
            packet.decode(data, crc=crc)
        except ProtocolError as error:
            codes.add(error.code)
    assert codes <= CODES
