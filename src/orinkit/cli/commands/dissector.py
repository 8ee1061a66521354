"""``orinkit dissector``: write a dissector of b-CAP for Wireshark."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from orinkit.core.i18n import tr


def dissector(
    *,
    output: Annotated[
        str | None,
        Parameter(help=tr("File to write, for example bcap.lua; stdout by default. An existing file is replaced.")),
    ] = None,
) -> None:
    """Write a dissector of b-CAP in Lua, for Wireshark 4 and tshark: wireshark -X lua_script:bcap.lua.

    To load it always, write it to the personal Lua plugins folder (in Wireshark: Help, About Wireshark, Folders).
    """
    from orinkit import __version__
    from orinkit.bcap.dissector import lua
    from orinkit.cli._shared.errors import CommandError
    from orinkit.transport.address import DEFAULT_PORT

    text = lua(__version__, DEFAULT_PORT)
    if output is None:
        if isinstance(sys.stdout, io.TextIOWrapper):
            sys.stdout.reconfigure(encoding="utf-8", newline="\n")  # as Wireshark requires, on any terminal
        print(text, end="")
        return
    try:
        Path(output).write_text(text, encoding="utf-8", newline="\n")
    except (OSError, ValueError) as error:
        raise CommandError(f"--output {output}: {getattr(error, 'strerror', None) or error}", 2) from None
