"""The exception hierarchy: the class for each code, the messages, and pickling."""

from __future__ import annotations

import copy
import inspect
import pickle

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import errors, hresult, i18n
from orinkit.core.errors import (
    AccessDenied,
    AlreadyRegistered,
    BusyError,
    CallError,
    CallTimeout,
    CaoError,
    ConnectFailed,
    ConnectionClosed,
    ConnectionLost,
    ControllerError,
    DriverFault,
    DriverTimeout,
    ExecutionTimeout,
    GeneralError,
    InvalidAddress,
    InvalidArgument,
    InvalidHandle,
    InvalidValue,
    LanguageError,
    LimitExceeded,
    MotionError,
    NotationError,
    NotImplementedCall,
    ObjectNotFound,
    OptionError,
    OrinError,
    PacketError,
    ParameterRefused,
    PendantError,
    ProgramError,
    ProtocolError,
    SafetyError,
    ServoError,
    SocketError,
    TransportError,
    UnknownError,
    UserDefinedError,
    error_class,
    error_for,
)

pytestmark = pytest.mark.core

CLASSES = [kind for _, kind in inspect.getmembers(errors, inspect.isclass) if issubclass(kind, errors.OrinError)]


@pytest.mark.parametrize(
    ("code", "kind"),
    [
        (0x80004001, NotImplementedCall),
        (0x80070057, InvalidArgument),
        (0x80020005, InvalidArgument),
        (0x80020008, InvalidArgument),
        (0x8002000A, InvalidArgument),
        (0x8002000B, InvalidArgument),
        (0x80070006, InvalidHandle),
        (0x80070005, AccessDenied),
        (0x80000204, ObjectNotFound),
        (0x80000205, AlreadyRegistered),
        (0x80000900, ExecutionTimeout),
        # By range:
        (0x80004005, GeneralError),
        (0x8000FFFF, GeneralError),
        (0x80020003, GeneralError),
        (0x8007FFFF, GeneralError),
        (0x80000201, CaoError),
        (0x800004FF, CaoError),
        (0x80000905, CaoError),
        (0x80010001, PacketError),
        (0x800101FF, PacketError),
        (0x809100AA, BusyError),
        (0x80912746, SocketError),
        (0x80040200, UserDefinedError),
        (0x8004FFFF, UserDefinedError),
        (0x84201482, MotionError),
        (0x83204071, MotionError),
        (0x844044B1, ServoError),
        (0x83480001, SafetyError),
        (0x83490001, SafetyError),
        (0x834A0001, SafetyError),
        (0x83501032, ProgramError),
        (0x83580001, OptionError),
        (0x83600015, LanguageError),
        (0x83800001, PendantError),
        (0x83300001, ControllerError),
        (0x8F000000, UnknownError),
        (0xFFFFFFFF, UnknownError),
        (0x00000000, CallError),
        (0x0F200501, CallError),
    ],
)
def test_the_class_for_a_code_signed_and_unsigned(code, kind):
    assert error_class(code) is kind
    assert error_class(hresult.signed(code)) is kind
    error = error_for(hresult.signed(code), "why", "Robot_Move", (3,))
    assert (type(error), error.code, error.detail, error.function, error.arguments) == (
        kind, code, "why", "Robot_Move", (3,),
    )  # fmt: skip


@given(st.integers(-(2**31), 2**32 - 1))
def test_every_code_has_a_class_and_a_message(code):
    error = error_for(code)
    assert isinstance(error, CallError)
    assert f"0x{hresult.unsigned(code):08X}" in str(error)


@pytest.mark.parametrize("code", [2**32, -(2**31) - 1])
def test_a_number_out_of_range_is_refused(code):
    with pytest.raises(ValueError, match="32 bits"):
        error_for(code)
    with pytest.raises(ValueError, match="32 bits"):
        error_class(code)


def test_the_tree_is_as_drawn_in_the_docstring():
    drawn = errors.__doc__
    for kind in CLASSES:
        assert kind.__name__ in drawn, kind
        assert issubclass(kind, OrinError)
        assert kind.__doc__
    for kind, base in [
        (InvalidValue, ValueError),
        (NotationError, ValueError),
        (InvalidAddress, ValueError),
        (LimitExceeded, ProtocolError),
        (TransportError, ConnectionError),
        (ConnectFailed, TransportError),
        (ConnectionLost, TransportError),
        (ConnectionClosed, TransportError),
        (CallTimeout, TimeoutError),
        (DriverTimeout, CallTimeout),
        (DriverFault, OrinError),
        (ParameterRefused, OrinError),
        (NotImplementedCall, GeneralError),
        (ObjectNotFound, CaoError),
        (AlreadyRegistered, CaoError),
        (ExecutionTimeout, CaoError),
        (MotionError, ControllerError),
        (PendantError, ControllerError),
    ]:
        assert issubclass(kind, base)
    for kind in (GeneralError, CaoError, PacketError, BusyError, SocketError, UserDefinedError, ControllerError):
        assert issubclass(kind, CallError)
    assert not issubclass(BusyError, PacketError)


