"""The table of return codes: completeness, consistency, both languages, and a result for every 32-bit number."""

from __future__ import annotations

import copy
import pickle
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orinkit.core import _hresult_controller, _hresult_orin, hresult, i18n
from orinkit.core.hresult import CODES, CodeFamily, ReturnCode, by_name, family, lookup

pytestmark = pytest.mark.core

JAPANESE = re.compile("[぀-ヿ一-鿿]")

# Names as the documents and published clients spell them.
ORIN = {
    0x00000000: "S_OK",
    0x00000001: "S_FALSE",
    0x00000900: "S_EXECUTING",
    0x80000200: "E_CAO_SEM_CREATE",
    0x80000201: "E_CAO_PROV_INVALID",
    0x80000202: "E_CAO_COMPUTER_NAME",
    0x80000203: "E_CAO_VARIANT_TYPE_NOSUPPORT",
    0x80000204: "E_CAO_OBJECT_NOTFOUND",
    0x80000205: "E_CAO_COLLECTION_REGISTERED",
    0x80000207: "E_CAO_THREAD_CREATE",
    0x80000208: "E_CAO_REMOTE_ENGINE",
    0x80000209: "E_CAO_REMOTE_PROVIDER",
    0x8000020A: "E_CAO_NOT_WRITABLE",
    0x8000020B: "E_CAO_CMD_EXECUTE",
    0x8000020C: "E_CAO_PROV_NO_LICENSE",
    0x8000020D: "E_CAO_PRELOAD",
    0x80000400: "E_CRDIMPL",
    0x80000401: "E_CAOP_SYSTEMNAME_INVALID",
    0x80000402: "E_CAOP_SYSTEMTYPE_INVALID",
    0x80000403: "E_CANCEL",
    0x80000404: "E_CAOP_NOT_WRITABLE",
    0x80000900: "E_TIMEOUT",
    0x80000901: "E_NO_LICENSE",
    0x80000902: "E_NOT_CONNECTED",
    0x80000903: "E_NOT_USE",
    0x80000904: "E_INVALID_CMD_NAME",
    0x80000905: "E_MAX_OBJECT",
    0x80000906: "E_ALREADY_REGISTER",
    0x80000909: "E_TOO_MUCH_DATA",
    0x8000090B: "E_MAX_CONNECT",
    0x80004001: "E_NOTIMPL",
    0x80004003: "E_POINTER",
    0x80004004: "E_ABORT",
    0x80004005: "E_FAIL",
    0x8000FFFF: "E_UNEXPECTED",
    0x80010000: "E_INVALIDPACKET",
    0x80010001: "E_INVALIDRCVPACKET",
    0x80010002: "E_INVALIDSNDPACKET",
    0x80010003: "E_INVALIDARGTYPE",
    0x80010004: "E_ROBOTISBUSY",
    0x80010005: "E_INVALIDCOMMAND",
    0x80010011: "E_PACKETSIZEOVER",
    0x80010012: "E_ARGSIZEOVER",
    0x80020005: "DISP_E_TYPEMISMATCH",
    0x80020008: "DISP_E_BADVARTYPE",
    0x8002000A: "DISP_E_OVERFLOW",
    0x8002000B: "DISP_E_BADINDEX",
    0x80070005: "E_ACCESSDENIED",
    0x80070006: "E_HANDLE",
    0x8007000E: "E_OUTOFMEMORY",
    0x80070057: "E_INVALIDARG",
    0x800706BE: "RPC_S_CALL_FAILED",
    0x809100AA: "E_BUSY_PROC",
}

# Controller codes one by one.
CONTROLLER_DIGITS = """
    0F200501 83201483 84201482 84201486 84201414 84201415
    83201501 81201503 83201504 81201506 80201418 83201401 81201519 83600015 81201408 83201411 83201582 83201602 83201530
    83500121 83501032 83501033 81500177 83500126 83500009
    81501001 81501003 81501005 8150100A 8150100B 8150100D 8150100F 81501012 81501013 81501016 81501017
    8150101A 83500178 8150101C 81501022 81501020 81501021 82500004 82500005 82501009 83501024 83500042 83500079 81501025
    83501026 83501027 83501028 83501029 8350102A 8350102B 8350102C 8350102D 8350102E
    8350106E 83500160 83500161 83500188 83500008 8350010F 83500110 83500076 8350103F 83501041
    81501069 81501070 83500372 81501078 83201404 81501011 8350048F
    83500001 83500002 83500127 81500013 81500014 8150001B 8150001C 8150001D 81500018 81500029 81500053 83500040 81500041
    8150001E 8150001F 81500020 81500021 81500022 81500023 81500024 81500025 81500026 81500027
    83500118 83500032 83500112 83500115 83500037 80501043 80501044 83500168
    81500142 81500144 81500145 81500146 8150014A 8150014B 8150014C 81500151 81500153 81500155 81500157 8150015A
    83500156 8350013F
    803022EF 83503005 83502006 83503023 83503003 83503013 83500176
"""
CONTROLLER = CONTROLLER_DIGITS.split()

