"""Options of Service_Start, common to b-CAP and e-CAP."""

from __future__ import annotations

import pytest

from orinkit.cao.service_options import ServiceOptions, read_options
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType

pytestmark = pytest.mark.core


def text(value: str) -> list[Variant]:
    return [Variant(VarType.BSTR, value)]


@pytest.mark.parametrize(
    ("arguments", "options"),
    [
        ([], ServiceOptions()),
        (text(""), ServiceOptions()),
        ([Variant(VarType.EMPTY)], ServiceOptions()),
        (text("WDT=400"), ServiceOptions(0.4)),
        (text(",wdt=81,INVOKETIMEOUT=80"), ServiceOptions(0.081, 0.08)),
        (text("InvokeTimeout=0x1000"), ServiceOptions(None, 4.096)),
        (text("InvokeTimeout=2147483647, Server=192.168.0.1"), ServiceOptions(None, 2147483.647)),
        ([Variant(VarType.I4, 1)], ServiceOptions()),  # the session refuses it
        ([*text("WDT=1"), *text("WDT=1")], ServiceOptions()),
    ],
)
def test_options(arguments: list[Variant], options: ServiceOptions) -> None:
    assert read_options(arguments) == options


@pytest.mark.parametrize(
    "given",
    ["WDT=79", "WDT=2147483648", "InvokeTimeout=79", "InvokeTimeout=-1", "x" * 65536],
)
def test_invalid_milliseconds(given: str) -> None:
    with pytest.raises(CallError) as caught:
        read_options(text(given))
    assert caught.value.code == hresult.E_INVALIDARG
    assert caught.value.detail


@pytest.mark.parametrize("given", ["WDT=80", "WDT=", "WDT", "WDT=fast", "InvokeTimeout=fast"])
def test_values_that_only_the_document_refuses(given: str) -> None:
    assert read_options(text(given)).wdt in (None, 0.08)
    assert read_options(text(given)).invoke_timeout is None
    with pytest.raises(CallError):
        read_options(text(given), strict=True)
