from __future__ import annotations

import pytest

from orinkit.core import i18n
from orinkit.values.variant import variant
from orinkit.virtual.rc8 import Permission, StateError, VirtualRC8


def texts(device: VirtualRC8, connect) -> list[str]:
    controller = connect(device=device)
    device.raise_error(0x84201482)
    device.set_mode(1)
    device.emergency_stop(True)
    device.emergency_stop(False)
    controller.get_variable("@LOCK", "").put_value(variant(True))
    controller.get_variable("@LOCK", "").put_value(variant(False))
    device.pendant.set_time(controller.get_variable("@CURRENT_TIME", "").get_value().plain)
    controller.execute("ClearError", variant(None))
    descriptions = [controller.get_message().get_description() for _ in range(4)]
    operations = [device.state.operations.at(i).text for i in range(len(device.state.operations))]
    helps = [controller.get_variable(name, "").get_help() for name in controller.get_variable_names("")]
    helps += [controller.get_variable(f"IO{n}", "").get_help() for n in (0, 16, 32, 48, 64, 128)]
    codes = [0, 0x84201482, 12345]
    described = [controller.execute("GetErrorDescription", variant(code)) for code in map(_signed, codes)]
    described.append(controller.get_variable("@ERROR_DESCRIPTION", "").get_value().value)
    return [controller.get_help(), *descriptions, *operations, *helps, *described]


def _signed(code: int) -> int:
    return code - 2**32 if code >= 2**31 else code


def japanese(text: str) -> bool:
    return any("\u3040" <= sign <= "\u9fff" for sign in text)


def test_every_text_in_both_languages(connect):
    english, nippon = texts(VirtualRC8(language="en"), connect), texts(VirtualRC8(language="ja"), connect)
    assert len(english) == len(nippon)
    for en, ja in zip(english, nippon, strict=True):
        assert en
        assert not japanese(en)
        assert japanese(ja), ja


def test_the_default_is_the_language_of_the_process(connect):
    device = VirtualRC8()
    controller = connect(device=device)
    assert controller.execute("GetErrorDescription", variant(0)) == "Success"
    i18n.use("ja")
    assert controller.execute("GetErrorDescription", variant(0)) == "正常終了"
    assert connect(device=VirtualRC8(language="en")).execute("GetErrorDescription", variant(0)) == "Success"


def test_an_invalid_language():
    with pytest.raises(ValueError, match="language"):
        VirtualRC8(language="fr")


def test_messages_to_the_person_who_starts_it(tmp_path):
    (tmp_path / "variables.sqlite3").write_bytes(b"no database at all, certainly not one" * 10)
    i18n.use("ja")
    with pytest.raises(StateError, match="変更していません"):
        VirtualRC8(state=tmp_path)
    with pytest.raises(ValueError, match="権限"):
        Permission("all")
    with pytest.raises(ValueError, match="変数クラス"):
        VirtualRC8(counts={"X": 1})
