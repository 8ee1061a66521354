"""The JSON view of variables: its paths, and values and errors as JSON."""

from __future__ import annotations

import json
import math
from datetime import datetime
from decimal import Decimal
from typing import Any, Final

from starlette.responses import PlainTextResponse, Response

from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.values.types import type_name
from orinkit.values.variant import Variant

VARIABLES: Final = "/variables/"
"""Beginning of the paths of variables."""

_STATUS: Final = {
    hresult.E_CAO_OBJECT_NOTFOUND: 404,
    hresult.VARIABLE_INDEX_INVALID: 404,
    hresult.E_INVALIDARG: 400,
    hresult.E_ACCESSDENIED: 403,
    hresult.NO_READ_RIGHT: 403,
    hresult.E_NOTIMPL: 501,
    hresult.E_MAX_CONNECT: 503,
    hresult.E_BUSY_PROC: 503,
    hresult.E_OUTOFMEMORY: 503,
    hresult.E_TIMEOUT: 504,
}


def is_view(path: str) -> bool:
    """Return True if a path belongs to the JSON view of variables."""
    return path.startswith(VARIABLES)


def json_value(value: Any) -> Any:
    """Return a plain value for JSON: a date as text in ISO 8601, bytes as numbers, ``null`` for a number like NaN."""
    if isinstance(value, list):
        return [json_value(each) for each in value]
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, datetime):
        return value.isoformat()
    if isinstance(value, Decimal):
        return float(value)
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def value_document(name: str, value: Variant) -> dict[str, Any]:
    """Return the document of a variable."""
    return {"name": name, "type": type_name(value.type), "value": json_value(value.plain)}


def error_document(code: int, detail: str) -> tuple[int, dict[str, Any]]:
    """Return the status and the document of a return code."""
    code = hresult.unsigned(code)
    info = error_for(code).info
    document = {"code": f"0x{code:08X}", "name": info.name, "message": info.text, "detail": detail}
    return _STATUS.get(code, 500), {"error": document}


def as_json(refusal: PlainTextResponse) -> Response:
    """Return a response that refuses a request as JSON."""
    text = bytes(refusal.body).decode().strip()
    document = {"error": {"status": refusal.status_code, "message": text}} if text else None
    body = json.dumps(document, ensure_ascii=False) if document else ""
    kept = {name: value for name, value in refusal.headers.items() if name not in ("content-type", "content-length")}
    return Response(body, refusal.status_code, kept, "application/json")
