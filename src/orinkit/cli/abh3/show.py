"""Decoded frames as lines of text or JSON."""

from __future__ import annotations

import json
from typing import Any

from orinkit.abh3.table.decoder import DecodedFrame
from orinkit.abh3.table.records import Flags
from orinkit.cli._shared.output import jsonable


def line(decoded: DecodedFrame) -> str:
    """Return time, frame and meaning; the line begins like those of ``candump -L``."""
    frame = decoded.frame
    return f"({frame.time:.6f}) {frame}  {decoded.text}"


def json_line(decoded: DecodedFrame) -> str:
    """Return the frame as a JSON object on one line."""
    frame = decoded.frame
    document: dict[str, Any] = {
        "time": jsonable(frame.time),
        "id": f"{frame.id:08X}",
        "data": frame.data.hex(),
        "name": decoded.name,
        "source": decoded.source,
        "destination": decoded.destination,
        "values": {value.name: _plain(value.content) for value in decoded.values},
        "units": {value.name: value.unit for value in decoded.values if value.unit},
        "fault": decoded.fault.english if decoded.fault else None,
    }
    return json.dumps(document, ensure_ascii=False, allow_nan=False)


def _plain(content: object) -> Any:
    if isinstance(content, Flags):
        return {"value": content.value, "on": list(content)}
    return jsonable(content)