# The last digit is the axis.
PER_AXIS_DIGITS = """
    8420404 8420405 8420406 8420408 8420409 842040A 8320407 8320423 8220401 8220402
    832040B 8440451 844044B 8440454 8440453
"""
PER_AXIS = PER_AXIS_DIGITS.split()

AXES = range(1, 9)


@pytest.fixture(autouse=True)
def english():
    before = i18n.current()
    i18n.use("en")
    yield
    i18n.use(before)


@pytest.mark.parametrize("value", ORIN)
def test_orin_codes_have_the_names_of_the_documents(value):
    assert CODES[value].name == ORIN[value]


@pytest.mark.parametrize("digits", CONTROLLER)
def test_controller_codes_are_known(digits):
    assert CODES[int(digits, 16)].value == int(digits, 16)


@pytest.mark.parametrize("digits", PER_AXIS)
def test_per_axis_codes_are_known_for_eight_axes_and_name_the_axis(digits):
    stems = set()
    for axis in AXES:
        code = CODES[int(f"{digits}{axis}", 16)]
        assert code.name.endswith(f"_AXIS{axis}")
        assert code.en.startswith(f"Axis {axis}: ")
        assert code.ja.startswith(f"第{axis}軸: ")
        stems.add(code.name[:-1])
    assert len(stems) == 1


def test_nothing_else_is_in_the_table():
    listed = set(ORIN) | {int(d, 16) for d in CONTROLLER} | {int(f"{d}{axis}", 16) for d in PER_AXIS for axis in AXES}
    assert set(CODES) == listed


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("S_BUF_FULL", 0x0F200501),
        ("E_BUF_FULL", 0x83201483),
        ("COMMAND_DELAY", 0x84201482),
        ("SLAVE_MODE_OFF", 0x83500121),
        ("REFUSED_IN_SLAVE_MODE", 0x83501032),
        ("MOTOR_NOT_ON", 0x81501003),
        ("ARM_NOT_TAKEN", 0x83501024),
        ("COMMAND_ACCELERATION_OVER_AXIS3", 0x84204043),
        ("ARGUMENT_1_INVALID", 0x8150001E),
        ("ARGUMENT_10_INVALID", 0x81500027),
        ("START_RIGHT_NOT_ETHERNET", 0x83501028),
        ("NO_WRITE_RIGHT", 0x80501044),
    ],
)
def test_names_that_program_code_uses(name, value):
    assert by_name(name).value == value


def test_the_mapping_key_is_the_value_and_no_code_occurs_twice():
    rows = len(_hresult_orin.ROWS) + len(_hresult_controller.ROWS) + sum(run[1] for run in _hresult_controller.RUNS)
    assert len(CODES) == rows
    assert all(code.value == value for value, code in CODES.items())


def test_the_table_cannot_be_changed():
    with pytest.raises(TypeError):
        CODES[0] = CODES[1]
    with pytest.raises(AttributeError):
        CODES[0].name = "OTHER"


def test_names_are_unique_upper_case_identifiers():
    names = [code.name for code in CODES.values()]
    assert len(set(names)) == len(names)
    assert [name for name in names if not re.fullmatch(r"[A-Z][A-Z0-9_]*", name)] == []


def constants():
    return {k: v for k, v in vars(hresult).items() if k.isupper() and not k.startswith("_") and type(v) is int}


def test_every_constant_is_the_entry_of_that_name():
    assert {name: by_name(name).value for name in constants()} == constants()


def test_every_code_is_a_constant_except_the_later_ones_of_a_run():
    later = {run[0] + n for run in _hresult_controller.RUNS for n in range(2, run[1] + 1)}
    assert set(constants().values()) == set(CODES) - later