# --- messages ---------------------------------------------------------------------------------------------------------


def test_a_message_has_function_arguments_code_name_text_and_hint():
    error = error_for(hresult.E_HANDLE, "handle 9 is not in use", "Variable_GetValue", (9,))
    info = hresult.lookup(hresult.E_HANDLE)
    assert str(error) == (
        f"Variable_GetValue(9): 0x80070006 E_HANDLE: {info.en} [handle 9 is not in use]. Try: {info.hint_en}"
    )
    assert error.info is info


def test_a_message_in_japanese():
    i18n.use("ja")
    info = hresult.lookup(hresult.E_HANDLE)
    assert str(error_for(hresult.E_HANDLE, "", "Variable_GetValue", (9,))) == (
        f"Variable_GetValue(9): 0x80070006 E_HANDLE: {info.ja}。対処: {info.hint_ja}"
    )


def test_a_message_of_an_unknown_code_has_its_number_once():
    text = str(error_for(0x83201FFF))
    assert text.count("0x83201FFF") == 1
    assert text.startswith("0x83201FFF: ")


def test_a_code_without_a_hint_ends_with_its_text():
    code = next(code for code in hresult.CODES.values() if code.failed and not code.hint_en)
    assert str(error_for(code.value)) == f"0x{code.value:08X} {code.name}: {code.en}"


@pytest.mark.parametrize(
    ("option", "shown"),
    [
        ("Secret=0123abcd", "'Secret=***'"),
        ("secret = 0123abcd, Robot=1", "'secret = ***, Robot=1'"),
        ("@EventDisable=True,Token=x;y", "'@EventDisable=True,Token=***;y'"),
        ("Server=robot", "'Server=robot'"),
    ],
)
def test_secrets_in_option_strings_are_not_shown(option, shown):
    text = str(error_for(hresult.E_ACCESSDENIED, "", "Controller_Connect", ("", option)))
    assert f"Controller_Connect('', {shown}): " in text


def test_long_arguments_are_shortened():
    text = str(error_for(hresult.E_FAIL, "", "Robot_Move", (3, 1, [1.0] * 1000, "x")))
    call = text[: text.index("): 0x")]
    assert call.startswith("Robot_Move(3, 1, [1.0, 1.0")
    assert call.endswith("..., 'x'")
    assert len(call) < 100


def test_sixty_characters_are_still_shown_whole():
    exactly, more = "x" * 58, "x" * 59
    assert repr(exactly) in str(CallError(hresult.E_FAIL, "", "Call", (exactly,)))
    assert f"({repr(more)[:57]}...)" in str(CallError(hresult.E_FAIL, "", "Call", (more,)))


def test_the_message_of_a_time_out():
    error = CallTimeout("Robot_Move", 2.5)
    assert (error.function, error.seconds) == ("Robot_Move", 2.5)
    assert "Robot_Move: no reply within 2.5 s" in str(error)
    assert "WDT" in str(error)
    i18n.use("ja")
    assert "Robot_Move: 2.5 秒以内に応答がありません" in str(error)


def test_a_protocol_error_has_the_code_of_the_servers_reply():
    assert (ProtocolError("x").code, ProtocolError("x").fatal) == (hresult.E_INVALIDRCVPACKET, False)
    error = LimitExceeded("too long", hresult.E_PACKETSIZEOVER, fatal=True)
    assert (str(error), error.code, error.fatal) == ("too long", hresult.E_PACKETSIZEOVER, True)


def test_a_driver_that_does_not_reply():
    error = DriverTimeout("abh3_can_cmd", 2.5, 0)
    assert isinstance(error, TimeoutError)
    assert (error.function, error.seconds, error.tries, error.address) == ("abh3_can_cmd", 2.5, 1, 0)
    assert str(error).startswith(
        "abh3_can_cmd: no reply from ABH3 0 within 2.5 s; the driver may or may not have accepted the command. Try: check that "
    )
    assert "group" not in str(error)  # a command does not depend on the broadcast group
    i18n.use("ja")
    assert str(error).startswith(
        "abh3_can_cmd: 2.5 秒以内にアドレス 0 の ABH3 から応答がありません。指令が受け付けられた"
    )
    assert "対処: 電源、ボーレート・ABH3 アドレス" in str(error)
    assert "グループ" not in str(error)


