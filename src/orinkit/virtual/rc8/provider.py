"""The virtual RC8 as a provider, and the switches that a person, a test or a program outside has on it."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from orinkit.arms import ArmModel, load_model
from orinkit.cao.provider import ClientInfo, Provider
from orinkit.core.i18n import Language, tr
from orinkit.rc8.slave_lateness import Lateness
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects.controller import RC8Controller
from orinkit.virtual.rc8.pendant import Pendant
from orinkit.virtual.rc8.permission import Permission
from orinkit.virtual.rc8.robot.motor import MotorState
from orinkit.virtual.rc8.samples import sample_programs
from orinkit.virtual.rc8.state import Identity, Origin, RC8State, read_mode
from orinkit.virtual.rc8.switches import ModeSwitch, SlaveLimit, Switches, Token
from orinkit.virtual.rc8.temporary_directory import TemporaryDirectory
from orinkit.virtual.rc8.translations import translator
from orinkit.virtual.rc8.variables.database import VariableDatabase
from orinkit.virtual.rc8.variables.table import DEFAULT_IO_POINTS

_NAMES: Final = ("CaoProv.DENSO.VRC", "CaoProv.DENSO.VRC9")
_FILES: Final = "files"
ANYONE: Final = Token()
_PC_NAME: Final = "CaoProv.DENSO.RC8"


class VirtualRC8(Provider):
    """A virtual RC8 robot controller.

    Args:
        counts: how many variables of each class I F D V P J T S; 100 of one that is not named.
        io_points: how many I/O points.
        state: directory in which the variables are kept; ``None`` to forget them at the end.
        model: its arm: a name of :data:`orinkit.arms.MODEL_NAMES`, a TOML file, or a
            :class:`~orinkit.arms.Model`.
        mode: what the mode switch is at.
        token: the executable token: a :class:`Token`, or its text (:meth:`Token.parse`).
        motor: whether the motor is on from the beginning.
        joints: where the arm stands, degrees; its home pose if not given.
        samples: put the sample programs into a file store that is empty.
        slave_licence: the licence of the slave function is registered; without it slave mode is refused.
        slave_limit: what commands in slave mode are limited to: a :class:`SlaveLimit`, or its number 0 to 3.
        strict_time: a late set-point ends slave mode at once, as on a real controller (0x84201482; in mode 1 the arm
            stops in place). Otherwise the controller's time stands still until it comes, for 250 ms at most, and
            :attr:`lateness` counts it.
        permission: who may read and write; everyone both, if not given.
        clock: its clock; real time, if not given.
        accept_pc_provider: answer also to ``CaoProv.DENSO.RC8``, the provider that runs on a PC and that some clients
            send by mistake; a real controller refuses it.
        serial_no: serial number.
        version: software version.
        language: of its texts: ``"en"``, ``"ja"``, or ``None`` for that of the process.

    Attributes:
        state: what its clients share: :class:`~orinkit.virtual.rc8.state.RC8State`.
        pendant: its buttons, for a person or a test.

    Raises:
        ValueError: a count, a class, a language, a model, a mode, a token or a limit that there is not; joints that
            the arm cannot take.
        StateError: the state directory cannot be used.
    """

    def __init__(
        self,
        *,
        counts: Mapping[str, int] | None = None,
        io_points: int = DEFAULT_IO_POINTS,
        state: str | os.PathLike[str] | None = None,
        model: str | os.PathLike[str] | ArmModel = "VS-050",
        mode: int = ModeSwitch.AUTOMATIC,
        token: Token | str = ANYONE,
        motor: bool = False,
        joints: Sequence[float] | None = None,
        samples: bool = True,
        slave_licence: bool = True,
        slave_limit: int = SlaveLimit.SERVO,
        strict_time: bool = False,
        permission: Permission | None = None,
        clock: Clock | None = None,
        accept_pc_provider: bool = False,
        serial_no: str = "VIRTUAL-0001",
        version: str = "2.6.0",
        language: Language | None = None,
    ) -> None:
        self.provider_names: Sequence[str] = (*_NAMES, _PC_NAME) if accept_pc_provider else _NAMES
        translator(language)  # an unknown language is refused before anything is made
        if state is not None and not os.fspath(state):
            raise ValueError(tr("the state directory has an empty name"))
        if not isinstance(permission, Permission | None):
            raise TypeError(
                tr(
                    'permission must be a Permission, for example Permission.parse("*=r"), not {permission!r}',
                    permission=permission,
                )
            )
        switches = Switches(
            mode=read_mode(mode),
            token=token if isinstance(token, Token) else Token.parse(token),
            slave_licence=bool(slave_licence),
            slave_limit=SlaveLimit.read(slave_limit),
            strict_time=bool(strict_time),
        )
        arm = model if isinstance(model, ArmModel) else load_model(os.fspath(model))
        self._forget: Callable[[], object] = lambda: None
        if state is None:
            scratch = TemporaryDirectory()
            directory = scratch.path
            self._forget = weakref.finalize(self, scratch.remove)
        else:
            directory = Path(state)
        store = None if state is None else VariableDatabase(directory)
        try:
            self.state = RC8State(
                clock=clock or Clock(),
                identity=Identity(serial_no, version),
                permission=permission or Permission(),
                language=language,
                counts=counts,
                io_points=io_points,
                store=store,
                model=arm,
                files=directory / _FILES,
                switches=switches,
            )
            if joints is not None:
                self.state.arm.place(joints)
        except BaseException:
            if store is not None:
                store.close()
            raise
        if motor:
            self.state.arm.motor.state = MotorState.ON
        if samples and not self.state.files.names(""):
            for name, text in sample_programs().items():
                self.state.files.write(name, text.encode())
        self.guard = self.state.cycles
        self.pendant = Pendant(self.state)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> RC8Controller:  # noqa: ARG002
        """Return the controller object for one client; the machine name does not matter."""
        access = self.state.permission.of(client.address)
        return RC8Controller(
            ClientContext(self.state, Origin(name, client.address), access, client.drain_input), option
        )

    def close(self) -> None:
        """Stop everything, write down the variables, let go of the state directory; closing twice is no error."""
        self.state.close()
        self._forget()

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
        """Raise an error in the controller, as :meth:`orinkit.virtual.rc8.state.RC8State.raise_error` tells.

        Raises:
            ValueError: a code that has more than 32 bits.
        """
        self.state.raise_error(
            code, message, subcode=subcode, program=program, line=line, file_id=file_id, original=original
        )

    def clear_errors(self) -> None:
        """Forget the current errors; the log keeps them."""
        self.state.clear_errors()

    @property
    def lateness(self) -> Lateness:
        """How late the set-points of the present stream in slave mode are, or those of the last one were."""
        with self.guard:
            return self.state.arm.slave.lateness(0)

    def set_mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic.

        Raises:
            ValueError: another number.
        """
        self.state.set_mode(mode)

    def emergency_stop(self, on: bool) -> None:
        """Press or release the emergency stop."""
        self.state.emergency_stop(on)
