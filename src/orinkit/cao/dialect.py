"""Dialects of b-CAP: the differences between RC8 and VE026A."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from orinkit.core import hresult
from orinkit.core.record import EMPTY, record, replaced


@record
class Dialect:
    """A dialect of b-CAP.

    Attributes:
        name: name of the dialect, ``"rc8"``.
        echoes_reserved: whether a reply repeats the reserved field of its request; otherwise the field is 0.
        replies_vt_empty: whether the reply to an Execute or a Command_Execute without a result, and every reply with an
            error code, has one argument, VT_EMPTY; otherwise it has no argument.
        vt_error_size: size of a VT_ERROR, bytes.
        closes_on_malformed_packet: whether the server disconnects a client after replying E_INVALIDRCVPACKET to a malformed packet.
        takes_start_options: whether a client sends options with Service_Start, and invalid options are refused; otherwise
            invalid options are ignored.
        strict: whether a server follows the documents if they are narrower than real controllers.
        queues_calls: whether calls that arrive during a call of the same client are executed after it; otherwise they are
            refused.
        code_replacements: return codes that the dialect does not have, and their replacements.
        takes_arm: whether TakeArm, GiveArm and Halt exist; otherwise only slave mode moves the arm.
        short_numbers: whether the parameters of the commands Motor and ClearError are a single VT_I2; otherwise, the
            parameter of Motor is an array, and ClearError has no parameter.
        slave_formats: whether slvSendFormat and slvRecvFormat exist; otherwise slvMove accepts and returns joints only.
        slave_mode: the slave mode that is used by default: 0, 1 or 2.
        busy_code: return code for a repeated request if the first attempt is still executing (VE026A table 3-5: "wait for a
            while"); 0 if the controller sends S_EXECUTING instead.
        command_timeouts: time-outs of long-running commands, s, by the names of the commands in lower case.
        command_variables: commands that the dialect does not have, and the variable of the robot that replaces each of them.
    """

    name: str
    echoes_reserved: bool = False
    replies_vt_empty: bool = True
    vt_error_size: int = 4
    closes_on_malformed_packet: bool = False
    takes_start_options: bool = True
    strict: bool = False
    queues_calls: bool = True
    code_replacements: Mapping[int, int] = EMPTY
    takes_arm: bool = True
    short_numbers: bool = False
    slave_formats: bool = True
    slave_mode: int = 2
    busy_code: int = 0
    command_timeouts: Mapping[str, float] = EMPTY
    command_variables: Mapping[str, str] = EMPTY


RC8: Final = Dialect("rc8")
"""RC8, RC8A, RC9, COBOTTA."""

RC8_STRICT: Final = replaced(RC8, strict=True)
"""The same, of a server that follows the documents where they are narrower."""

VE026A: Final = Dialect(
    "ve026a",
    echoes_reserved=True,
    replies_vt_empty=False,
    vt_error_size=2,
    closes_on_malformed_packet=True,
    takes_start_options=False,
    queues_calls=False,
    code_replacements={  # table 3-5 has none of the codes on the left
        hresult.E_BUSY_PROC: hresult.E_ROBOTISBUSY,
        hresult.E_TIMEOUT: hresult.E_ABORT,
        hresult.E_MAX_CONNECT: hresult.E_ACCESSDENIED,
        hresult.E_MAX_OBJECT: hresult.E_OUTOFMEMORY,
        hresult.E_TOO_MUCH_DATA: hresult.E_OUTOFMEMORY,
        hresult.E_CAO_OBJECT_NOTFOUND: hresult.E_INVALIDARG,
        hresult.E_CAO_PROV_INVALID: hresult.E_INVALIDARG,
    },
    takes_arm=False,
    short_numbers=True,
    slave_formats=False,
    slave_mode=1,  # mode 0 (slvChangeMode 2) requires a set-point every 8 ms, for which 38,400 bit/s is too slow
    busy_code=hresult.E_ROBOTISBUSY,
    command_timeouts={
        "motor": 6.0,
        "clearerror": 3.0,
        "slvchangemode": 2.0,
    },  # the commands take about 3, 1 and 0.5 s (VE026A 5.2.4, 5.3.4, 2.2.1)
    command_variables={"CurJnt": "@CURRENT_ANGLE"},
)
"""The arm VE026A (b-CAP document for VE026A: figures of 3.1, tables 3-1 and 3-5)."""

DIALECTS: Final = {dialect.name: dialect for dialect in (RC8, VE026A)}
"""All dialects, by name."""
