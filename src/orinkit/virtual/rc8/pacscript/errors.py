"""Errors of programs: :class:`ProgramLoadError` at load, :class:`ProgramFault` at run time."""

from __future__ import annotations

from typing import Final

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr


class ProgramLoadError(ValueError):
    """A program cannot be loaded.

    Attributes:
        message: Description, in the language that was current when the error was found.
        file: Name of the file.
        line: Line, counted from 1.
        column: Column in characters, counted from 1.
        code: SYNTAX_ERROR, the return code with which a controller reports the error.
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
    """A run-time error that stopped a program.

    Attributes:
        code: Return code, unsigned 32 bits.
        file: Name of the file.
        line: Line of the failed statement, counted from 1.
        detail: Further details, or ``""``.
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
    """An error at a position of the source; functions that load a program raise it as a :class:`ProgramLoadError`."""

    def __init__(self, message: str, at: tuple[int, int]) -> None:
        super().__init__(message, at)
        self.message = message
        self.at = at


def not_supported(word: str, at: tuple[int, int]) -> CompileError:
    """Return the error for a word of PacScript that this interpreter does not support."""
    return CompileError(tr("{word} is not supported", word=word), at)


def mismatch(text: str) -> CallError:
    """Return the error for a value of the wrong type."""
    return error_for(hresult.VARIABLE_CHANGE_FAILED, text)


def out_of_range(text: str) -> CallError:
    """Return the error for a value that is too large, too small or undefined."""
    return error_for(hresult.VALUE_OUT_OF_RANGE, text)
