"""Return codes: names, meanings and hints, in English and Japanese.

A reply of b-CAP or e-CAP carries one 32-bit return code. Codes below 0x80000000 mean success. The range of an error
code shows its source (VE026A table 3-4, e-CAP table 3)::

    0x8000xxxx 0x8002xxxx 0x8007xxxx   COM                    CodeFamily.GENERAL
    0x800002xx 0x800004xx 0x800009xx   CAO                    CodeFamily.CAO
    0x80010000..0x800101FF             b-CAP packets          CodeFamily.PACKET
    0x80040200..0x8004FFFF             the served device      CodeFamily.USER
    0x8091xxxx                         a socket error number  CodeFamily.SOCKET (0x809100AA: CodeFamily.BUSY)
    0x8LMMNNNN                         the robot controller   by MM: CodeFamily.MOTION, SERVO, SAFETY, PROGRAM, ...

In a controller code, L is the level, 0 (notice) to 5 (fatal), MM the subsystem and NNNN the number. The last digit of
many motion and servo codes is the axis, 1 to 8.

:data:`CODES` contains the known codes; :func:`lookup` also accepts unknown ones. Each code without an axis is a
constant of this module. Some errors have a run of codes, for example one per axis. Only the first code of a run is a
constant (``..._AXIS1``); the others follow it numerically. If several codes have the same meaning, the names of the
later ones end in ``_2``, ``_3`` ...
"""

from __future__ import annotations

import enum
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

from orinkit.core import _hresult_controller, _hresult_orin
from orinkit.core.i18n import choose, tr
from orinkit.core.record import record

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

# ORiN, CAO and b-CAP
S_OK: Final = 0x00000000
S_FALSE: Final = 0x00000001
S_EXECUTING: Final = 0x00000900
E_CAO_SEM_CREATE: Final = 0x80000200
E_CAO_PROV_INVALID: Final = 0x80000201
E_CAO_COMPUTER_NAME: Final = 0x80000202
E_CAO_VARIANT_TYPE_NOSUPPORT: Final = 0x80000203
E_CAO_OBJECT_NOTFOUND: Final = 0x80000204
E_CAO_COLLECTION_REGISTERED: Final = 0x80000205
E_CAO_THREAD_CREATE: Final = 0x80000207
E_CAO_REMOTE_ENGINE: Final = 0x80000208
E_CAO_REMOTE_PROVIDER: Final = 0x80000209
E_CAO_NOT_WRITABLE: Final = 0x8000020A
E_CAO_CMD_EXECUTE: Final = 0x8000020B
E_CAO_PROV_NO_LICENSE: Final = 0x8000020C
E_CAO_PRELOAD: Final = 0x8000020D
E_CRDIMPL: Final = 0x80000400
E_CAOP_SYSTEMNAME_INVALID: Final = 0x80000401
E_CAOP_SYSTEMTYPE_INVALID: Final = 0x80000402
E_CANCEL: Final = 0x80000403
E_CAOP_NOT_WRITABLE: Final = 0x80000404
E_TIMEOUT: Final = 0x80000900
E_NO_LICENSE: Final = 0x80000901
E_NOT_CONNECTED: Final = 0x80000902
E_NOT_USE: Final = 0x80000903
E_INVALID_CMD_NAME: Final = 0x80000904
E_MAX_OBJECT: Final = 0x80000905
E_ALREADY_REGISTER: Final = 0x80000906
E_TOO_MUCH_DATA: Final = 0x80000909
E_MAX_CONNECT: Final = 0x8000090B
E_NOTIMPL: Final = 0x80004001
E_POINTER: Final = 0x80004003
E_ABORT: Final = 0x80004004
E_FAIL: Final = 0x80004005
E_UNEXPECTED: Final = 0x8000FFFF
E_INVALIDPACKET: Final = 0x80010000
E_INVALIDRCVPACKET: Final = 0x80010001
E_INVALIDSNDPACKET: Final = 0x80010002
E_INVALIDARGTYPE: Final = 0x80010003
E_ROBOTISBUSY: Final = 0x80010004
E_INVALIDCOMMAND: Final = 0x80010005
E_PACKETSIZEOVER: Final = 0x80010011
E_ARGSIZEOVER: Final = 0x80010012
DISP_E_TYPEMISMATCH: Final = 0x80020005
DISP_E_BADVARTYPE: Final = 0x80020008
DISP_E_OVERFLOW: Final = 0x8002000A
DISP_E_BADINDEX: Final = 0x8002000B
E_ACCESSDENIED: Final = 0x80070005
E_HANDLE: Final = 0x80070006
E_OUTOFMEMORY: Final = 0x8007000E
E_INVALIDARG: Final = 0x80070057
RPC_S_CALL_FAILED: Final = 0x800706BE
E_BUSY_PROC: Final = 0x809100AA

