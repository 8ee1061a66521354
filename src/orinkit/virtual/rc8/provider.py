"""The virtual RC8 as a provider, and the switches that a person, a test or a program outside has on it."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from orinkit.cao.provider import ClientInfo, Provider
from orinkit.language import Language, pick
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8.caller import Caller
from orinkit.virtual.rc8.controller import RC8Controller
from orinkit.virtual.rc8.memory import DEFAULT_IO_POINTS
from orinkit.virtual.rc8.permission import Permission
from orinkit.virtual.rc8.speech import speaker
from orinkit.virtual.rc8.state import Identity, Origin, State
from orinkit.virtual.rc8.store import Store

_NAMES: Final = ("CaoProv.DENSO.VRC", "CaoProv.DENSO.VRC9")
_PC_NAME: Final = "CaoProv.DENSO.RC8"


class VirtualRC8(Provider):
    """A virtual RC8 robot controller.

    Args:
        counts: how many variables of each class I F D V P J T S; 100 of one that is not named.
        io_points: how many I/O points.
        state: directory in which the variables are kept; ``None`` to forget them at the end.
        permission: who may read and write; everyone both, if not given.
        clock: its clock; real time, if not given.
        accept_pc_provider: answer also to ``CaoProv.DENSO.RC8``, the provider that runs on a PC and that some clients
            send by mistake; a real controller refuses it.
        serial_no: serial number.
        version: software version.
        language: of its texts: ``"en"``, ``"ja"``, or ``None`` for that of the process.

    Attributes:
        state: what its clients share: :class:`~orinkit.virtual.rc8.state.State`.

    Raises:
        ValueError: a count, a class or a language that there is not.
        StateError: the state directory cannot be used.
    """

    def __init__(
        self,
        *,
        counts: Mapping[str, int] | None = None,
        io_points: int = DEFAULT_IO_POINTS,
        state: str | os.PathLike[str] | None = None,
        permission: Permission | None = None,
        clock: Clock | None = None,
        accept_pc_provider: bool = False,
        serial_no: str = "VIRTUAL-0001",
        version: str = "2.6.0",
        language: Language | None = None,
    ) -> None:
        self.provider_names: Sequence[str] = (*_NAMES, _PC_NAME) if accept_pc_provider else _NAMES
        say = speaker(language)
        if state is not None and not os.fspath(state):
            raise ValueError(pick("the state directory has an empty name", "状態ディレクトリの名前が空です"))
        if not isinstance(permission, Permission | None):
            raise TypeError(
                pick(
                    f'permission must be a Permission, for example Permission.parse("*=r"), not {permission!r}',
                    f'permission は Permission で指定してください (例: Permission.parse("*=r")): {permission!r}',
                )
            )
        store = None if state is None else Store(Path(state))
        try:
            self.state = State(
                clock=clock or Clock(),
                identity=Identity(serial_no, version),
                permission=permission or Permission(),
                say=say,
                counts=counts,
                io_points=io_points,
                store=store,
            )
        except BaseException:
            if store is not None:
                store.close()
            raise

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> RC8Controller:  # noqa: ARG002
        """Return the controller object for one client; the machine name does not matter."""
        access = self.state.permission.of(client.address)
        return RC8Controller(Caller(self.state, Origin(name, client.address), access), option)

    def close(self) -> None:
        """Write down the variables and let go of the state directory; closing twice is no error."""
        self.state.close()

    def raise_error(
        self,
        code: int,
        message: str | None = None,
        *,
        subcode: int = 0,
        program: str = "",
        line: int = 0,
        file_id: int = 0,
        original: int = 0,
    ) -> None:
        """Raise an error in the controller, as :meth:`orinkit.virtual.rc8.state.State.raise_error` tells.

        Raises:
            ValueError: a code that has more than 32 bits.
        """
        self.state.raise_error(
            code, message, subcode=subcode, program=program, line=line, file_id=file_id, original=original
        )

    def clear_errors(self) -> None:
        """Forget the current errors; the log keeps them."""
        self.state.clear_errors()

    def set_mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic.

        Raises:
            ValueError: another number.
        """
        self.state.set_mode(mode)

    def emergency_stop(self, on: bool) -> None:
        """Press or release the emergency stop."""
        self.state.emergency_stop(on)
