"""The command GetErrorDescription of devices."""

from __future__ import annotations

import pytest

from orinkit.cao.error_description import get_error_description
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.values.variant import Variant, VarType, variant

pytestmark = pytest.mark.core

REASONS = {hresult.E_FAIL: "the device is on fire", hresult.E_INVALIDARG: "x" * 2000}


def reason(code: int) -> str:
    return REASONS.get(hresult.unsigned(code), "")


@pytest.mark.parametrize(
    ("code", "text"),
    [
        (variant(-2147467259), "the device is on fire"),
        (Variant(VarType.UI4, 0x80004005), "the device is on fire"),
        (Variant(VarType.ERROR, 0x80004005), "the device is on fire"),
        (variant(2147483648.0 + 0x4005), "the device is on fire"),
        (Variant(VarType.UI4, 0x80070057), "x" * 1000),
        (variant(0), hresult.lookup(0).text),
    ],
)
def test_a_reason_or_the_text_of_the_code(code: Variant, text: str) -> None:
    assert get_error_description(reason, code) == text


@pytest.mark.parametrize(
    "code", [variant(1.5), variant(2.0**32), variant(-(2.0**31) - 1), variant("x"), variant([1, 2])]
)
def test_invalid_codes(code: Variant) -> None:
    with pytest.raises(CallError) as caught:
        get_error_description(reason, code)
    assert caught.value.code in (hresult.E_INVALIDARG, hresult.E_INVALIDARGTYPE)
