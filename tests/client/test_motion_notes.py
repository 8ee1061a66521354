"""Notes of an exception about the arm after the connection has ended: they depend on how the controller detects it."""

from __future__ import annotations

import pytest

from orinkit.bcap.profiles import DATAGRAM, LINE, STREAM
from orinkit.cao.transport_profile import TransportProfile
from orinkit.client._shared.motion import broken_off_note, closed_note, note_failure
from orinkit.core import i18n
from orinkit.core.errors import ConnectionClosed, OrinError
from orinkit.ecap.client import HTTP


def note_lost(wire: TransportProfile) -> str:
    error = RuntimeError()
    note_failure(error, ConnectionClosed("closed"), wire)
    (note,) = error.__notes__
    return note


@pytest.mark.parametrize(
    ("wire", "en", "ja"),
    [
        (STREAM, "the controller stops the arm and releases its semaphore; the motor", "コントローラがアームを停止し、アームセマフォを解放します"),
        (DATAGRAM, "after 10 s or more without a request, then stops the arm", "10 秒以上無通信が続いた後に"),
        (HTTP, "after 60 s or more without a request, then stops the arm", "60 秒以上無通信が続いた後に"),
        (LINE, "may keep moving, and its semaphore stays taken, until the next client connects", "シリアル回線では"),
    ],
    ids=lambda value: value.name if isinstance(value, TransportProfile) else "",
)  # fmt: skip
def test_a_lost_connection(wire: TransportProfile, en: str, ja: str) -> None:
    assert en in note_lost(wire)
    i18n.use("ja")
    assert ja in note_lost(wire)


@pytest.mark.parametrize("note", [closed_note, broken_off_note], ids=["closed", "broken off"])
def test_a_connection_that_was_closed(note) -> None:
    assert "lost" not in note(STREAM)
    assert "if the closing packet is lost, the arm stops only after at least 10 s without a request" in note(DATAGRAM)
    assert "if the server is not notified, the arm stops only after at least 60 s without a request" in note(HTTP)
    assert "if the closing packet is lost, the arm stops only when the next client connects" in note(LINE)
    i18n.use("ja")
    assert "失われた" not in note(STREAM)
    assert "終了を伝えるパケットが失われた場合、アームが停止するのは 10 秒以上要求がなかったとき" in note(DATAGRAM)
    assert "サーバに通知されない場合、アームが停止するのは 60 秒以上要求がなかったとき" in note(HTTP)
    assert "次のクライアントが接続したとき" in note(LINE)


@pytest.mark.parametrize("wire", [STREAM, DATAGRAM, LINE, HTTP], ids=lambda wire: wire.name)
@pytest.mark.parametrize("note", [closed_note, broken_off_note], ids=["closed", "broken off"])
def test_a_lost_connection_is_noted_once(note, wire: TransportProfile) -> None:
    error = RuntimeError()
    error.add_note(note(wire))
    note_failure(error, ConnectionClosed("closed"), wire)
    note_failure(error, ConnectionClosed("closed"), wire)
    note_failure(error, OrinError("something else"), wire)
    first, second = error.__notes__
    assert (first, "something else" in second) == (note(wire), True)