@pytest.mark.parametrize("code", CODES.values(), ids=lambda code: code.name)
def test_texts_exist_in_both_languages(code):
    assert code.en.isascii()
    assert code.en == code.en.strip() != ""
    assert JAPANESE.search(code.ja)
    assert code.en[-1] not in ".!"
    assert code.ja[-1] not in "。.！"
    assert bool(code.hint_en) == bool(code.hint_ja)
    if code.hint_en:
        assert code.hint_en.isascii()
        assert code.hint_en.endswith(".")
        assert JAPANESE.search(code.hint_ja)
        assert code.hint_ja.endswith("。")


def test_texts_of_controller_codes_are_unique():
    controller = [code for code in CODES.values() if code.value >> 16 not in range(0x8000, 0x8010)]
    for texts in ([code.en for code in controller], [code.ja for code in controller]):
        assert sorted(text for text in set(texts) if texts.count(text) > 1) == []


def test_all_hints_are_used():
    of_ranges = {"packet", "network"}
    assert {row[4] for row in _hresult_orin.ROWS} | of_ranges == set(_hresult_orin.HINTS)
    rows = {row[4] for row in _hresult_controller.ROWS}
    rows |= {run[5] for run in _hresult_controller.RUNS} | set(_hresult_controller.LEVEL_HINTS.values())
    assert rows == set(_hresult_controller.HINTS)


def test_text_and_hint_follow_the_current_language():
    code = by_name("MOTOR_NOT_ON")
    assert (code.text, code.hint) == (code.en, code.hint_en)
    i18n.use("ja")
    assert (code.text, code.hint) == (code.ja, code.hint_ja)
    assert JAPANESE.search(code.text)
    assert JAPANESE.search(code.hint)


@pytest.mark.parametrize(
    ("value", "expected"),
    [
        (0x00000000, CodeFamily.SUCCESS),
        (0x00000900, CodeFamily.SUCCESS),
        (0x0F200501, CodeFamily.SUCCESS),
        (0x7FFFFFFF, CodeFamily.SUCCESS),
        (0x800001FF, CodeFamily.GENERAL),
        (0x80000200, CodeFamily.CAO),
        (0x800002FF, CodeFamily.CAO),
        (0x80000300, CodeFamily.GENERAL),
        (0x80000404, CodeFamily.CAO),
        (0x800008FF, CodeFamily.GENERAL),
        (0x80000900, CodeFamily.CAO),
        (0x800009FF, CodeFamily.CAO),
        (0x80000A00, CodeFamily.GENERAL),
        (0x80004001, CodeFamily.GENERAL),
        (0x8000FFFF, CodeFamily.GENERAL),
        (0x80010000, CodeFamily.PACKET),
        (0x800101FF, CodeFamily.PACKET),
        (0x80010200, CodeFamily.USER),
        (0x8001FFFF, CodeFamily.USER),
        (0x80020000, CodeFamily.GENERAL),
        (0x80020005, CodeFamily.GENERAL),
        (0x800401FF, CodeFamily.GENERAL),
        (0x80040200, CodeFamily.USER),
        (0x8004FFFF, CodeFamily.USER),
        (0x80050000, CodeFamily.GENERAL),
        (0x80070057, CodeFamily.GENERAL),
        (0x800FFFFF, CodeFamily.GENERAL),
        (0x80100000, CodeFamily.CONTROLLER),
        (0x803022EF, CodeFamily.CONTROLLER),
        (0x80201418, CodeFamily.MOTION),
        (0x84201482, CodeFamily.MOTION),
        (0x84404511, CodeFamily.SERVO),
        (0x83480001, CodeFamily.SAFETY),
        (0x83490001, CodeFamily.SAFETY),
        (0x834A0001, CodeFamily.SAFETY),
        (0x834B0001, CodeFamily.CONTROLLER),
        (0x80501043, CodeFamily.PROGRAM),
        (0x83501032, CodeFamily.PROGRAM),
        (0x81580001, CodeFamily.OPTION),
        (0x83600015, CodeFamily.LANGUAGE),
        (0x82800001, CodeFamily.PENDANT),
        (0x80900000, CodeFamily.CONTROLLER),
        (0x80910000, CodeFamily.SOCKET),
        (0x809100A9, CodeFamily.SOCKET),
        (0x809100AA, CodeFamily.BUSY),
        (0x809100AB, CodeFamily.SOCKET),
        (0x8091274C, CodeFamily.SOCKET),
        (0x80920000, CodeFamily.CONTROLLER),
        (0x81910001, CodeFamily.CONTROLLER),
        (0x85FFFFFF, CodeFamily.CONTROLLER),
        (0x86000000, CodeFamily.UNKNOWN),
        (0xC0000005, CodeFamily.UNKNOWN),
        (0xFFFFFFFF, CodeFamily.UNKNOWN),
    ],
)
def test_family_by_range(value, expected):
    assert family(value) is expected
    assert family(hresult.signed(value)) is expected
    assert lookup(value).family is expected


