"""The table of VARIANT types: each row works everywhere, and a new type requires only a member and a row."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import orinkit
from orinkit.bcap import dissect, packet
from orinkit.cao import coerce
from orinkit.cao.functions import variable_put_value
from orinkit.cao.quota import stored_size
from orinkit.core.errors import InvalidValue, LimitExceeded, MissingExtra
from orinkit.device.declarations import variable as declared
from orinkit.ecap.message import read_request, write_request
from orinkit.rc8.pose_arguments import read_targets
from orinkit.values import codec
from orinkit.values.notation import format_variant, parse
from orinkit.values.type_row import TypeRow
from orinkit.values.types import ARRAY, BY_DTYPE, INTEGERS, NUMERIC, REALS, TABLE, UI1_ARRAY, VarType, type_name
from orinkit.values.variant import VARIANT_ARRAY, Variant, trusted, variant
from support.paths import ROOT
from support.strategies import same

pytestmark = pytest.mark.core

by_row = pytest.mark.parametrize("row", TABLE, ids=lambda row: row.name)


def content(row: TypeRow) -> Any:
    """Return the content of a value of the type."""
    if row.text is None:
        return {"VT_BSTR": "text"}.get(row.name)
    found = row.text.read("2026-11-21 10:00:00")
    return row.text.read("1") if found is None else found


def contents(row: TypeRow) -> list[Variant]:
    """Return VARIANTs of the type: a single value, arrays of it, and both in a VARIANT array."""
    if row.code == VarType.VARIANT:
        values = [Variant(VARIANT_ARRAY, []), Variant(VARIANT_ARRAY, [1, "a"])]
    elif row.empty:
        values = [Variant(row.code)]
    else:
        one = content(row)
        values = [Variant(row.code, one), Variant(row.code | ARRAY, []), Variant(row.code | ARRAY, [one, one])]
    return [*values, Variant(VARIANT_ARRAY, values)]


def test_each_type_has_one_row():
    assert [row.code for row in TABLE] == [vt for vt in VarType if vt is not VarType.ARRAY]


@by_row
def test_bytes_both_ways(row):
    for value in contents(row):
        data = codec.encode_variant(value)
        assert same(codec.decode(data, exact=True), (value, len(data)))
        assert same(codec.decode(data)[0], value.plain)
        assert row.code == VarType.BSTR or value.type & ~ARRAY != row.code or stored_size(value) == len(data) - 4


@by_row
def test_text_both_ways(row):
    for value in contents(row):
        assert same(parse(format_variant(value)), value)


@by_row
def test_a_packet_is_explained(row):
    for value in contents(row):
        frame = packet.encode(packet.Packet(1, variable_put_value.id, [3, value]))
        fields = dissect.explain(frame)
        assert dissect.first_error(fields) is None
        assert any(field.meaning.startswith(f"{type_name(value.type)} (") for field in fields)
        assert "?" not in dissect.one_line(frame)


@by_row
def test_a_request_over_http(row):
    for value in contents(row):
        request = read_request(write_request(variable_put_value, (3, value)))
        assert same(request.arguments[1], value)


@by_row
def test_python_and_numpy_values_become_the_type(row):
    if row.python is not None:
        value = content(row)
        assert isinstance(value, row.python)
        assert same(variant(value), trusted(row.code, value))
        if not row.empty:
            assert variant([value, value]).type == row.code | ARRAY
    np = pytest.importorskip("numpy") if row.dtypes else None
    for dtype in row.dtypes:
        assert variant(np.zeros(2, dtype)).type == row.code | ARRAY


def test_no_dtype_is_in_two_rows():
    assert len(BY_DTYPE) == sum(len(row.dtypes) for row in TABLE)


@by_row
def test_values_that_do_not_fit_are_refused(row):
    if row.code == VarType.VARIANT:
        return
    for vt, value in ((row.code, object()), (row.code | ARRAY, object())):
        with pytest.raises(InvalidValue, match=f"^{'' if row.empty and vt & ARRAY else '<object'}.*VT_"):
            Variant(vt, value)


@by_row
def test_whole_numbers_have_bounds(row):
    if row.bounds is None:
        assert row.number_kind not in {"integer", "code"}
        return
    low, high = row.bounds
    assert [Variant(row.code, each).value for each in row.bounds] == [low, high]
    for beyond in (low - 2**32, high + 1):
        with pytest.raises(InvalidValue, match=rf"does not fit {row.name} \({low} to {high}\)"):
            Variant(row.code, beyond)


@by_row
def test_elements_count_against_the_limit(row):
    if row.empty:
        return
    element = Variant(VarType.EMPTY) if row.code == VarType.VARIANT else content(row)
    data = codec.encode_variant(Variant(row.code | ARRAY, [element] * 64))
    counted = 64 // row.elements_per_unit
    codec.decode(data, limits=codec.PacketLimits(variants=counted), exact=True)
    if counted:
        with pytest.raises(LimitExceeded):
            codec.decode(data, limits=codec.PacketLimits(variants=counted - 1), exact=True)


@by_row
def test_arguments_accept_all_numeric_types(row):
    assert (row.code in INTEGERS, row.code in REALS) == (row.number_kind == "integer", row.number_kind == "real")
    assert (row.code in NUMERIC) == (row.number_kind in {"integer", "real", "decimal"})
    if row.code == VarType.VARIANT:
        return
    conversion = pytest.importorskip("orinkit.virtual.rc8.variables.conversion", exc_type=MissingExtra)
    one = Variant(row.code, content(row))
    if row.number_kind:
        assert coerce.to_number(one) == coerce.to_real(one) == 1
    if row.number_kind in {"integer", "real"}:
        assert conversion.singles(2)(Variant(row.code | ARRAY, [1, 1])) == (1, 1)
    if row.code in NUMERIC:
        assert conversion.number(one) == conversion.double(one) == 1
        assert conversion.singles(2)(Variant(VARIANT_ARRAY, [one, one])) == (1, 1)
        assert read_targets(Variant(row.code | ARRAY, [1] * 7))[0].value == (1,) * 7
    if row.number_kind == "integer" and row.size in (2, 4):
        assert coerce.to_handle(one) == 1


def test_an_array_of_ui1_is_bytes():
    assert Variant(UI1_ARRAY, [1, 2]).value == b"\1\2"


@by_row
def test_a_declared_variable_has_the_type_of_its_annotation(row):
    if row.empty or row.python is None or row.name == "VT_CY":
        return

    def getter(self: object) -> Any:
        """Never called: the decorator reads only the annotation."""

    getter.__annotations__["return"] = row.python
    assert declared("V")(getter).type == row.code


# --- the documentation ------------------------------------------------------------------------------------------------


def line_of(row: TypeRow) -> str:
    """Return the row of the table in docs/protocol.md."""
    python = "" if row.python is None else f"`{'None' if row.empty else row.python.__name__}`"
    np = pytest.importorskip("numpy")
    numpy = ", ".join("str" if dtype == "U" else np.dtype(dtype).name for dtype in row.dtypes)
    counted = "" if row.empty else "any number" if row.elements_per_unit > 1000 else str(row.elements_per_unit)
    text = row.text.wanted if row.text else ""
    return f"| {row.name} | {int(row.code)} | {row.size or ''} | {python} | {numpy} | {counted} | {text} |".replace(
        "  ", " "
    )


@by_row
def test_the_documentation_has_the_row(row):
    page = (ROOT / "docs" / "protocol.md").read_text(encoding="utf-8").splitlines()
    assert line_of(row) in page, f"docs/protocol.md, VARIANT types, lacks the line\n{line_of(row)}"


# --- a new type -------------------------------------------------------------------------------------------------------

MEMBERS = "    INT = 22\n    SPAN = 64\n"
ROWS = """\
    _integer(VarType.INT, "i"),
    TypeRow(
        VarType.SPAN, conversions.span, "q", python=timedelta, to_wire=lambda span: span // timedelta(microseconds=1),
        from_wire=lambda us: timedelta(microseconds=us), text=notation_numbers.ElementFormat(
            lambda text: timedelta(microseconds=int(text)) if text.isdecimal() else None,
            lambda span: str(span // timedelta(microseconds=1)), "microseconds"),
    ),
"""
CHECK = """

def span(row: TypeRow, value: Any) -> timedelta:
    if not isinstance(value, timedelta):
        raise row.misfit(value)
    return value
"""


def insert(path: Path, text: str, behind: str) -> None:
    source = path.read_text(encoding="utf-8")
    assert source.count(behind) == 1
    path.write_text(source.replace(behind, behind + text), encoding="utf-8")


def test_a_new_type_is_a_member_and_a_row(tmp_path):
    """The tests above pass with two additional types: the source contains no other list of types."""
    source = tmp_path / "src"
    shutil.copytree(Path(orinkit.__file__).parent, source / "orinkit", ignore=shutil.ignore_patterns("__pycache__"))
    values = source / "orinkit" / "values"
    insert(values / "types.py", MEMBERS, "    UI8 = 21\n")
    insert(values / "types.py", ROWS, '    _integer(VarType.UI8, "Q"),\n')
    insert(values / "types.py", ", timedelta", "from datetime import datetime")
    insert(values / "conversions.py", CHECK, "        else days\n    )\n")
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__, "-k", "INT or SPAN or each_type"],
        cwd=ROOT, env={**os.environ, "PYTHONPATH": str(source)}, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    failed = [line for line in done.stdout.splitlines() if line.startswith("FAILED")]
    assert len(failed) == 2, done.stdout + done.stderr
    assert all("test_the_documentation_has_the_row" in line for line in failed), done.stdout