# The robot controller
S_BUF_FULL: Final = 0x0F200501
SINGULAR_POINT_NOTICE: Final = 0x80201418
MOTION_OPTION_INVALID: Final = 0x81201408
TARGET_OUT_OF_RANGE: Final = 0x81201503
SINGULAR_POINT_REFUSED: Final = 0x81201506
FIGURE_INVALID: Final = 0x81201519
FIGURE_MISMATCH: Final = 0x83201401
STOPPING_MOTION: Final = 0x83201404
INTERPOLATION_NOT_SUPPORTED: Final = 0x83201411
E_BUF_FULL: Final = 0x83201483
OUT_OF_WORKING_RANGE: Final = 0x83201501
SINGULAR_POINT_STOP: Final = 0x83201504
FORCE_CONTROL_TOO_FAST: Final = 0x83201530
TOOL_NUMBER_OUT_OF_RANGE: Final = 0x83201582
WORK_NUMBER_OUT_OF_RANGE: Final = 0x83201602
FIGURE_OUT_OF_RANGE: Final = 0x83600015
TOOL_SPEED_OVER: Final = 0x84201414
TOOL_SPEED_OVER_2: Final = 0x84201415
COMMAND_DELAY: Final = 0x84201482
COMMAND_GENERATION_STOPPED: Final = 0x84201486
OPTION_NOT_LICENSED: Final = 0x83500009
SLAVE_MODE_OFF: Final = 0x83500121
LICENSE_NOT_REGISTERED: Final = 0x83500126
REFUSED_IN_SLAVE_MODE: Final = 0x83501032
SLAVE_MODE_REQUIRED: Final = 0x83501033
SLAVE_FUNCTION_ENABLED: Final = 0x81500177
EMERGENCY_STOP_OR_MODE_CHANGE: Final = 0x803022EF
MOTOR_IS_ON: Final = 0x81501001
MOTOR_NOT_ON: Final = 0x81501003
MACHINE_LOCK_ON: Final = 0x81501005
PROGRAM_RUNNING: Final = 0x8150100A
PROGRAM_NOT_RUNNING: Final = 0x8150100B
ROBOT_MOVING: Final = 0x8150100D
ROBOT_PAUSED: Final = 0x8150100F
STOPPING: Final = 0x81501011
REFUSED_IN_MANUAL_MODE: Final = 0x81501012
MANUAL_MODE_REQUIRED: Final = 0x81501013
REFUSED_IN_AUTO_MODE: Final = 0x81501016
AUTO_MODE_REQUIRED: Final = 0x81501017
EMERGENCY_STOP_ON: Final = 0x8150101A
INSTANT_STOP_ON: Final = 0x8150101C
AUTO_ENABLE_ON: Final = 0x81501020
AUTO_ENABLE_REQUIRED: Final = 0x81501021
PROTECTIVE_STOP_ON: Final = 0x81501022
ERROR_PRESENT: Final = 0x81501025
MOTION_PREPARATION_NEEDED: Final = 0x81501069
MOTION_PREPARATION_NOT_DONE: Final = 0x81501070
NOT_IN_SAFETY_STATE: Final = 0x81501078
AUTO_ENABLE_WENT_OFF: Final = 0x82500004
AUTO_ENABLE_WENT_ON: Final = 0x82500005
FATAL_ERROR_BEFORE: Final = 0x82501009
MOTOR_OFF_WHILE_MOVING: Final = 0x83500008
ARM_GROUP_TAKEN: Final = 0x83500042
STOPPED_DURING_PC_MOTION: Final = 0x83500076
ARM_TAKEN_BY_PACSCRIPT: Final = 0x83500079
TOOL_WORK_CHANGE_WHILE_MOVING: Final = 0x8350010F
SPEED_CHANGE_WHILE_MOVING: Final = 0x83500110
MOTOR_ON_TIMEOUT: Final = 0x83500160
MOTOR_OFF_TIMEOUT: Final = 0x83500161
EMERGENCY_STOP_NOT_RELEASED: Final = 0x83500178
MOTOR_ON_FAILED: Final = 0x83500188
MANUAL_RESET_PREPARATION_FIRST: Final = 0x83500372
GRIP_NOT_DETECTED: Final = 0x8350048F
ARM_NOT_TAKEN: Final = 0x83501024
START_RIGHT_NOT_PENDANT: Final = 0x83501026
START_RIGHT_NOT_IO: Final = 0x83501027
START_RIGHT_NOT_ETHERNET: Final = 0x83501028
START_RIGHT_NOT_THIS_ADDRESS: Final = 0x83501029
CALSET_NOT_DONE: Final = 0x8350103F
ENCODER_REFERENCE_LOST: Final = 0x83501041
MOTOR_SWITCHING_OFF: Final = 0x8350106E
NO_READ_RIGHT: Final = 0x80501043
NO_WRITE_RIGHT: Final = 0x80501044
FUNCTION_NOT_DEFINED: Final = 0x81500013
ARGUMENT_COUNT_WRONG: Final = 0x81500014
PARAMETER_INVALID: Final = 0x81500018
ARGUMENT_INVALID: Final = 0x8150001B
ARGUMENTS_TOO_FEW: Final = 0x8150001C
ARGUMENTS_TOO_MANY: Final = 0x8150001D
FILE_NOT_FOUND: Final = 0x81500029
STRING_TOO_LONG: Final = 0x81500041
VARIABLE_INDEX_INVALID: Final = 0x81500053
SYNTAX_ERROR: Final = 0x83500001
VALUE_OUT_OF_RANGE: Final = 0x83500002
TASKS_TOO_MANY: Final = 0x83500032
UNDEFINED_ERROR_2: Final = 0x83500037
GLOBAL_VARIABLE_OUT_OF_RANGE: Final = 0x83500040
TASK_CANNOT_STOP: Final = 0x83500112
UNDEFINED_ERROR: Final = 0x83500115
VARIABLE_CHANGE_FAILED: Final = 0x83500118
VALUE_OUT_OF_RANGE_2: Final = 0x83500127
TIME_OPTION_NOT_ALLOWED: Final = 0x83500168
LOG_CAO_PROVIDER_NAME: Final = 0x81500142
LOG_CAO_VARIANT_TYPE: Final = 0x81500144
LOG_CAO_OBJECT_NOT_FOUND: Final = 0x81500145
LOG_CAO_ALREADY_REGISTERED: Final = 0x81500146
LOG_CAO_NOT_WRITABLE: Final = 0x8150014A
LOG_CAO_COMMAND_RUNNING: Final = 0x8150014B
LOG_CAO_NO_LICENSE: Final = 0x8150014C
LOG_CAO_TIMEOUT: Final = 0x81500151
LOG_CAO_NOT_CONNECTED: Final = 0x81500153
LOG_CAO_NOT_IMPLEMENTED: Final = 0x81500155
LOG_CAO_PARAMETER: Final = 0x81500157
LOG_CAO_HANDLE: Final = 0x8150015A
BCAP_CONNECTION_FAILED: Final = 0x8350013F
LOG_CAO_MEMORY: Final = 0x83500156
COMMAND_SLAVE_DISABLED: Final = 0x83500176
IO_COMMAND_UNDEFINED: Final = 0x83502006
IO_COMMAND_INTERPOLATION: Final = 0x83503003
IO_COMMAND_COORDINATE_TYPE: Final = 0x83503005
IO_COMMAND_TOOL_NUMBER: Final = 0x83503013
IO_COMMAND_SPEED: Final = 0x83503023

