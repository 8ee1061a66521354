"""The optional extension in C: choosing it, and its runs with sanitizers."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from orinkit.bcap import requests
from orinkit.core import i18n, speedups
from orinkit.values import codec
from support.speedups import needs_extension

ROOT = Path(__file__).parents[2]
PROGRAM = (
    "from orinkit.core import speedups; from orinkit.values import codec; print(speedups.status()); print(codec.encode)"
)


def in_process(**variables: str) -> list[str]:
    environment = {name: value for name, value in os.environ.items() if name != "ORINKIT_PURE"} | variables
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        env=environment | {"ORINKIT_LANG": "en"}, capture_output=True, text=True, timeout=300, check=True,
    )  # fmt: skip
    return done.stdout.splitlines()


@needs_extension
def test_the_extension_is_used():
    first, second = in_process(ORINKIT_PURE="0")
    assert first == "C extension: in use"
    assert "built-in" in second


def test_the_extension_is_disabled_by_the_environment():
    first, second = in_process(ORINKIT_PURE="1")
    assert first == "C extension: disabled by ORINKIT_PURE"
    assert second.startswith("<function encode")


def test_the_reason_is_stated(monkeypatch):
    monkeypatch.setattr(speedups, "EXTENSION", None)
    monkeypatch.setattr(speedups, "_reason", "No module named 'orinkit.core._speedups'")
    assert speedups.status().startswith("C extension: not built. Try: install a C compiler")
    i18n.use("ja")
    assert "対処" in speedups.status()


@needs_extension
def test_each_function_in_c_has_a_counterpart_in_python():
    import orinkit.transport.direct

    names = set(speedups.PURE)
    assert names == {
        "encode", "encode_variant", "encode_integer", "encode_string", "encode_single", "decode",
        "encode_request", "call", "call_prepared",
    }  # fmt: skip
    for name in names:
        module = (
            orinkit.transport.direct if name.startswith("call") else requests if name == "encode_request" else codec
        )
        assert getattr(module, name) is not speedups.PURE[name] or not hasattr(speedups.EXTENSION, name)


@pytest.mark.soak
@pytest.mark.timeout(3600)
def test_the_extension_with_sanitizers():
    """The tests of the extension pass when it is compiled with AddressSanitizer and UndefinedBehaviorSanitizer."""
    command = [sys.executable, "tools/sanitize.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=3500, check=False)
    if done.returncode == 77:
        pytest.skip(done.stdout)
    assert done.returncode == 0, done.stdout + done.stderr