@pytest.mark.parametrize(
    ("value", "level"),
    [
        (0x80201418, 0),
        (0x81501003, 1),
        (0x82500004, 2),
        (0x83201483, 3),
        (0x84201482, 4),
        (0x85401234, 5),
        (0x00000000, 0),
        (0x0F200501, 0),
        (0x80070057, 0),
        (0x809100AA, 0),
        (0x8491000A, 4),
        (0xC4000005, 0),
    ],
)
def test_level_of_controller_codes_only(value, level):
    assert lookup(value).level == level


@pytest.mark.parametrize("value", [0, 1, 0x900, 0x0F200501, 0x7FFFFFFF])
def test_codes_without_the_sign_bit_are_successes(value):
    assert not hresult.failed(value)
    assert not lookup(value).failed
    assert hresult.signed(value) == value


@pytest.mark.parametrize(
    ("value", "as_signed"),
    [(0x80000000, -0x80000000), (0x80004001, -2147467263), (0x80070057, -2147024809), (0xFFFFFFFF, -1)],
)
def test_failures_are_found_signed_and_unsigned(value, as_signed):
    assert hresult.signed(value) == as_signed == hresult.signed(as_signed)
    assert hresult.unsigned(as_signed) == value == hresult.unsigned(value)
    assert hresult.failed(value)
    assert hresult.failed(as_signed)
    assert lookup(as_signed) == lookup(value)
    assert lookup(as_signed).value == value


@pytest.mark.parametrize("value", [-0x80000001, 0x100000000, 1 << 80])
@pytest.mark.parametrize("function", [hresult.unsigned, hresult.signed, hresult.failed, family, lookup])
def test_a_number_of_more_than_32_bits_is_refused(function, value):
    with pytest.raises(ValueError, match="32 bits"):
        function(value)
    i18n.use("ja")
    with pytest.raises(ValueError, match="32 ビット"):
        function(value)


@pytest.mark.parametrize(
    ("value", "en", "ja"),
    [
        (0x00000102, "Success with additional information", "正常終了（付加情報あり）"),
        (0x80000999, "Error of the CAO engine or a provider", "CAOエンジンまたはプロバイダのエラー"),
        (0x80008888, "General error", "一般エラー"),
        (0x80010099, "Packet error", "パケットのエラー"),
        (0x80020009, "Automation error 9", "オートメーションのエラー 9"),
        (0x800704D5, "Windows error 1237", "Windowsのエラー 1237"),
        (0x80040203, "Error 515 defined by the device", "機器が定義したエラー 515"),
        (0x80912746, "Socket error 10054", "ソケットエラー 10054"),
        (
            0x80201235,
            "Motion error, level 0 (notice, robot and tasks continue)",
            "動作エラー、レベル0: 通知（ロボットとタスクは継続）",
        ),
        (
            0x83201234,
            "Motion error, level 3 (all axes stopped, motor off)",
            "動作エラー、レベル3: 全軸瞬時停止、モータOFF",
        ),
        (
            0x84204A08,
            "Axis 8: motion error, level 4 (all axes emergency-stopped, motor off)",
            "第8軸: 動作エラー、レベル4: 全軸非常停止、モータOFF",
        ),
        (
            0x84204A09,
            "Motion error, level 4 (all axes emergency-stopped, motor off)",
            "動作エラー、レベル4: 全軸非常停止、モータOFF",
        ),
        (
            0x84204A00,
            "Motion error, level 4 (all axes emergency-stopped, motor off)",
            "動作エラー、レベル4: 全軸非常停止、モータOFF",
        ),
        (0x83404A01, "Axis 1: servo error, level 3 (error)", "第1軸: サーボエラー、レベル3: エラー"),
        (0x83400A01, "Servo error, level 3 (error)", "サーボエラー、レベル3: エラー"),
        (
            0x81504001,
            "Controller or program error, level 1 (refused, wrong state or argument)",
            "コントローラまたはプログラムのエラー、レベル1: 状態または引数の不備による拒否",
        ),
        (
            0x82580001,
            "Error of the electric hand or an option, level 2 (caution)",
            "電動ハンドまたはオプション機器のエラー、レベル2: 注意",
        ),
        (0x85770001, "Controller error, level 5 (fatal)", "コントローラのエラー、レベル5: 致命的エラー"),
        (0xC0000005, "Unknown code", "不明なコード"),
    ],
)
def test_an_unknown_code_gets_its_text_from_its_range(value, en, ja):
    assert value not in CODES
    code = lookup(value)
    assert (code.name, code.en, code.ja) == (f"0x{value:08X}", en, ja)