# The robot controller, first code of each run
MANUAL_SOFT_LIMIT_AXIS1: Final = 0x82204011
MANUAL_SOFT_LIMIT_2_AXIS1: Final = 0x82204021
SOFT_LIMIT_OVER_AXIS1: Final = 0x83204071
MOTOR_OVERLOAD_AXIS1: Final = 0x832040B1
TARGET_OVER_SOFT_LIMIT_AXIS1: Final = 0x83204231
COMMAND_ACCELERATION_OVER_AXIS1: Final = 0x84204041
SENT_SPEED_OVER_AXIS1: Final = 0x84204051
COMMAND_SPEED_OVER_AXIS1: Final = 0x84204061
COMMAND_SPEED_OVER_2_AXIS1: Final = 0x84204081
COMMAND_SPEED_OVER_3_AXIS1: Final = 0x84204091
COMMAND_SPEED_OVER_4_AXIS1: Final = 0x842040A1
CURRENT_OVER_AXIS1: Final = 0x844044B1
POSITION_DEVIATION_AXIS1: Final = 0x84404511
SERVO_SPEED_COMMAND_OVER_AXIS1: Final = 0x84404531
SERVO_ACCELERATION_COMMAND_OVER_AXIS1: Final = 0x84404541
ARGUMENT_1_INVALID: Final = 0x8150001E
START_RIGHT_NOT_COM1: Final = 0x8350102A


