"""A controller whose names, values, messages and errors contain HTML and JavaScript, and are long."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from orinkit.cao import provider as p
from orinkit.cao.functions import FUNCTIONS
from orinkit.cao.provider import ClientInfo, Provider
from orinkit.cao.table import Function
from orinkit.values.variant import VarType

EVIL: Final = """"'><img src=x onerror="window.okBroken=1"><script>window.okBroken=1</script>{{okBroken=1}}"""
LONG: Final = "W" * 20_000 + EVIL
MESSAGES: Final = 300
_NAMES: Final = 200


def _method(function: Function[..., Any]) -> Callable[..., Any]:
    def method(self: Any, *arguments: Any) -> Any:
        if function.name == "Controller_GetMessage":
            self.messages += 1
            if self.messages > MESSAGES:
                raise p.not_implemented()
        if function.creates:
            return make(function.creates)
        if function.result is VarType.I4:
            return 1
        if function.result is VarType.BSTR:
            return EVIL
        if function.name.endswith("Names"):
            long = [] if function.name == "Controller_GetFileNames" else [LONG]  # a longer name of a file is refused
            return [EVIL, *long, *(f"<b>{number}</b>" for number in range(_NAMES))]
        return EVIL if function.result is VarType.VARIANT else None

    return method


_BASES: Final[dict[str, type[p.CaoObject]]] = {
    "Controller": p.ControllerObject, "Extension": p.ExtensionObject, "File": p.FileObject, "Robot": p.RobotObject,
    "Task": p.TaskObject, "Variable": p.VariableObject, "Command": p.CommandObject, "Message": p.MessageObject,
}  # fmt: skip
_CLASSES: Final = {
    interface: type(
        f"Hostile{interface}",
        (base,),
        {f.method: _method(f) for f in FUNCTIONS.values() if f.interface == interface and not f.releases},
    )
    for interface, base in _BASES.items()
}


def make(interface: str) -> Any:
    """Return an object."""
    made: Any = _CLASSES[interface](EVIL)
    made.messages = 0
    return made


class Hostile(Provider):
    """The provider of the controller."""

    provider_names = ("CaoProv.DENSO.VRC",)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        """Return the controller."""
        return make("Controller")
