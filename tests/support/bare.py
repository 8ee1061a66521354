"""A plugin for an installation without extras (``--no-extras``): tests that require one are skipped, all others must pass."""

from __future__ import annotations

import sys
from collections.abc import Generator, Iterator, Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

import pytest

from orinkit.core.errors import MissingExtra

EXTRAS = (
    "numpy",
    "lark",
    "matplotlib",
    "ruckig",
    "mcap",
    "serialx",
    "httpx2",
    "httpcore2",
    "starlette",
    "uvicorn",
    "h11",
    "can",
    "msgpack",
    "serial",
    "cantools",
    "uvloop",
    "babel",
    "nicegui",
    "PIL",
    "playwright",
)
MARKS = ("Try: pip install 'orinkit[", *(f"No module named '{name}" for name in EXTRAS))


class NoExtras:
    """A finder that hides the packages of the extras; without it, ``import can`` would find the folder ``tests/can``."""

    @classmethod
    def find_spec(
        cls, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name.partition(".")[0] in EXTRAS:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def pytest_configure() -> None:
    sys.meta_path.insert(0, NoExtras)


def chain(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an exception and those that led to it."""
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def needs_extra(call: pytest.CallInfo[object] | None) -> bool:
    """Return True if a call failed for lack of an extra, in this process or in one whose output the error contains."""
    errors = chain(call.excinfo.value if call is not None and call.excinfo is not None else None)
    return any(isinstance(error, MissingExtra) or any(mark in str(error) for mark in MARKS) for error in errors)


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(
    collector: pytest.Collector,
) -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    report = yield
    if report.failed and needs_extra(report.call):
        report.outcome = "skipped"
        report.longrepr = (str(collector.path), 0, "needs an extra")
    return report


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and needs_extra(call):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), 0, "needs an extra")
    return report