class CodeFamily(enum.Enum):
    """The source of a return code; :mod:`orinkit.core.errors` has an exception class for each family of errors."""

    SUCCESS = "success"
    GENERAL = "general"  #: COM: 0x8000xxxx, 0x8002xxxx, 0x8007xxxx ...
    CAO = "cao"  #: CAO engine and providers
    PACKET = "packet"  #: malformed or oversized packets
    BUSY = "busy"  #: the previous request is still executing
    SOCKET = "socket"  #: the low 16 bits are a socket error number
    USER = "user"  #: defined by the served device
    MOTION = "motion"  #: controller, subsystem 20
    SERVO = "servo"  #: controller, subsystem 40
    SAFETY = "safety"  #: controller, subsystems 48, 49, 4A (with I/O units)
    PROGRAM = "program"  #: controller, subsystem 50 (programs, states, permissions)
    OPTION = "option"  #: controller, subsystem 58 (electric hand and options)
    LANGUAGE = "language"  #: controller, subsystem 60 (interpreter)
    PENDANT = "pendant"  #: controller, subsystem 80
    CONTROLLER = "controller"  #: controller, any other subsystem
    UNKNOWN = "unknown"


_SUBSYSTEMS: Final = {
    0x20: CodeFamily.MOTION,
    0x40: CodeFamily.SERVO,
    0x48: CodeFamily.SAFETY,
    0x49: CodeFamily.SAFETY,
    0x4A: CodeFamily.SAFETY,
    0x50: CodeFamily.PROGRAM,
    0x58: CodeFamily.OPTION,
    0x60: CodeFamily.LANGUAGE,
    0x80: CodeFamily.PENDANT,
}
_MAX_LEVEL: Final = 5


@record
class ReturnCode:
    """A return code with its name, meaning and hint.

    Attributes:
        value: Code, unsigned 32 bits.
        name: Symbol from the documents (``E_HANDLE``) or of this project (``COMMAND_DELAY``). The name of an unknown
            code is its number, such as ``0x83201234``.
        en: Short English text, without a full stop.
        ja: Short Japanese text, without a full stop.
        hint_en: Remedy in one or two English sentences; empty if none is known.
        hint_ja: Remedy in Japanese.
        rc7: Number of the same error on an RC7 controller; empty if unknown.
    """

    value: int
    name: str
    en: str
    ja: str
    hint_en: str = ""
    hint_ja: str = ""
    rc7: str = ""

    @property
    def text(self) -> str:
        """The short text in the current language."""
        return choose(self.en, self.ja)

    @property
    def hint(self) -> str:
        """The remedy in the current language; may be empty."""
        return choose(self.hint_en, self.hint_ja)

    @property
    def family(self) -> CodeFamily:
        """The part of the system that the return code comes from, for example the servo."""
        return family(self.value)

    @property
    def level(self) -> int:
        """The severity of a controller code, 0 (notice) to 5 (fatal); 0 for all other codes."""
        return self.value >> 24 & 0xF if _is_controller(self.value) else 0

    @property
    def failed(self) -> bool:
        """True if the code is an error."""
        return failed(self.value)


