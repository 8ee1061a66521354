"""The optional extension in C: choosing it, and its runs with sanitizers."""

from __future__ import annotations

import hashlib
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from orinkit.bcap import requests
from orinkit.core import i18n, speedups
from orinkit.values import codec
from support.speedups import needs_extension

ROOT = Path(__file__).parents[2]
PROGRAM = (
    "from orinkit.core import speedups; from orinkit.values import codec; print(speedups.status()); print(codec.encode)"
)
INTERFACE = {4: "26981c126706fd2d"}
"""Number of the interface between C and Python, and a digest of it: functions, attributes, formats of arguments."""
OTHER_VERSION = "import orinkit.core._speedups as other; {change}; "


def in_process(program: str = PROGRAM, **variables: str) -> list[str]:
    environment = {name: value for name, value in os.environ.items() if name != "ORINKIT_PURE"} | variables
    done = subprocess.run(
        [sys.executable, "-c", program],
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
@pytest.mark.parametrize("change", ["other.INTERFACE += 1", "del other.INTERFACE"])
def test_an_extension_of_another_version_is_not_used(change):
    first, second = in_process(OTHER_VERSION.format(change=change) + PROGRAM, ORINKIT_PURE="0")
    assert first.startswith(
        "C extension: not in use, because it was built from another version of orinkit. Try: rebuild:"
    )
    assert second.startswith("<function encode")


def test_the_number_of_the_interface_is_the_same_in_c():
    header = (ROOT / "csrc" / "speedups.h").read_text(encoding="utf-8")
    assert f"#define INTERFACE {speedups.INTERFACE}\n" in header


def test_a_change_of_the_interface_has_a_new_number():
    """Otherwise, an extension that was built before the change would be used, and would fail."""
    sources = "".join(path.read_text(encoding="utf-8") for path in sorted((ROOT / "csrc").glob("*.[ch]")))
    functions = re.findall(r'{"(\w+)", [^}]*METH_[^}]*}', sources)
    (names,) = re.findall(r"ATTRIBUTE_NAMES.* = {([^}]*)}", sources)
    attributes = re.findall(r'"(\w+)"', names)
    formats = re.findall(r'PyArg_ParseTuple\(\w+, "([^"]*)"', sources)
    counts = re.findall(r"return (keep\(.*\));", sources)
    assert len(functions) > 10 < len(attributes)
    interface = json.dumps([sorted(functions), sorted(attributes), sorted(formats), sorted(counts)])
    digest = hashlib.sha256(interface.encode()).hexdigest()[:16]
    assert {speedups.INTERFACE: digest} == INTERFACE, (
        f"increase INTERFACE in csrc/speedups.h and core/speedups.py; its digest is {digest}: {interface}"
    )


@needs_extension
def test_each_function_in_c_has_a_counterpart_in_python():
    import orinkit.client._sync.client
    import orinkit.transport.direct

    names = set(speedups.PURE)
    assert names == {
        "encode", "encode_variant", "encode_integer", "encode_string", "encode_single", "decode",
        "encode_request", "call", "call_prepared", "call_prepared_by_client",
    }  # fmt: skip
    for name in names:
        module: Any = {
            "call": orinkit.transport.direct, "call_prepared": orinkit.transport.direct,
            "call_prepared_by_client": orinkit.client._sync.client, "encode_request": requests,
        }.get(name, codec)  # fmt: skip
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
