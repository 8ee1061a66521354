"""What goes wrong with a program: at load a :class:`PacScriptError`, at run time a :class:`ProgramFault`."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr


class PacScriptError(ValueError):
    """A program that cannot be loaded.

    Attributes:
        message: what is wrong, in the language in force when it was found.
        file: name of the file.
        line: counted from 1.
        column: counted from 1, in characters.
        code: SYNTAX_ERROR, under which a controller reports it.
    """

    code: Final = hresult.SYNTAX_ERROR

    def __init__(self, message: str, file: str, line: int, column: int) -> None:
        super().__init__(message, file, line, column)
        self.message = message
        self.file = file
        self.line = line
        self.column = column

    def __str__(self) -> str:
        return f"{self.file}:{self.line}:{self.column}: {self.message}"


class ProgramFault(Exception):
    """What stopped a program while it ran.

    Attributes:
        code: the return code, unsigned 32 bits.
        file: name of the file.
        line: the line it happened in, counted from 1.
        detail: what else is known.
    """

    def __init__(self, code: int, file: str, line: int, detail: str = "") -> None:
        code = hresult.unsigned(code)
        super().__init__(code, file, line, detail)
        self.code = code
        self.file = file
        self.line = line
        self.detail = detail

    def __str__(self) -> str:
        info = hresult.lookup(self.code)
        detail = f" [{self.detail}]" if self.detail else ""
        return f"{self.file}:{self.line}: 0x{self.code:08X} {info.name}: {info.text}{detail}"


class CompileError(Exception):
    """A place of the source and what is wrong there; loading makes a :class:`PacScriptError` of it."""

    def __init__(self, message: str, at: tuple[int, int]) -> None:
        super().__init__(message, at)
        self.message = message
        self.at = at


def not_supported(word: str, at: tuple[int, int]) -> CompileError:
    """Return the refusal of something that PacScript has and this interpreter has not."""
    return CompileError(tr("{word} is not supported here", word=word), at)


def mismatch(text: str) -> CallError:
    """Return the error of a value of the wrong type."""
    return error_for(hresult.VARIABLE_CHANGE_FAILED, text)


def out_of_range(text: str) -> CallError:
    """Return the error of a value that is too large, too small or not defined."""
    return error_for(hresult.VALUE_OUT_OF_RANGE, text)
