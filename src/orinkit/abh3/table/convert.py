"""The conversion functions of the document (section 4.9), with its names.

The document does not define rounding or the treatment of values that are out of range. Here a value becomes the nearest
code (of two equally near, the one further from zero), and a value without a code is an error: it is neither clamped nor
wrapped. A code becomes the number nearest to its decimal value: 1 is 0.2 min^-1.
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
        InvalidValue: If the value has no code.
    """
    return VELOCITY.encode(vel)


def cnvCAN2Vel(vel: int) -> float:  # noqa: N802 - the document's name
    """Return the velocity of a code in min^-1.

    Raises:
        InvalidValue: If the code is not in -32768 to 32767.
    """
    return VELOCITY.decode(vel)


def cnvCur2CAN(cur: float) -> int:  # noqa: N802 - the document's name
    """Return the code of a current in %, -327.68 to 327.67.

    Raises:
        InvalidValue: If the value has no code.
    """
    return CURRENT.encode(cur)


def cnvCAN2Cur(cur: int) -> float:  # noqa: N802 - the document's name
    """Return the current of a code in %.

    Raises:
        InvalidValue: If the code is not in -32768 to 32767.
    """
    return CURRENT.decode(cur)


def cnvCAN2Load(load: int, unit: float = 1.0) -> float:  # noqa: N802 - the document's name
    """Return the load of a code in %.

    Args:
        load: The code, in the document a ``short``; a negative one stands for the unsigned number with the same 16 bits.
        unit: Load per code: 1 % as in the document, or 0.1 % as in some of the vendor's programs.

    Raises:
        InvalidValue: If the code is not in -32768 to 65535, or the unit is another one.
    """
    if unit not in (1.0, 0.1):
        raise InvalidValue(tr("the unit of a load must be 1 or 0.1 %, not {unit}", unit=brief(unit)))
    return (LOAD if unit == 1.0 else LOAD_TENTHS).decode(_unsigned(load))


def cnvCAN2Analog(analog: int) -> float:  # noqa: N802 - the document's name
    """Return the voltage in V of the code of an analog input.

    Raises:
        InvalidValue: If the code is not in -32768 to 32767.
    """
    return ANALOG.decode(analog)


def cnvCAN2Volt(volt: int) -> float:  # noqa: N802 - the document's name
    """Return the supply voltage of a code in V.

    Args:
        volt: The code, in the document a ``short``; a negative one stands for the unsigned number with the same 16 bits.

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
