"""Synchronize the Japanese catalogue with the source: ``python tools/messages.py [--check]``.

Without an option, new messages are added to ``orinkit.po`` without a translation, messages that no longer occur in the
source are removed, and ``orinkit.mo`` is compiled. If the English text of a message was changed, the new message gets the
previous translation, marked as ``fuzzy``: a translator must correct it and remove the mark. Messages without a valid
translation are listed. The exit code is 1 if the placeholders of a translation differ from those of the message;
``orinkit.mo`` is then not compiled.

With ``--check``, no file is changed. The exit code is then 1 if a message is untranslated or stale, if the placeholders of
a translation differ from those of the message, if only one of both contains a remedy ("Try:", "対処:"), or if
``orinkit.mo`` is out of date.
"""

from __future__ import annotations

import ast
import io
import re
import string
import sys
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from difflib import get_close_matches
from pathlib import Path

from babel.messages.catalog import Catalog, Message
from babel.messages.mofile import write_mo
from babel.messages.pofile import read_po, write_po

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "src" / "orinkit"
PO = SOURCE / "locale" / "ja" / "LC_MESSAGES" / "orinkit.po"
MO = PO.with_suffix(".mo")
KEYWORDS = frozenset({"tr", "N_", "say"})
GENERATED = "_sync"
DATE = datetime(2026, 11, 23, tzinfo=UTC)  # in the header; constant, so that only new messages change the file
PERCENT = re.compile(r"%[-+ #0]*[0-9.]*[a-zA-Z]")
PREVIOUS = "the English text was: "  # begins the comment of a message whose English text was changed
FUZZY = "fuzzy"
_SIMILAR = 0.75  # smallest similarity of a message to its previous version, 0 to 1
_SHOWN = 100  # characters
_MAKE = "Try: make messages"
_EDIT = f"write the msgstr in {PO.relative_to(ROOT)}; then make messages"


def extracted() -> Catalog:
    """Return a catalogue of all messages in the source, without translations."""
    found = Catalog(
        "ja", "orinkit", "# Japanese messages of orinkit.", "orinkit", "", fuzzy=False, creation_date=DATE, revision_date=DATE,
        last_translator="", language_team="Japanese", msgid_bugs_address="", copyright_holder="",
    )  # fmt: skip
    for path in sorted(SOURCE.rglob("*.py")):
        if GENERATED in path.parts:
            continue
        for message in messages_of(ast.parse(path.read_text(encoding="utf-8"))):
            found.add(message, locations=[(path.relative_to(ROOT).as_posix(), 0)])
    return found


def messages_of(node: ast.AST) -> Iterator[str]:
    """Return the messages in a syntax tree, in the order of the source.

    Babel's extractor does not find messages within f-strings on Python 3.11.
    """
    match node:
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name), args=[ast.Constant(value=str(text)), *_]):
            if name in KEYWORDS and text:
                yield text
    for child in ast.iter_child_nodes(node):
        yield from messages_of(child)


def current() -> Catalog:
    """Return the catalogue as stored in ``orinkit.po``."""
    if not PO.exists():
        return Catalog(locale="ja")
    with PO.open("rb") as file:
        return read_po(file, locale="ja")


def updated() -> tuple[Catalog, list[Message]]:
    """Return the catalogue of the source with the existing translations, and the removed messages with a translation.

    The translation of a removed message is proposed for a similar new message; such a message is not in the list.
    """
    catalog, known = extracted(), current()
    removed = {str(each.id): each for each in known if each.id and each.string and catalog.get(each.id) is None}
    for message in catalog:
        there = known.get(message.id) if message.id else None
        message.flags.clear()
        if there is not None:
            message.string = there.string
            comments = there.user_comments
            if there.fuzzy:
                message.flags.add(FUZZY)
            else:
                comments = [each for each in comments if not each.startswith(PREVIOUS)]
            message.user_comments = comments
        elif message.id:
            _propose(message, removed)
    return catalog, list(removed.values())


def _propose(message: Message, removed: dict[str, Message]) -> None:
    """Give a new message the translation of the most similar removed message, marked as fuzzy."""
    for found in get_close_matches(str(message.id), removed, 1, _SIMILAR):
        message.string = removed.pop(found).string
        message.user_comments = [PREVIOUS + " ".join(found.split())]
        message.flags.add(FUZZY)


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
    """Yield the problems of the catalogue, each with its remedy."""
    source, known = extracted(), current()
    for message in source:
        if message.id and known.get(message.id) is None:
            yield f"untranslated: {_shown(message)}. {_MAKE}; then {_EDIT}"
    for message in known:
        if message.id and source.get(message.id) is None:
            yield f"stale: {_shown(message)}. {_MAKE}"
    yield from unfinished(each for each in known if each.id and source.get(each.id) is not None)
    yield from wrong(known)
    yield from without_remedy(known)
    if not MO.exists() or MO.read_bytes() != _compiled(known):
        yield f"{MO.relative_to(ROOT)} is out of date. {_MAKE}"


def unfinished(messages: Iterable[Message]) -> Iterator[str]:
    """Yield the messages that a translator must complete, each with the remedy."""
    for message in messages:
        if message.id and not message.string:
            yield f"untranslated: {_shown(message)}. Try: {_EDIT}"
        elif message.id and message.fuzzy:
            yield (
                f"to be revised, because the English text was changed: {_shown(message)} -> {str(message.string)!r}. "
                f'Try: correct the msgstr in {PO.relative_to(ROOT)} and remove "#, fuzzy"; then make messages'
            )


def wrong(messages: Iterable[Message]) -> Iterator[str]:
    """Yield the messages whose translation has other placeholders, each with the remedy; fuzzy ones are not compiled."""
    for message in messages:
        if not (message.id and message.string) or message.fuzzy:
            continue
        if placeholders(str(message.id)) != placeholders(str(message.string)):
            yield (
                f"placeholders differ: {_shown(message)} -> {str(message.string)!r}. "
                f"Try: correct the msgstr in {PO.relative_to(ROOT)}; then make messages"
            )


def without_remedy(messages: Iterable[Message]) -> Iterator[str]:
    """Yield the messages of which only one language contains a remedy (docs/style.md)."""
    for message in messages:
        if message.id and message.string and ("Try:" in str(message.id)) != ("対処:" in str(message.string)):
            yield f"Try: without 対処:, or 対処: without Try: {_shown(message)} -> {str(message.string)!r}"


def _shown(message: Message) -> str:
    places = ", ".join(sorted({path for path, _ in message.locations}))
    text = str(message.id)
    return repr(text if len(text) <= _SHOWN else f"{text[: _SHOWN - 3]}...") + (f" ({places})" if places else "")


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
    catalog, removed = updated()
    for message in removed:
        print(f"translation removed: {str(message.id)!r} -> {str(message.string)!r}")
    data = io.BytesIO()
    write_po(data, catalog, width=120, sort_output=True, include_lineno=False, omit_header=False)
    PO.parent.mkdir(parents=True, exist_ok=True)
    PO.write_bytes(data.getvalue())
    stored = current()
    mistakes = list(wrong(stored))
    for line in (*unfinished(stored), *mistakes):
        print(line)
    if mistakes:
        return 1
    MO.write_bytes(_compiled(stored))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
