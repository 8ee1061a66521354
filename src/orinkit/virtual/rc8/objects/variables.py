"""Variable objects: a user variable, a class of variables with a selectable index, or a system variable."""

from __future__ import annotations

from datetime import datetime

from orinkit.cao.provider import VariableObject, not_found
from orinkit.core import hresult
from orinkit.core.errors import error_for
from orinkit.values.variant import Value, Variant, VarType, type_name
from orinkit.virtual.rc8.client_context import ClientContext
from orinkit.virtual.rc8.objects.robot_variables import RobotVariableObject, find_frame
from orinkit.virtual.rc8.objects.system_variables import SYSTEM_VARIABLES, SystemVariable
from orinkit.virtual.rc8.permission import AccessRight
from orinkit.virtual.rc8.variables import conversion
from orinkit.virtual.rc8.variables.types import CLASSES, VariableClass, io_area, read_name

_SYSTEM_PREFIX = "@"


def find_variable(caller: ClientContext, name: str) -> VariableObject:
    """Return a variable by its name; case-insensitive.

    Raises:
        CallError: E_CAO_OBJECT_NOTFOUND; VARIABLE_INDEX_INVALID.
    """
    wanted = name.strip()
    if wanted.startswith(_SYSTEM_PREFIX):
        entry = SYSTEM_VARIABLES.get(wanted.upper())
        if entry is None:
            raise not_found(name)
        return SystemVariableObject(caller, name, entry)
    meaning = read_name(wanted)
    if meaning is None:
        frame = find_frame(wanted)
        if frame is None:
            raise not_found(name)
        return RobotVariableObject(caller, name, frame)
    if meaning.index is None:
        return IndexedVariable(caller, name, meaning.kind)
    caller.state.variables.check(meaning.kind, meaning.index)
    return UserVariable(caller, name, meaning.kind, meaning.index)


def variable_names() -> list[str]:
    """Return the names of the system variables, and a pattern for each class of user variables: ``I*`` for I0, I1."""
    return [*SYSTEM_VARIABLES, *(f"{name}*" for name in CLASSES)]


class UserVariable(VariableObject):
    """A user variable, or a group of I/O points, at a fixed index.

    The attribute is the sum of 1 (readable) and 2 (writable) according to the client's access rights. Date and
    microsecond are the time of the last write by any client or program.
    """

    def __init__(self, caller: ClientContext, name: str, kind: VariableClass, index: int) -> None:
        super().__init__(name, attribute=int(caller.access), help=_help(caller, kind, str(index)))
        if kind.bits:
            self.help += f" ({caller.state.say(io_area(index))})"
        self._caller = caller
        self._variables = caller.state.variables
        self._kind = kind
        self._index = index

    def get_value(self) -> Value:
        """Return the value, with its exact type."""
        self._caller.require_read()
        return self._variables.read(self._kind, self._index)

    def put_value(self, value: Variant) -> None:
        """Set the value; when the method returns, the value is stored."""
        self._caller.require_write()
        self._variables.write(self._kind, self._index, value)

    def get_date_time(self) -> Value:
        """Return the time of the last write, or of the controller's start if the value was never written."""
        return self._written()

    def get_microsecond(self) -> int:
        """Return the microseconds of the time returned by :meth:`get_date_time`, 0 to 999999."""
        return self._written().microsecond

    def _written(self) -> datetime:
        self._caller.require_read()
        return self._variables.written(self._kind, self._index)


class IndexedVariable(UserVariable):
    """A Variable object for a class of variables, ``I*``: the ID of the object selects the index, initially 0."""

    def __init__(self, caller: ClientContext, name: str, kind: VariableClass) -> None:
        super().__init__(caller, name, kind, 0)
        self.help = _help(caller, kind, "*")
        self.id = Variant(VarType.I4, 0)

    def put_id(self, id: Variant) -> None:  # noqa: A002 - the term of the documents
        """Select the index, given as a whole number or as the text of one.

        Raises:
            CallError: DISP_E_TYPEMISMATCH, E_INVALIDARG or VARIABLE_INDEX_INVALID; the index has not changed.
        """
        index = conversion.whole(id)
        self._variables.check(self._kind, index)
        self._index = index
        self.id = id


class SystemVariableObject(VariableObject):
    """A system variable.

    The attribute is the sum of 1 (readable) and 2 (writable), as allowed by the variable and by the client's access
    rights. Date and microsecond are the time of the last read through this object; before the first read, they are the
    current time.
    """

    def __init__(self, caller: ClientContext, name: str, entry: SystemVariable) -> None:
        own = AccessRight.READ_WRITE if entry.write else AccessRight.READ
        super().__init__(name, attribute=int(own & caller.access), help=entry.help(caller.state.say))
        self._caller = caller
        self._entry = entry
        self._read: datetime | None = None

    def get_value(self) -> Value:
        """Return the current value, with its exact type."""
        self._caller.require_read()
        state = self._caller.state
        self._read = state.calendar.now()
        return Variant(self._entry.vt, self._entry.read(state))

    def put_value(self, value: Variant) -> None:
        """Set the value.

        Raises:
            CallError: NO_WRITE_RIGHT; E_CAO_NOT_WRITABLE; other codes if the value is invalid.
        """
        self._caller.require_write()
        if self._entry.write is None:
            raise error_for(hresult.E_CAO_NOT_WRITABLE, self.name)
        self._entry.write(self._caller, value)

    def get_date_time(self) -> Value:
        """Return the time of the last read through this object; before the first read, the current time."""
        return self._moment()

    def get_microsecond(self) -> int:
        """Return the microseconds of the time returned by :meth:`get_date_time`, 0 to 999999."""
        return self._moment().microsecond

    def _moment(self) -> datetime:
        self._caller.require_read()
        return self._read or self._caller.state.calendar.now()


def _help(caller: ClientContext, kind: VariableClass, index: str) -> str:
    what = caller.state.say(kind.text)
    return f"{kind.name}{index}: {what} ({type_name(kind.vt)})"
