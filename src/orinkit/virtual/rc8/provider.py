"""The virtual RC8 as a provider, with methods that tests use to cause errors or to operate its switches."""

from __future__ import annotations

import os
import weakref
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

from orinkit.arms import ArmModel, load_model
from orinkit.cao.dialect import RC8, RC8_STRICT
from orinkit.cao.provider import ClientInfo, Provider
from orinkit.core.i18n import Language, tr
from orinkit.rc8.slave_lateness import Lateness
from orinkit.rc8.user_io_unit import UserIoUnit, read_unit
from orinkit.virtual.clock import Clock
from orinkit.virtual.rc8.client_context import open_context
from orinkit.virtual.rc8.objects.controller import RC8Controller
from orinkit.virtual.rc8.pendant import Pendant
from orinkit.virtual.rc8.permission import Permission
from orinkit.virtual.rc8.profiles import find_profile
from orinkit.virtual.rc8.robot.motor import MotorState
from orinkit.virtual.rc8.samples import sample_programs
from orinkit.virtual.rc8.state import Identity, Origin, RC8State, read_mode
from orinkit.virtual.rc8.switches import ANYONE, ModeSwitch, SlaveLimit, Switches, Token
from orinkit.virtual.rc8.temporary_directory import TemporaryDirectory
from orinkit.virtual.rc8.translations import translator
from orinkit.virtual.rc8.variables.database import VariableDatabase
from orinkit.virtual.rc8.variables.table import DEFAULT_IO_POINTS
from orinkit.virtual.rc8.workspace import Workspace

_NAMES: Final = ("CaoProv.DENSO.VRC", "CaoProv.DENSO.VRC9")
_FILES: Final = "files"
_PC_NAME: Final = "CaoProv.DENSO.RC8"