def unsigned(code: int) -> int:
    """Return a signed or unsigned code as an unsigned 32-bit number.

    Raises:
        ValueError: If the number fits neither a signed nor an unsigned 32-bit integer.
    """
    if not -0x8000_0000 <= code <= 0xFFFF_FFFF:
        raise ValueError(tr("return code {code:#x} does not fit into 32 bits (-0x80000000 to 0xFFFFFFFF)", code=code))
    return code & 0xFFFF_FFFF


def signed(code: int) -> int:
    """Return a code as a signed 32-bit number, the form used in packets.

    Raises:
        ValueError: If the number fits neither a signed nor an unsigned 32-bit integer.
    """
    value = unsigned(code)
    return value - 0x1_0000_0000 if value & 0x8000_0000 else value


def failed(code: int) -> bool:
    """Return True if a code is an error, that is, if its highest bit is set.

    Raises:
        ValueError: If the number fits neither a signed nor an unsigned 32-bit integer.
    """
    return unsigned(code) >= 0x8000_0000


def family(code: int) -> CodeFamily:
    """Return the source of a code. The number alone determines the source, so unknown codes have a family, too.

    Raises:
        ValueError: If the number fits neither a signed nor an unsigned 32-bit integer.
    """
    value = unsigned(code)
    if value < 0x8000_0000:
        return CodeFamily.SUCCESS
    if value >> 16 == 0x8091:
        return CodeFamily.BUSY if value == E_BUSY_PROC else CodeFamily.SOCKET
    if _is_controller(value):
        return _SUBSYSTEMS.get(value >> 16 & 0xFF, CodeFamily.CONTROLLER)
    if value >> 20 == 0x800:
        return _com_family(value)
    return CodeFamily.UNKNOWN


def _com_family(value: int) -> CodeFamily:
    if value >> 8 in (0x80_0002, 0x80_0004, 0x80_0009):
        return CodeFamily.CAO
    if 0x8001_0000 <= value <= 0x8001_01FF:
        return CodeFamily.PACKET
    # e-CAP table 3 assigns 0x8001xxxx to the device; b-CAP (VE026A table 3-4) uses the first 512 for packets.
    if 0x8001_0200 <= value <= 0x8001_FFFF or 0x8004_0200 <= value <= 0x8004_FFFF:
        return CodeFamily.USER
    return CodeFamily.GENERAL


def _is_controller(value: int) -> bool:
    """Return True for a code of a robot controller: 0x8LMMNNNN with a level up to 5, except COM and socket errors."""
    return 0x8010_0000 <= value < 0x8000_0000 + (_MAX_LEVEL + 1 << 24) and value >> 16 != 0x8091


def _rows() -> Iterator[ReturnCode]:
    for value, name, en, ja, key in _hresult_orin.ROWS:
        yield ReturnCode(value, name, en, ja, *_hresult_orin.HINTS[key])
    for value, name, en, ja, key, rc7 in _hresult_controller.ROWS:
        yield ReturnCode(value, name, en, ja, *_hresult_controller.HINTS[key], rc7)
    for base, count, name, en, ja, key, rc7 in _hresult_controller.RUNS:
        hints = _hresult_controller.HINTS[key]
        for n in range(1, count + 1):
            yield ReturnCode(base + n, name.format(n=n), en.format(n=n), ja.format(n=n), *hints, rc7)


#: All known codes by unsigned value.
CODES: Final[Mapping[int, ReturnCode]] = MappingProxyType({code.value: code for code in _rows()})
_BY_NAME: Final = {code.name: code for code in CODES.values()}


def lookup(code: int) -> ReturnCode:
    """Return the name, meaning and hint of a code.

    For a code that is not in :data:`CODES`, the name is the number, and the text is composed of the family, the level
    and, for motion and servo codes, the axis.

    Args:
        code: Code, signed or unsigned.

    Raises:
        ValueError: If the number fits neither a signed nor an unsigned 32-bit integer.
    """
    value = unsigned(code)
    known = CODES.get(value)
    return known or _unknown(value)


def defined_by_device(code: int) -> ReturnCode:
    """Return the description of a code that the device defines, regardless of the codes of b-CAP (e-CAP table 3)."""
    value = unsigned(code)
    return ReturnCode(value, _hex(value), "Error defined by the device", "デバイスが定義したエラー")


