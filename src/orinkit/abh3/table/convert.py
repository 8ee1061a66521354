"""The functions of section 4.9 of the ABH3 document that convert values to codes, the numbers in frames, and back.

The functions have the names that the document defines.

A code is the whole number that represents a value in a frame. The document does not define rounding, and it does not
define the treatment of values that are out of range. In this module, a value becomes the nearest code. If two codes are
equally near, it becomes the one further from zero. A value that is out of range raises an exception; it is neither
clamped nor wrapped. A code becomes the float nearest to its decimal value: the velocity of code 1 is 0.2 min^-1.
"""

from __future__ import annotations

from orinkit.abh3.table import packfloat
from orinkit.abh3.table.packfloat import Rounding
from orinkit.abh3.table.signals import ANALOG, CURRENT, LOAD, LOAD_TENTHS, VELOCITY, VOLTAGE
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import brief


def cnvVel2CAN(vel: float) -> int:  # noqa: N802 - the document's name
    """Return the code of a velocity in min^-1, -6553.6 to 6553.4.

    Raises:
        InvalidValue: If the value is out of range or not a number.
    """
    return VELOCITY.encode(vel)


def cnvCAN2Vel(vel: int) -> float:  # noqa: N802 - the document's name
    """Return the velocity in min^-1 that a code represents.

    Raises:
        InvalidValue: If the code is not in -32768 to 32767.
    """
    return VELOCITY.decode(vel)


def cnvCur2CAN(cur: float) -> int:  # noqa: N802 - the document's name
    """Return the code of a current in %, -327.68 to 327.67.

    Raises:
        InvalidValue: If the value is out of range or not a number.
    """
    return CURRENT.encode(cur)


def cnvCAN2Cur(cur: int) -> float:  # noqa: N802 - the document's name
    """Return the current in % that a code represents.

    Raises:
        InvalidValue: If the code is not in -32768 to 32767.
    """
    return CURRENT.decode(cur)


def cnvCAN2Load(load: int, unit: float = 1.0) -> float:  # noqa: N802 - the document's name
    """Return the load in % that a code represents.

    Args:
        load: The code. In the document it is a ``short``, so a negative code means the unsigned number with the same
            bits.
        unit: Resolution in %: 1 as in the document, or 0.1 as in some of the vendor's programs.

    Raises:
        InvalidValue: If the code is not in -32768 to 65535, or the unit is not 1 or 0.1.
    """
    if unit not in (1.0, 0.1):
        raise InvalidValue(tr("the unit of a load, in %, must be 1 or 0.1, not {unit}", unit=brief(unit)))
    return (LOAD if unit == 1.0 else LOAD_TENTHS).decode(_unsigned(load))


def cnvCAN2Analog(analog: int) -> float:  # noqa: N802 - the document's name
    """Return the voltage in V that a code of an analog input represents.

    Raises:
        InvalidValue: If the code is not in -32768 to 32767.
    """
    return ANALOG.decode(analog)


def cnvCAN2Volt(volt: int) -> float:  # noqa: N802 - the document's name
    """Return the supply voltage in V that a code represents.

    Args:
        volt: The code. In the document it is a ``short``, so a negative code means the unsigned number with the same
            bits.

    Raises:
        InvalidValue: If the code is not in -32768 to 65535.
    """
    return VOLTAGE.decode(_unsigned(volt))


def flt_to_pkflt(flt: float, rounding: Rounding = "round") -> int:
    """Return the PACK_FLOAT of a value, see :func:`orinkit.abh3.table.packfloat.from_float`."""
    return packfloat.from_float(flt, rounding=rounding)


def pkflt_to_flt(pkflt: int) -> float:
    """Return the value of a PACK_FLOAT, see :func:`orinkit.abh3.table.packfloat.to_float`.

    Raises:
        InvalidValue: If the word has more than 32 bits or is negative.
    """
    return packfloat.to_float(pkflt)


def str_to_pkflt(text: str) -> int:
    """Return the PACK_FLOAT of a text, see :func:`orinkit.abh3.table.packfloat.from_text`.

    Raises:
        InvalidValue: If the text is not a number; the document's function returns 1 instead.
    """
    return packfloat.from_text(text)


def pkflt_to_str(pkflt: int) -> str:
    """Return the text of a PACK_FLOAT, see :func:`orinkit.abh3.table.packfloat.to_text`.

    Raises:
        InvalidValue: If the word has more than 32 bits or is negative.
    """
    return packfloat.to_text(pkflt)


def _unsigned(code: int) -> int:
    return code + 0x1_0000 if -0x8000 <= code < 0 else code