@pytest.mark.parametrize("function", ["abh3_can_reqBRD", "abh3_can_reqBRDBRD", "abh3_can_reqSNG"])
def test_a_driver_that_does_not_reply_to_a_request(function):
    """A request commands nothing; a driver that replies to commands only has another broadcast group."""
    error = DriverTimeout(function, 1.0, 7)
    assert str(error).startswith(
        f"{function}: no reply from ABH3 7 within 1 s. Try: if the driver replies to commands, check its "
        "broadcast group (a parameter); "
    )
    assert "taken" not in str(error)
    assert "accepted" not in str(error)
    i18n.use("ja")
    assert str(error).startswith(
        f"{function}: 1 秒以内にアドレス 7 の ABH3 から応答がありません。対処: 指令には応答する場合は"
    )
    assert "グループ番号" in str(error)


def test_a_driver_that_does_not_reach_standstill():
    error = DriverTimeout("stop_and_wait", 5.0, 7)
    assert str(error).startswith("ABH3 7 did not reach standstill within 5 s. Try: ")
    assert "reply" not in str(error)
    i18n.use("ja")
    assert str(error).startswith("アドレス 7 の ABH3 が 5 秒以内に停止しません。対処: ")


def test_a_driver_that_refuses():
    error = ParameterRefused("the driver refuses it (01)")
    assert str(error) == "the driver refuses it (01)"
    assert not isinstance(error, CallError)  # it has no HRESULT: the reply is not from a controller


def test_a_driver_with_errors():
    error = DriverFault(0x00400004, 0x00000020, ("driver overheated", "CAN"))
    assert (error.errors, error.warnings, error.texts) == (0x00400004, 0x20, ("driver overheated", "CAN"))
    assert "driver overheated, CAN (errors 0x00400004, warnings 0x00000020)" in str(error)
    assert "Try: " in str(error)
    assert "check dialect=" in str(error)  # v1 and v2 reset with different bits
    assert ": - (errors 0x00000000, warnings 0x10000000)" in str(DriverFault(0, 1 << 28))
    assert DriverFault(0, 1).texts == ()
    i18n.use("ja")
    assert "driver overheated, CAN (異常 0x00400004, 警告 0x00000020)" in str(error)
    assert "対処: " in str(error)
    assert "dialect=" in str(error)


# --- pickle and copy --------------------------------------------------------------------------------------------------

SAMPLES = {
    CallTimeout: [("Robot_Move", 2.5)],
    DriverTimeout: [("abh3_can_cmd", 1.0, 1), ("abh3_can_reqBRDBRD", 0.5, 7), ("stop_and_wait", 5.0, 253)],
    DriverFault: [(0x00400000, 4), (4, 0, ("driver overheated",))],
    ProtocolError: [("text",), ("text", hresult.E_INVALIDARGTYPE)],
    LimitExceeded: [("text", hresult.E_ARGSIZEOVER)],
}


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
@pytest.mark.parametrize("carry", [lambda x: pickle.loads(pickle.dumps(x)), copy.copy, copy.deepcopy])
def test_every_exception_survives_pickle_and_copy(kind, carry):
    call_error = [(hresult.E_FAIL, "why", "Robot_Move", (3, [1.0, 2.0], "P1"))]
    for arguments in SAMPLES.get(kind, call_error if issubclass(kind, CallError) else [("text",)]):
        error = kind(*arguments)
        again = carry(error)
        assert type(again) is kind
        assert again.args == error.args
        assert vars(again) == vars(error)
        assert str(again) == str(error)


def test_a_fatal_protocol_error_is_still_fatal_after_pickle():
    again = pickle.loads(pickle.dumps(LimitExceeded("text", hresult.E_PACKETSIZEOVER, fatal=True)))
    assert (type(again), again.code, again.fatal) == (LimitExceeded, hresult.E_PACKETSIZEOVER, True)


@pytest.mark.parametrize(("language", "text"), [("en", "that the controller is on"), ("ja", "コントローラの電源")])
def test_no_reply_to_the_first_call(language: str, text: str) -> None:
    """On a transport that may lose packets, the remedy is to check the connection, not to wait longer."""
    i18n.use(language)
    assert text in str(CallTimeout("Service_Start", 2.5, 5))
    assert text not in str(CallTimeout("Service_Start", 2.5))
    assert text not in str(CallTimeout("Robot_Execute", 2.5, 5))


def test_the_error_of_a_refused_connection_without_detail_refers_to_the_log():
    refused = error_for(0x80000900, "", "Controller_Connect", ("", "CaoProv.Waco.ABH3"))
    assert str(refused).endswith("an orinkit server logs why it refused the connection.")
    assert "log" not in str(error_for(0x80000900, "no reply", "Controller_Connect"))
    assert "log" not in str(error_for(0x80000900, "", "Controller_Execute"))
    i18n.use("ja")
    assert "ログに理由" in str(refused)
