"""Errors in programs, with their lines: :class:`ProgramProblem`."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from orinkit.client._shared.common import ErrorInfo, is_program
from orinkit.core import hresult
from orinkit.core.errors import CallError
from orinkit.core.i18n import cut

_PLACE = re.compile(r"(?P<file>[^:]+):(?P<line>\d{1,7}):(?:(?P<column>\d{1,7}):)? ?(?P<text>.*)", re.DOTALL)
_LONGEST = 300


@dataclass(frozen=True, slots=True)
class ProgramProblem:
    """An error in a program.

    Attributes:
        line: Line, counted from 1.
        text: Description by the controller.
        code: Return code.
    """

    line: int
    text: str
    code: int


def problem_of_start(error: CallError, task: str, present: Iterable[ErrorInfo]) -> ProgramProblem | None:
    """Return the error in a program that a controller has refused to start.

    Args:
        error: The error of Task_Start. Its detail is the text from the error log, ``Pro1.pcs:3:5: TEXT``.
        task: Name of the task.
        present: The errors present on the controller; one of them may contain the line instead.
    """
    place = _PLACE.match(error.detail or "")
    if place and is_program(place["file"], task):
        return ProgramProblem(int(place["line"]), cut(place["text"], _LONGEST), error.code)
    return problem_of_run(task, present)


def problem_of_run(task: str, present: Iterable[ErrorInfo]) -> ProgramProblem | None:
    """Return the newest error that has ended a program, of the errors present on the controller."""
    for each in present:
        if each.line > 0 and is_program(each.program, task):
            text = each.message or hresult.lookup(each.code).text
            return ProgramProblem(each.line, cut(text, _LONGEST), each.code)
    return None
