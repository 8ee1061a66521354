"""``orinkit functions``: list the functions of CAO."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter

from orinkit.cao.functions import FUNCTIONS, find
from orinkit.cao.table import Function
from orinkit.cli._shared.connection import Json
from orinkit.cli._shared.errors import CommandError
from orinkit.core.i18n import tr


def functions(
    filter: Annotated[  # noqa: A002 - shown as FILTER on the help page
        str | None,
        Parameter(
            help=tr(
                "Id or name of a function to show its details. For any other text, the functions whose name or "
                "description contains the text are listed."
            )
        ),
    ] = None,
    /,
    *,
    json: Json = False,
) -> None:
    """List the functions of b-CAP and e-CAP, or show one function: arguments, result and section of the document."""
    from orinkit.cli._shared.output import print_json

    exact = _exact(filter)
    found = [exact] if exact else [entry for entry in FUNCTIONS.values() if _contains(entry, filter or "")]
    if not found:
        raise CommandError(tr("no function contains {text!r}", text=filter))
    if json:
        print_json([document(entry) for entry in found])
    elif exact:
        print("\n".join(card(exact)))
    else:
        for entry in found:
            print(f"{entry.id:3}  {entry.name:32}  {entry.text}")


def _exact(text: str | None) -> Function[..., Any] | None:
    if text is None:
        return None
    try:
        return find(text)
    except KeyError:
        return None


def _contains(entry: Function[..., Any], text: str) -> bool:
    wanted = text.lower()
    return any(
        wanted in part.lower() for part in (entry.name, f"{entry.interface.lower()}_{entry.method}", entry.en, entry.ja)
    )


def card(entry: Function[..., Any]) -> list[str]:
    """Return the details of a function as lines of text."""
    from orinkit.cli._shared.output import padded, width
    from orinkit.cli._shared.signature import signature
    from orinkit.cli._shared.terminal import bold

    rows = [
        ("id", str(entry.id)),
        (tr("Python"), f"orinkit.functions.{entry.interface.lower()}_{entry.method}"),
        ("CAO", entry.cao or "-"),
        (tr("section"), entry.section),
    ]
    if entry.released_by:
        rows.append((tr("handle released by"), entry.released_by))
    widest = max(width(label) for label, _ in rows)
    return [bold(signature(entry)), entry.text, "", *(f"{padded(label, widest)}  {value}" for label, value in rows)]


def document(entry: Function[..., Any]) -> dict[str, Any]:
    """Return a function for JSON."""
    from orinkit.cao.argument_text import type_text
    from orinkit.cli._shared.signature import result

    return {
        "id": entry.id,
        "name": entry.name,
        "python": f"{entry.interface.lower()}_{entry.method}",
        "interface": entry.interface,
        "cao": entry.cao,
        "arguments": [
            {"name": argument.name, "type": type_text(argument.vt), "handle": argument.is_handle,
             "optional": argument.optional, "default": argument.default}
            for argument in entry.arguments
        ],
        "result": result(entry) or None,
        "released_by": entry.released_by or None,
        "section": entry.section,
        "en": entry.en,
        "ja": entry.ja,
    }  # fmt: skip
