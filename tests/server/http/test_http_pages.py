"""HTTP for web pages of other origins, dashboards, clients with Shift_JIS, and user-defined functions."""

from __future__ import annotations

import json
from collections.abc import Iterator
from datetime import datetime
from decimal import Decimal
from typing import Any

import pytest

import orinkit
from orinkit.core import hresult
from orinkit.core.errors import CallError, InvalidValue, error_for
from orinkit.device import Device, user_function, variable
from orinkit.gateway import RemoteProvider
from orinkit.server.http.options import HttpOptions
from orinkit.server.http.variables import VariableViews
from orinkit.server.threaded import Server
from orinkit.values.variant import Variant, VarType
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.peers import RawClient
from support.waiting import until
from support.web import FORM, Answer, Web

PANEL = "https://panel.example:8443"
OPTIONS = HttpOptions(origins=(PANEL, "http://127.0.0.1:3000"))


class Panel(Device):
    """A device with variables of every kind, and user-defined functions."""

    provider_names = ("CaoProv.Example.Panel",)

    @variable("WIDTH", quick=True)
    def width(self) -> float:
        return 30.5

    @variable("NAME", quick=True)
    def name(self) -> str:
        return '座標"\n'

    @variable("MIXED")
    def mixed(self) -> Any:
        return [1, "x", None, [True, 2.5], datetime(2026, 11, 24, 4, 0), Decimal("1.25"), b"\x01\xff", float("nan")]

    @variable("BROKEN", quick=True)
    def broken(self) -> int:
        raise error_for(0x80010005, "a code of the device")

    @variable("FULL", quick=True)
    def full(self) -> int:
        raise MemoryError

    @user_function(255, quick=True)
    def only_ecap(self) -> int:
        return 255

    @user_function(300, "Blink")
    def blink(self, times: int, colour: str = "red", bright: bool = False, share: float = 0.5) -> str:
        return f"{times} {colour} {bright} {share}"

    @user_function(301)
    async def anything(self, first: Any = None, second: Any = "none") -> Any:
        return [first, second]

    @user_function(302)
    def nothing(self) -> None:
        return None


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    Web.close_all()


@pytest.fixture
def server() -> Iterator[Server]:
    with orinkit.serve(Panel(), "http://127.0.0.1:0", "tcp://127.0.0.1:0", http=OPTIONS) as served:
        yield served


@pytest.fixture
def web(server: Server) -> Web:
    return Web(server.urls[0])


def get(web: Web, name: str, **headers: str) -> Answer:
    return web.ask("", "GET", f"/variables/{name}", **headers)


# --- pages of other origins -------------------------------------------------------------------------------------------


@pytest.mark.field("5.4")
def test_a_preflight_of_an_allowed_origin(web: Web) -> None:
    answer = web.ask("", method="OPTIONS", Origin=PANEL, Access_Control_Request_Method="POST",
                     Access_Control_Request_Headers="authorization")  # fmt: skip
    assert answer.status == 204
    assert answer.headers["access-control-allow-origin"] == PANEL
    assert answer.headers["vary"] == "Origin"
    assert "POST" in answer.headers["access-control-allow-methods"]
    assert "Authorization" in answer.headers["access-control-allow-headers"]


@pytest.mark.field("5.4")
def test_calls_of_an_allowed_origin(web: Web) -> None:
    for origin in (PANEL, "HTTP://127.0.0.1:3000"):
        answer = web.ask("Func=1", Origin=origin)
        assert (answer.status, answer.code) == (200, 0)
        assert answer.headers["access-control-allow-origin"] == origin
        assert answer.headers["access-control-expose-headers"] == "Orinkit-Error, Orinkit-Detail"
    refused = web.ask("", method="PUT", Origin=PANEL)
    assert (refused.status, refused.headers["access-control-allow-origin"]) == (405, PANEL)


@pytest.mark.field("5.4")
@pytest.mark.parametrize(
    "origin", ["null", "https://panel.example", "https://panel.example.evil:8443", "http://panel.example:8443", "x"]
)
def test_other_origins_are_refused(web: Web, origin: str) -> None:
    for method, path in (("POST", "/"), ("OPTIONS", "/"), ("GET", "/variables/WIDTH")):
        answer = web.ask("Func=1", method, path, Origin=origin, Access_Control_Request_Method="POST")
        assert answer.status == 403
        assert "access-control-allow-origin" not in answer.headers