class VirtualRC8(Provider):
    """A virtual RC8 robot controller.

    Args:
        counts: Number of variables of each class I F D V P J T S; 100 for a class that is not listed.
        io_points: Number of I/O points.
        state: Directory in which variables and files are kept; ``None`` to discard them when the controller is closed.
        controller: The controller that it represents: ``"rc8"``, ``"rc8a"``, ``"rc9"`` or ``"cobotta"``. The default arm,
            the version, the type, and the form of the errors depend on it.
        model: The arm: a name of :data:`orinkit.arms.MODEL_NAMES`, a TOML file, or an
            :class:`~orinkit.arms.ArmModel`; the usual arm of the controller if not given.
        type_name: Type name of the arm (``@TYPE_NAME``, GetRobotTypeName); that of the model if not given.
        second_model: The arm of a second robot (``ID=1``), as for ``model``; by default there is one robot.
        mode: Initial position of the mode switch.
        token: The executable token: a :class:`Token`, or its text (:meth:`Token.parse`).
        motor: True if the motors are on initially.
        joints: Initial joint position, deg; the home pose if not given.
        second_joints: Initial joint position of the second robot, deg; the home pose if not given.
        samples: Put the sample programs into the file store if it is empty.
        slave_licence: True if the licence of the slave function is registered; without it slave mode is refused.
        slave_limit: Limit of commands in slave mode: a :class:`SlaveLimit`, or its number 0 to 3.
        strict_time: If True, a late set-point has the same effect as on a real controller: slave mode ends with
            0x84201482; if the client uses mode 1 of slave mode, the arm instead stops in place. If False, the
            controller's time stands still until the set-point arrives, for up to 250 ms.
            :attr:`set_point_lateness` counts late set-points.
        user_io_unit: Unit of the size of user I/O in slvMove, ``"bits"`` or ``"bytes"``. If a set-point contains user
            I/O, the number of its bytes shows the unit.
        loose_poses: If True, six bare numbers in OutRange are a position, and the pose type L of Move means P, as some
            clients send them; otherwise they are refused, because their meaning on a real controller is not known.
        strict: If True, the controller follows the b-CAP document where programs that run on real controllers show that
            these are more tolerant; for example, GiveArm of a client that does not hold the arm is refused.
        hands: Numbers of the boards for electric grippers that are fitted, 0 to 7: ``Hand0`` by default.
        create_files: If True, File_PutValue creates a missing file, also if it was opened without ``@Create``.
        permission: Access rights by client address; read and write for every client if not given.
        clock: The clock of the controller; real time if not given.
        accept_pc_provider: If True, also accept the provider name ``CaoProv.DENSO.RC8``. It belongs to the provider
            that runs on a PC, but some clients send it by mistake; a real controller refuses it.
        serial_no: Serial number.
        version: Software version (``@VERSION``); that of the controller's profile if not given.
        language: Language of the texts: ``"en"``, ``"ja"``, or ``None`` for the language of the process.

    Attributes:
        state: State shared by all clients: :class:`~orinkit.virtual.rc8.state.RC8State`.
        pendant: The pendant, operated by tests and by users.
        workspace: The surroundings of the arm of the first robot, set by tests and by users.
        workspaces: The surroundings of each arm.

    Raises:
        ValueError: If a count, class, board, language, controller, model, mode, token or limit is not valid, or if the arm
            cannot reach the joint position.
        StateError: If the state directory cannot be used.
    """

    unique_names = True
    unwraps_variants = True

    def __init__(
        self,
        *,
        counts: Mapping[str, int] | None = None,
        io_points: int = DEFAULT_IO_POINTS,
        state: str | os.PathLike[str] | None = None,
        controller: str = "rc8",
        model: str | os.PathLike[str] | ArmModel | None = None,
        type_name: str | None = None,
        second_model: str | os.PathLike[str] | ArmModel | None = None,
        mode: int = ModeSwitch.AUTOMATIC,
        token: Token | str = ANYONE,
        motor: bool = False,
        joints: Sequence[float] | None = None,
        second_joints: Sequence[float] | None = None,
        samples: bool = True,
        slave_licence: bool = True,
        slave_limit: int = SlaveLimit.SERVO,
        strict_time: bool = False,
        loose_poses: bool = False,
        strict: bool = False,
        hands: Iterable[int] = (0,),
        create_files: bool = False,
        user_io_unit: UserIoUnit | str = UserIoUnit.BITS,
        permission: Permission | None = None,
        clock: Clock | None = None,
        accept_pc_provider: bool = False,
        serial_no: str = "VIRTUAL-0001",
        version: str | None = None,
        language: Language | None = None,
    ) -> None:
        self.dialect = RC8_STRICT if strict else RC8
        self.provider_names: Sequence[str] = (*_NAMES, _PC_NAME) if accept_pc_provider else _NAMES
        translator(language)  # raises an exception for an unknown language, before anything is created
        if state is not None and not os.fspath(state):
            raise ValueError(tr("the name of the state directory is empty"))
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
            loose_poses=bool(loose_poses),
            strict=bool(strict),
            create_files=bool(create_files),
            user_io_unit=read_unit(user_io_unit),
        )
        profile = find_profile(controller)
        arms = [_arm(profile.model if model is None else model, type_name)]
        if second_model is not None:
            arms.append(_arm(second_model, None))
        elif second_joints is not None:
            raise ValueError(tr("second_joints requires second_model"))
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
                identity=Identity(serial_no, version or profile.version, type=profile.type),
                profile=profile,
                permission=permission or Permission(),
                language=language,
                counts=counts,
                io_points=io_points,
                store=store,
                models=arms,
                files=directory / _FILES,
                switches=switches,
                hands=hands,
            )
            for robot, position in zip(self.state.robots, (joints, second_joints), strict=False):
                if position is not None:
                    robot.arm.place(position)
        except BaseException:
            if store is not None:
                store.close()
            raise
        if motor:
            for robot in self.state.robots:
                robot.arm.motor.state = MotorState.ON
        if samples and not self.state.files.names(""):
            for name, text in sample_programs().items():
                self.state.files.write(name, text.encode())
        self.guard = self.state.cycles
        self.pendant = Pendant(self.state)
        self.workspaces = tuple(Workspace(self.state, robot) for robot in self.state.robots)
        self.workspace = self.workspaces[0]

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> RC8Controller:
        """Return the controller object for one client; the machine name is ignored."""
        access = self.state.permission.of(client.address)
        context = open_context(self.state, Origin(name, client.address), access, client.when_input_processed)
        if client.disconnect is not None:
            self.state.connections[context] = client.disconnect
        return RC8Controller(context, option)

    def close(self) -> None:
        """Stop the controller and release the state directory; a second call has no effect."""
        self.state.close()
        self._forget()

    def raise_error(
        # Also in virtual.rc8.state: the parameters of public functions are written out, so that help() and editors show them.
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
        """Raise an error in the controller; see :meth:`orinkit.virtual.rc8.state.RC8State.raise_error`.

        Raises:
            ValueError: If the code has more than 32 bits.
        """
        self.state.raise_error(
            code, message, subcode=subcode, program=program, line=line, file_id=file_id, original=original
        )

    def clear_errors(self) -> None:
        """Clear the current errors; they remain in the log.

        Raises:
            CallError: FATAL_ERROR_BEFORE if an error requires a restart of the controller.
        """
        self.state.clear_errors()

    @property
    def set_point_lateness(self) -> Lateness:
        """Number and delays of the late set-points in the current stream; in the last stream if slave mode is off.

        They are those of the first robot.
        """
        with self.guard:
            return self.state.arm.slave.lateness(0)

    def set_mode(self, mode: int) -> None:
        """Turn the mode switch: 1 manual, 2 teach check, 3 automatic.

        Raises:
            ValueError: If the number is not 1, 2 or 3.
        """
        self.state.set_mode(mode)

    def emergency_stop(self, on: bool) -> None:
        """Press or release the emergency stop."""
        self.state.emergency_stop(on)


def _arm(model: str | os.PathLike[str] | ArmModel, type_name: str | None) -> ArmModel:
    """Return the model of an arm, with another type name if one is given."""
    arm = model if isinstance(model, ArmModel) else load_model(os.fspath(model))
    if type_name is None:
        return arm
    if not type_name.strip() or not type_name.isprintable():
        raise ValueError(tr("the type name of the arm must be printable text"))
    return replace(arm, type_name=type_name)