def by_name(name: str) -> ReturnCode:
    """Return the return code that has the symbol ``name``; upper and lower case are equivalent.

    Raises:
        ValueError: If no code has this name; the message suggests similar names.
    """
    wanted = name.strip().upper()
    found = _BY_NAME.get(wanted)
    if found is not None:
        return found
    from difflib import get_close_matches  # slow to import, needed for errors only

    near = ", ".join(get_close_matches(wanted, _BY_NAME, n=3))
    if near:
        raise ValueError(tr("unknown return code {name!r}; did you mean {near}?", name=name, near=near))
    raise ValueError(tr("unknown return code {name!r}", name=name))


_FAMILY_TEXTS: Final = {
    CodeFamily.SUCCESS: ("Success with additional information", "正常終了（付加情報あり）"),
    CodeFamily.GENERAL: ("General error", "一般エラー"),
    CodeFamily.CAO: ("Error of the CAO engine or a provider", "CAOエンジンまたはプロバイダのエラー"),
    CodeFamily.PACKET: ("Packet error", "パケットのエラー"),
    CodeFamily.SOCKET: ("Socket error {number}", "ソケットエラー {number}"),
    CodeFamily.USER: ("Error {number} defined by the device", "機器が定義したエラー {number}"),
    CodeFamily.MOTION: ("Motion error", "動作エラー"),
    CodeFamily.SERVO: ("Servo error", "サーボエラー"),
    CodeFamily.SAFETY: ("Safety or I/O unit error", "安全機能またはI/Oユニットのエラー"),
    CodeFamily.PROGRAM: ("Controller or program error", "コントローラまたはプログラムのエラー"),
    CodeFamily.OPTION: ("Error of the electric hand or an option", "電動ハンドまたはオプション機器のエラー"),
    CodeFamily.LANGUAGE: ("Error of the program language", "プログラム言語のエラー"),
    CodeFamily.PENDANT: ("Pendant error", "ペンダントのエラー"),
    CodeFamily.CONTROLLER: ("Controller error", "コントローラのエラー"),
    CodeFamily.UNKNOWN: ("Unknown code", "不明なコード"),
}
_FAMILY_HINTS: Final = {CodeFamily.PACKET: "packet", CodeFamily.SOCKET: "network"}


def _unknown(value: int) -> ReturnCode:
    if _is_controller(value):
        return _unknown_controller(value)
    kind, number = family(value), value & 0xFFFF
    en, ja = _hresult_orin.FACILITIES.get(value >> 16, _FAMILY_TEXTS[kind])
    hints = _hresult_orin.HINTS[_FAMILY_HINTS.get(kind, "")]
    return ReturnCode(value, _hex(value), en.format(number=number), ja.format(number=number), *hints)


def _unknown_controller(value: int) -> ReturnCode:
    kind, level, axis = family(value), value >> 24 & 0xF, _axis(value)
    en, ja = _FAMILY_TEXTS[kind]
    level_en, level_ja = _hresult_controller.LEVELS[level]
    if kind is CodeFamily.MOTION:
        level_en, level_ja = _hresult_controller.MOTION_LEVELS.get(level, (level_en, level_ja))
    hint_en, hint_ja = _hresult_controller.ASK
    first_en, first_ja = _hresult_controller.HINTS[_hresult_controller.LEVEL_HINTS.get(level, "")]
    return ReturnCode(
        value,
        _hex(value),
        (f"Axis {axis}: {en[0].lower()}{en[1:]}" if axis else en) + f", level {level} ({level_en})",
        (f"第{axis}軸: {ja}" if axis else ja) + f"、レベル{level}: {level_ja}",
        f"{first_en} {hint_en}".lstrip(),
        first_ja + hint_ja,
    )


def _axis(value: int) -> int:
    """Return the axis of a motion or servo code, which is its last digit; 0 if the code has no axis.

    Only codes with the numbers 4000 to 4FFF have an axis.
    """
    digit = value & 0xF
    per_axis = family(value) in (CodeFamily.MOTION, CodeFamily.SERVO) and value >> 12 & 0xF == 4
    return digit if per_axis and 1 <= digit <= 8 else 0


def _hex(value: int) -> str:
    return f"0x{value:08X}"