def test_no_origin_is_allowed_by_default() -> None:
    with orinkit.serve(Panel(), "http://127.0.0.1:0") as server:
        answer = Web(server.url).ask("", method="OPTIONS", Origin=PANEL, Access_Control_Request_Method="POST")
        assert answer.status == 403


@pytest.mark.parametrize("origins", [("*",), ("panel.example",), ("https://panel.example/",), ("null",), PANEL])
def test_invalid_origins(origins: Any) -> None:
    with pytest.raises(InvalidValue, match="origins must be a scheme and a host"):
        HttpOptions(origins=origins)


def test_a_preflight_needs_no_token_but_a_call_does() -> None:
    options = HttpOptions(token="secret-of-the-cell", origins=(PANEL,))
    with orinkit.serve(Panel(), "http://127.0.0.1:0", http=options) as server:
        web = Web(server.url)
        assert web.ask("", method="OPTIONS", Origin=PANEL, Access_Control_Request_Method="POST").status == 204
        assert web.ask("Func=1", Origin=PANEL).status == 401
        refused = get(web, "WIDTH", Origin=PANEL)
        assert refused.status == 401
        assert json.loads(refused.body)["error"]["status"] == 401
        assert get(web, "WIDTH", Origin=PANEL, Authorization="Bearer secret-of-the-cell").status == 200


# --- JSON ---------------------------------------------------------------------------------------------------------------


@pytest.mark.field("5.4")
@pytest.mark.parametrize(
    ("name", "document"),
    [
        ("WIDTH", {"name": "WIDTH", "type": "VT_R8", "value": 30.5}),
        ("width", {"name": "width", "type": "VT_R8", "value": 30.5}),
        ("NAME", {"name": "NAME", "type": "VT_BSTR", "value": '座標"\n'}),
        ("MIXED", {"name": "MIXED", "type": "VT_VARIANT|VT_ARRAY",
                   "value": [1, "x", None, [True, 2.5], "2026-11-24T04:00:00", 1.25, [1, 255], None]}),
    ],
)  # fmt: skip
def test_a_variable_as_json(web: Web, name: str, document: dict[str, Any]) -> None:
    for _ in range(2):
        answer = get(web, name)
        assert (answer.status, answer.headers["content-type"]) == (200, "application/json")
        assert json.loads(answer.body) == document


@pytest.mark.field("5.4")
@pytest.mark.parametrize(
    ("name", "status", "code", "detail"),
    [
        ("NONE", 404, "0x80000204", "NONE"),
        ("BROKEN", 500, "0x80010005", "a code of the device"),
        ("FULL", 503, "0x8007000E", "MemoryError"),
    ],
)
def test_an_error_as_json(web: Web, name: str, status: int, code: str, detail: str) -> None:
    answer = get(web, name)
    error = json.loads(answer.body)["error"]
    assert (answer.status, error["code"]) == (status, code)
    assert detail in error["detail"]


def test_the_view_only_reads(web: Web) -> None:
    for method in ("POST", "PUT"):
        answer = web.ask("Func=1", method, "/variables/WIDTH")
        assert (answer.status, answer.headers["allow"]) == (405, "GET")
        assert json.loads(answer.body)["error"]["status"] == 405
    assert web.ask("", "GET", "/other").status == 405


def test_the_view_of_a_virtual_rc8() -> None:
    with orinkit.serve(VirtualRC8(), "http://127.0.0.1:0") as server:
        web = Web(server.url)
        for number in range(100):
            assert json.loads(get(web, f"I{number}").body) == {"name": f"I{number}", "type": "VT_I4", "value": 0}
        assert json.loads(get(web, "P%31").body)["value"] == [0.0] * 6 + [-1.0]
        assert get(web, "I100").status == 404
        assert json.loads(get(web, "%40MODE").body)["value"] == 3
        assert server.clients == 0


