"""A plugin for an installation without extras (``-p support.bare``): tests that require one are skipped, all others must pass."""

from __future__ import annotations

from collections.abc import Generator
from pathlib import Path
from typing import Any

import pytest

EXTRAS = (
    "numpy",
    "lark",
    "matplotlib",
    "ruckig",
    "mcap",
    "serialx",
    "httpx2",
    "starlette",
    "uvicorn",
    "can",
    "msgpack",
    "serial",
    "cantools",
    "uvloop",
    "babel",
)
MARKS = ("MissingExtra", *(f"No module named '{name}" for name in EXTRAS))


class BareModule(pytest.Module):
    """A test module that is skipped if it imports a package of an extra that is not installed."""

    def _getobj(self) -> Any:
        try:
            return super()._getobj()
        except self.CollectError as error:
            if any(mark in str(error) for mark in MARKS):
                pytest.skip("needs an extra", allow_module_level=True)
            raise


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module:
    module: pytest.Module = BareModule.from_parent(parent, path=module_path)
    return module


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(
    item: pytest.Item, call: pytest.CallInfo[None]
) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and any(mark in str(report.longrepr) for mark in MARKS):
        report.outcome = "skipped"
        report.longrepr = (str(item.path), 0, "needs an extra")
    return report