def test_hints_of_unknown_codes():
    assert lookup(0x83501234).hint_en.startswith("Read the controller's own text")
    assert "GetErrorDescription" in lookup(0x83501234).hint_ja
    grave = lookup(0x84501234)
    assert grave.hint_en.startswith("Remove the cause")
    assert grave.hint_ja.startswith("原因を取り除き")
    fatal = lookup(0x85501234)
    assert fatal.hint_en.startswith("Restart the controller")
    assert "GetErrorDescription" in fatal.hint_en
    assert fatal.hint_ja.startswith("コントローラを再起動")
    assert "GetErrorDescription" in fatal.hint_ja
    assert "address" in lookup(0x80912746).hint_en
    assert lookup(0x80008888).hint_en == lookup(0x80008888).hint_ja == ""


@given(st.integers(-0x80000000, 0xFFFFFFFF) | st.integers(0x80000000, 0x86000000) | st.sampled_from(sorted(CODES)))
def test_every_32_bit_number_has_a_result(number):
    code = lookup(number)
    value = hresult.unsigned(number)
    assert code.value == value
    assert hresult.unsigned(hresult.signed(number)) == value
    assert code.en
    assert JAPANESE.search(code.ja)
    assert "{" not in code.en + code.ja
    assert code.failed == (hresult.signed(number) < 0)
    assert code.failed == (code.family is not CodeFamily.SUCCESS)
    assert 0 <= code.level <= 5
    assert (code.name == f"0x{value:08X}") == (value not in CODES)


def test_by_name_ignores_case():
    assert by_name("E_HANDLE") is by_name(" e_handle ") is CODES[0x80070006]


def test_by_name_finds_every_code():
    assert all(by_name(code.name) is code for code in CODES.values())


def test_an_unknown_name_is_refused_with_similar_names():
    with pytest.raises(ValueError, match=r"'e_handel'.*did you mean.*E_HANDLE"):
        by_name("e_handel")
    i18n.use("ja")
    with pytest.raises(ValueError, match=r"'e_handel'.*候補: .*E_HANDLE"):
        by_name("e_handel")


def test_a_name_without_similar_names_is_refused_without_a_suggestion():
    with pytest.raises(ValueError, match="'12345'") as caught:
        by_name("12345")
    assert "did you mean" not in str(caught.value)


@pytest.mark.parametrize("value", [0x83501032, 0x84204041, 0x80070006, 0x83201234])
def test_a_code_survives_pickling_and_copying(value):
    code = lookup(value)
    for protocol in range(pickle.HIGHEST_PROTOCOL + 1):
        assert pickle.loads(pickle.dumps(code, protocol)) == code
    assert copy.deepcopy(code) == code
    assert len({code, copy.copy(code)}) == 1


def test_numbers_of_the_older_controller():
    assert lookup(0x81501001).rc7 == "200A"
    assert lookup(0x83501032).rc7 == "2254"
    assert lookup(0x83501024).rc7 == "21F7"
    assert lookup(0x80070057).rc7 == ""
    assert all(re.fullmatch(r"([0-9A-F]{4}(-[0-9A-F]{4})?)?", code.rc7) for code in CODES.values())


def test_a_user_defined_code_needs_no_hint():
    code = ReturnCode(0x80040201, "MY_ERROR", "Out of paper", "用紙切れ")
    assert (code.hint, code.rc7, code.family, code.level, code.failed) == ("", "", CodeFamily.USER, 0, True)


def test_the_remedy_of_a_missing_arm_also_suits_the_call_that_takes_it() -> None:
    info = lookup(0x83501024)  # returned by TakeArm if another client holds the arm
    assert info.hint_en.startswith("If another client or program holds the arm semaphore, ")
    assert info.hint_ja.startswith("他のクライアントやプログラムがアームセマフォを取得している場合")