def test_a_text_that_utf_8_cannot_contain() -> None:
    with orinkit.serve(VirtualRC8(), "http://127.0.0.1:0", "tcp://127.0.0.1:0") as server:
        with orinkit.connect(server.urls[1]) as rc8:
            rc8.variable("S1").value = "\ud83e x"
        assert json.loads(get(Web(server.urls[0]), "S1").body.decode("utf-8"))["value"] == "\ud83e x"


def test_the_view_of_a_controller_behind_a_gateway() -> None:
    with (
        orinkit.serve(VirtualRC8(), "tcp://127.0.0.1:0") as cell,
        orinkit.serve(RemoteProvider(cell.url), "http://127.0.0.1:0") as gateway,
    ):
        answer = get(Web(gateway.url), "I1")
    assert json.loads(answer.body) == {"name": "I1", "type": "VT_I4", "value": 0}


def test_the_sessions_of_the_view_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("orinkit.server.http.variables.IDLE_TIMEOUT", 0.05)
    ended = []
    forget = VariableViews._forget
    monkeypatch.setattr(VariableViews, "_forget", lambda self, address: ended.append(address) or forget(self, address))
    with orinkit.serve(Panel(), "http://127.0.0.1:0") as server:
        assert get(Web(server.url), "WIDTH").status == 200
        until(lambda: ended == ["127.0.0.1"])


# --- Shift_JIS ------------------------------------------------------------------------------------------------------------


@pytest.mark.field("5.3")
def test_shift_jis_by_option(both: Both) -> None:
    options = HttpOptions(charset="Shift-JIS")
    with orinkit.serve(VirtualRC8(), "http://127.0.0.1:0", http=options) as server:
        web = Web(server.url, keeps_cookies=True)
        assert web.ask("Func=1").headers["content-type"] == "text/plain; charset=shift_jis"
        handle = web.ask("Func=3,Arg1=,Arg2=CaoProv.DENSO.VRC,Arg3=,Arg4=").handle
        tag = "表ソ能 座標".encode("cp932")
        assert web.ask(b"Func=23,Arg1=%d,Arg2=8," % handle + tag).code == 0
        assert web.ask(f"Func=22,Arg1={handle}").body == b"0x00000000,8," + tag
        as_utf_8 = web.ask(f"Func=22,Arg1={handle}", Content_Type=f"{FORM}; charset=utf-8")
        assert as_utf_8.body == "0x00000000,8,表ソ能 座標".encode()
    with orinkit.serve(VirtualRC8(), "http://127.0.0.1:0") as server:
        controller = both.connect(server.url, charset="shift_jis")
        both.run(controller.put_tag("表ソ能 座標"))
        assert both.run(controller.get_tag()) == "表ソ能 座標"
        both.run(controller.close())
    with pytest.raises(InvalidValue, match="charset"):
        both.connect("tcp://127.0.0.1:1", charset="shift_jis")
    with pytest.raises(InvalidValue, match="charset must be"):
        HttpOptions(charset="ebcdic")


# --- codes, values and details --------------------------------------------------------------------------------------------


@pytest.mark.field("5.2")
def test_codes_0x8001xxxx_belong_to_the_device(server: Server, both: Both) -> None:
    web = Web(server.urls[0], keeps_cookies=True)
    web.ask("Func=1")
    handle = web.ask("Func=3,Arg1=,Arg2=CaoProv.Example.Panel,Arg3=,Arg4=").handle
    assert web.ask("Func=101,Arg1=three").code == hresult.E_INVALIDARG
    assert web.ask(f"Func=9,Arg1={handle},Arg2=").code == hresult.E_CAO_OBJECT_NOTFOUND
    for name, code in (("BROKEN", 0x80010005), ("FULL", hresult.E_OUTOFMEMORY)):
        other = web.ask(f"Func=9,Arg1={handle},Arg2={name}").handle
        assert web.ask(f"Func=101,Arg1={other}").code == code


