"""Synchronize the Japanese catalogue with the source: ``python tools/messages.py [--check]``.

Without an option, new messages are added to ``orinkit.po`` without a translation, messages that no longer occur in the
source are removed, and ``orinkit.mo`` is compiled. With ``--check``, no file is changed. The exit code is then 1 if a
message is untranslated or stale, if the placeholders of a translation differ from those of the message, or if
``orinkit.mo`` is out of date.
"""

from __future__ import annotations

import io
import re
import string
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from babel.messages.catalog import Catalog, Message
from babel.messages.extract import extract_from_file
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "orinkit"
PO = SOURCE / "locale" / "ja" / "LC_MESSAGES" / "orinkit.po"
MO = PO.with_suffix(".mo")
KEYWORDS = {"tr": None, "N_": None, "say": None}
GENERATED = "_sync"
DATE = datetime(2026, 11, 23, tzinfo=UTC)  # in the header; constant, so that only new messages change the file
PERCENT = re.compile(r"%[-+ #0]*[0-9.]*[a-zA-Z]")


def extracted() -> Catalog:
    """Return a catalogue of all messages in the source, without translations."""
    found = Catalog(
        "ja", "orinkit", "# Japanese messages of orinkit.", "orinkit", "", fuzzy=False, creation_date=DATE, revision_date=DATE,
        last_translator="", language_team="Japanese", msgid_bugs_address="", copyright_holder="",
    )  # fmt: skip
    for path in sorted(SOURCE.rglob("*.py")):
        if GENERATED in path.parts:
            continue
        for _, message, _, _ in extract_from_file("python", path, keywords=KEYWORDS):
            if isinstance(message, str) and message:
                found.add(message, locations=[(path.relative_to(ROOT).as_posix(), 0)])
    return found


def current() -> Catalog:
    """Return the catalogue as stored in ``orinkit.po``."""
    if not PO.exists():
        return Catalog(locale="ja")
    with PO.open("rb") as file:
        return read_po(file, locale="ja")


def updated() -> Catalog:
    """Return the catalogue of the source with the existing translations."""
    catalog, known = extracted(), current()
    for message in catalog:
        there = known.get(message.id) if message.id else None
        if there is not None:
            message.string = there.string
            message.user_comments = there.user_comments
        message.flags.discard("python-format")
        message.flags.discard("python-brace-format")
    return catalog


def placeholders(text: str) -> list[str]:
    """Return the placeholders of a text (of str.format and of ``%``), sorted."""
    try:
        return sorted({*_fields(text), *PERCENT.findall(text.replace("%%", ""))})
    except ValueError:  # a text without placeholders may contain any braces
        return []


def _fields(text: str) -> Iterator[str]:
    for _, name, spec, _ in string.Formatter().parse(text):
        if name is not None:
            yield name
            if spec and "{" in spec:
                yield from _fields(spec)


def problems() -> Iterator[str]:
    """Yield the problems of the catalogue."""
    source, known = extracted(), current()
    for message in source:
        if not message.id:
            continue
        there = known.get(message.id)
        if there is None or not there.string:
            yield f"untranslated: {_shown(message)}"
        elif placeholders(str(message.id)) != placeholders(str(there.string)):
            yield f"placeholders differ: {_shown(message)} -> {str(there.string)!r}"
    for message in known:
        if message.id and source.get(message.id) is None:
            yield f"stale: {_shown(message)}"
    if not MO.exists() or MO.read_bytes() != _compiled(known):
        yield f"{MO.relative_to(ROOT)} is out of date"


def _shown(message: Message) -> str:
    places = ", ".join(sorted({path for path, _ in message.locations}))
    return f"{str(message.id)!r:.100}" + (f" ({places})" if places else "")


def _compiled(catalog: Catalog) -> bytes:
    data = io.BytesIO()
    write_mo(data, catalog)
    return data.getvalue()


def main() -> int:
    """Update the catalogue, or check it with ``--check``."""
    if "--check" in sys.argv[1:]:
        found = list(problems())
        print(*found, sep="\n")
        return bool(found)
    catalog = updated()
    data = io.BytesIO()
    write_po(data, catalog, width=120, sort_output=True, include_lineno=False, omit_header=False)
    PO.parent.mkdir(parents=True, exist_ok=True)
    PO.write_bytes(data.getvalue())
    MO.write_bytes(_compiled(current()))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
