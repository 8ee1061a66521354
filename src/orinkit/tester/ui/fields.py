"""Input fields for the arguments of functions; invalid input is reported beside the field."""

from __future__ import annotations

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Final

from nicegui import ui

from orinkit.cao.table import Argument
from orinkit.core.errors import InvalidValue, NotationError
from orinkit.core.i18n import tr
from orinkit.tester.state.value_text import LONGEST_TEXT, TYPES, check_length, describe, read_value
from orinkit.values.notation import parse_data
from orinkit.values.types import type_name
from orinkit.values.variant import Variant, VarType

_LONG: Final = 4000  # characters from which a text is parsed in a thread
_MAXLENGTH: Final = LONGEST_TEXT + 1  # the browser sends one character too many, so that a longer text is detected


class Field(ABC):
    """An input field for one argument."""

    input: ui.input

    @abstractmethod
    async def read(self) -> Any:
        """Return the value.

        Raises:
            InvalidValue, NotationError: If the input is invalid; the field shows the message.
        """

    async def _checked(self, parse: Callable[[str], Any]) -> Any:
        text = self.input.value or ""
        try:
            check_length(text)
            result = await asyncio.to_thread(parse, text) if len(text) > _LONG else parse(text)
        except (InvalidValue, NotationError) as error:
            self.input.error = f"{error}"
            raise
        self.input.error = None
        return result


class TextField(Field):
    """A field for a string.

    Args:
        label: Label.
        marker: Value of ``data-testid``.
        text: Initial text.
        hint: Text below the field.
        empty: Value of an empty text.
    """

    def __init__(self, label: str, marker: str, text: str = "", hint: str = "", empty: str | None = "") -> None:
        self.input = _input(label, marker, text)
        self._empty = empty
        if hint:
            self.input.props["hint"] = hint

    async def read(self) -> str | None:
        """Return the text."""
        text: str = await self._checked(lambda text: text)
        return text or self._empty

    def suggest(self, names: Iterable[str]) -> None:
        """Offer names for selection; other names can be entered, too."""
        key = f"names-{self.input.id}"
        with self.input:
            for child in [each for each in self.input if each.tag == "datalist"]:
                child.delete()
            with ui.element("datalist") as options:
                options.props["id"] = key
                for name in names:
                    ui.element("option").props["value"] = name
        self.input.props["list"] = key


class NumberField(Field):
    """A field for a number of a VARIANT type: VT_I4 or VT_R4."""

    def __init__(self, label: str, marker: str, vt: int, text: str = "") -> None:
        self.input = _input(label, marker, text)
        self.input.props["hint"] = type_name(vt)
        self._vt = vt
        self.input.on_value_change(self._check)

    async def read(self) -> Any:
        """Return the number."""
        return await self._checked(lambda text: parse_data(self._vt, text).value)

    async def _check(self) -> None:
        if self.input.value:
            await _quietly(self.read())


class ValueField(Field):
    """A field for a VARIANT: a drop-down with the type, a text, and a description of the value below it.

    Args:
        marker: Value of ``data-testid`` of the text; that of the type has the suffix ``-type``.
        label: Label of the text.
        vt: Initial type.
        text: Initial text.
    """

    def __init__(self, marker: str, label: str, vt: int = VarType.EMPTY, text: str = "") -> None:
        with ui.element("div").classes("ok-value-box"):
            with ui.element("div").classes("ok-value-field"):
                self.type = ui.select(dict(TYPES), label=tr("Type"), value=int(vt)).props(
                    "outlined dense options-dense"
                )
                self.type.props(f"data-testid={marker}-type")
                self.input = _input(label, marker, text)
            self._description = ui.label().classes("ok-dim").props("role=status")
            self._description.props(f"data-testid={marker}-description")
        self.type.on_value_change(self._check)
        self.input.on_value_change(self._check)
        self._describe(Variant(VarType.EMPTY) if vt == VarType.EMPTY and not text else None)

    async def read(self) -> Variant:
        """Return the value."""
        try:
            value: Variant = await self._checked(lambda text: read_value(int(self.type.value), text))
        except (InvalidValue, NotationError):
            self._describe(None)
            raise
        self._describe(value)
        return value

    def set(self, vt: int, text: str | None = None, placeholder: str = "") -> None:
        """Set the type and the text; with ``None``, the text remains."""
        self.input.props["placeholder"] = placeholder
        if text is not None:
            self.input.value = text
        self.type.value = vt

    def _describe(self, value: Variant | None) -> None:
        self._description.text = describe(value) if value is not None else ""

    async def _check(self) -> None:
        if self.input.value or self.type.value == VarType.EMPTY:
            await _quietly(self.read())
        else:
            self.input.error = None
            self._describe(None)


def field_for(argument: Argument) -> Field:
    """Return the field for an argument of a function."""
    marker = f"argument-{argument.name}"
    default = "" if argument.default is None else f"{argument.default}"
    if argument.vt == VarType.VARIANT:
        return ValueField(marker, argument.name)
    if argument.vt == VarType.BSTR:
        hint = tr("empty: not sent") if argument.omitted_by_default else type_name(argument.vt)
        return TextField(argument.name, marker, default, hint, None if argument.omitted_by_default else "")
    return NumberField(argument.name, marker, argument.vt, default)


async def read_fields(fields: Sequence[Field]) -> list[Any] | None:
    """Return the values of all fields; ``None`` if one of them is invalid, which then shows the message."""
    values: list[Any] = []
    valid = True
    for field in fields:
        try:
            values.append(await field.read())
        except (InvalidValue, NotationError):
            valid = False
    return values if valid else None


def _input(label: str, marker: str, text: str) -> ui.input:
    made = ui.input(label, value=text).props(f"outlined dense debounce=150 maxlength={_MAXLENGTH}").classes("ok-mono")
    made.props("autocomplete=off spellcheck=false").props(f"data-testid={marker}")
    return made


async def _quietly(reading: Any) -> None:
    try:
        await reading
    except (InvalidValue, NotationError):
        pass