@pytest.mark.field("5.3")
def test_a_variant_and_an_empty_list_of_names(server: Server) -> None:
    web = Web(server.urls[0], keeps_cookies=True)
    web.ask("Func=1")
    handle = web.ask("Func=3,Arg1=,Arg2=CaoProv.Example.Panel,Arg3=,Arg4=").handle
    for text in ("12,(8,Sample)", '8200, a ,"b', "8,100% a+b", "8204,(12,(3,1)),(8, x)"):
        assert web.ask(f"Func=23,Arg1={handle},Arg2={text}").code == 0
        assert web.ask(f"Func=22,Arg1={handle}").result == text
    assert web.ask(f"Func=14,Arg1={handle}").result == "8200,"


@pytest.mark.field("5.3")
def test_an_ascii_detail_is_not_encoded(web: Web) -> None:
    assert web.ask("Func=50%").headers["orinkit-detail"] == "Func: '50%' is not a number. Try: Func=3"
    japanese = web.ask("Func=座").headers["orinkit-detail"]
    assert japanese.startswith("UTF-8''Func: '%E5%BA%A7' is not a number")


# --- user-defined functions -----------------------------------------------------------------------------------------------


@pytest.mark.field("5.1")
@pytest.mark.parametrize(
    ("body", "result"),
    [
        ("Func=300,Arg1=3", "8,3 red False 0.5"),
        ("Func=300,Arg1=3,Arg2=dark blue,Arg3=true,Arg4=0.25", "8,3 dark blue True 0.25"),
        ("Func=300&Arg1=3%2C3&Arg3=-1", "8,3  True 0.5"),
        ("Func=301", "8204,(0,),(8,none)"),
        ("Func=301,Arg1=8194,1,2,Arg2=x", "8204,(8195,1,2),(8,x)"),
        ("Func=255", "3,255"),
        ("Func=302", ""),
    ],
)
def test_user_defined_functions_by_curl(web: Web, body: str, result: str) -> None:
    assert web.ask(body).result == result


@pytest.mark.field("5.1")
def test_invalid_calls_of_user_defined_functions(web: Web, server: Server) -> None:
    assert web.ask("Func=300").code == hresult.E_INVALIDARG
    assert web.ask("Func=300,Arg1=x").code == hresult.E_INVALIDARG
    assert web.ask("Func=302,Arg1=x").code == hresult.E_INVALIDARG
    assert web.ask("Func=299").code == hresult.E_NOTIMPL
    with RawClient(server.urls[1]) as raw:
        assert raw.ask(300, 3, "green") == "3 green False 0.5"
        assert raw.ask(255) == hresult.E_NOTIMPL, "reserved in b-CAP"
        assert raw.ask(300, "x") == hresult.E_INVALIDARGTYPE


@pytest.mark.field("5.1")
@pytest.mark.parametrize("transport", [0, 1], ids=["http", "tcp"])
def test_user_defined_functions_from_clients(server: Server, both: Both, transport: int) -> None:
    controller = both.connect(server.urls[transport], provider="CaoProv.Example.Panel")
    assert both.run(controller.call_user(300, 3, "8,x", True, 2.5)) == "3 8,x True 2.5"
    assert both.run(controller.call_user(300, 3)) == "3 red False 0.5"
    assert both.run(controller.client.call_user(301, Variant(VarType.I2, 5), [1.5, 2.5])) == [5, [1.5, 2.5]]
    assert both.run(controller.call_user(302)) is None
    with pytest.raises(CallError) as refused:
        both.run(controller.call_user(999))
    assert refused.value.code == hresult.E_NOTIMPL
    with pytest.raises(InvalidValue, match="from 255"):
        both.run(controller.call_user(137))
    both.run(controller.close())


def test_invalid_declarations() -> None:
    with pytest.raises(InvalidValue, match="from 255"):
        user_function(254)(lambda self: None)
    with pytest.raises(InvalidValue, match="the limit is 5"):
        user_function(300)(lambda self, a, b, c, d, e, f: None)
    with pytest.raises(TypeError, match="positional"):
        user_function(300)(lambda self, *a: None)
    with pytest.raises(TypeError, match="twice"):
        type("Twice", (Device,), {"a": user_function(300)(lambda self: 1), "b": user_function(300)(lambda self: 2)})

    class Another(Panel):
        provider_names = ("CaoProv.Example.Another",)

    with pytest.raises(ValueError, match="both have the user-defined function 255"):
        orinkit.serve([Panel(), Another()], "tcp://127.0.0.1:0")
