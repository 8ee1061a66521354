"""``orinkit call``: call any function.

The command first connects and calls Service_Start and Controller_Connect. It inserts the handle of the controller, or
of the object that an option names, so ARGS do not contain a handle. Handles are valid for one connection only, so the
user cannot have a valid one. The option ``--handle`` sends any number as the handle, to test the reaction of a
controller.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Annotated, Any, Final

from cyclopts import Parameter

import orinkit
from orinkit import functions
from orinkit.cao.argument_text import read_argument
from orinkit.cao.replies import Reply
from orinkit.cao.table import Argument, Function
from orinkit.cao.user_functions import foreign_entry, is_user_function
from orinkit.cli._shared.connection import OBJECT, ConnectionOptions, Json, OwnerOptions, Url, robot_option
from orinkit.cli._shared.errors import CommandError, usage_error, whole_number
from orinkit.cli._shared.signature import signature
from orinkit.client._sync.objects import ObjectBase
from orinkit.core.errors import ObjectNotFound
from orinkit.core.hresult import lookup
from orinkit.core.i18n import N_, tr
from orinkit.values.notation import parse_lenient
from orinkit.values.variant import VarType

_CONNECTION: Final = ConnectionOptions()
_OWNING: Final = OwnerOptions()


@Parameter(name="*", group=OBJECT)
@dataclass(frozen=True)
class ObjectOptions:
    """Options for the object that a function applies to, in addition to :class:`OwnerOptions`."""

    variable: Annotated[
        str | None,
        Parameter(help=tr("Name of a variable of the controller, or of the object given by --robot, --task, --extension or "
            "--file.")),
    ] = None  # fmt: skip
    command: Annotated[str | None, Parameter(help=tr("Name of a command."))] = None
    handle: Annotated[
        int | None,
        Parameter(
            converter=whole_number, help=tr("Handle to send instead of the handle of the object; it is not checked.")
        ),
    ] = None


_OTHER: Final = ObjectOptions()


def call(
    url: Url,
    function: Annotated[
        str,
        Parameter(
            help=tr(
                "Id, name or Python name of the function: 17, Controller_Execute, controller_execute; "
                "from 255, the number of a user-defined function."
            )
        ),
    ],
    /,
    *args: Annotated[
        str,
        Parameter(help=tr("Arguments after the handle: text, 100, 1.5, true, or VARIANT notation 8197,1.5,2.5.")),
    ],
    owning: OwnerOptions = _OWNING,
    other: ObjectOptions = _OTHER,
    connection: ConnectionOptions = _CONNECTION,
    json: Json = False,
) -> None:  # fmt: skip
    """Call a function of the table and print its result."""
    from orinkit.cli._shared.output import jsonable, print_json, text, typed_document

    user = _user_function(function, len(args))
    entry = user or find(function)
    _check_options(entry, owning, other)
    if user is not None:
        with connection.opened(url) as controller:
            arguments = tuple(map(_user_argument, args))
            reply = _request(controller, entry, arguments)
    elif entry.interface == "Service" or entry is functions.controller_connect:
        arguments, reply = _call_service(entry, args, url, connection)
    else:
        sent = read_arguments(entry, entry.arguments[1:], args)
        with connection.opened(url) as controller:
            # keep a reference: an object that is garbage-collected releases its handle
            target = controller if other.handle is not None else _target(entry, controller, owning, other)
            arguments = (target.handle if other.handle is None else other.handle, *sent)
            reply = _request(controller, entry, arguments)
    name = lookup(reply.code).name
    if json:
        result = None if reply.value is None else typed_document(reply.value)
        print_json({"function": entry.name, "id": entry.id, "arguments": [jsonable(argument) for argument in arguments],
                    "code": reply.code, "code_name": name, "result": result})  # fmt: skip
    else:
        print(name if reply.value is None else text(reply.value))


def _user_function(name: str, count: int) -> Function[..., Any] | None:
    """Return the entry of a user-defined function if a name is the number of one; otherwise ``None``."""
    return foreign_entry(int(name), count) if name.isdecimal() and is_user_function(int(name)) else None


_TYPED: Final = re.compile(r"\s*[0-9]{1,5}\s*,")


def _user_argument(text: str) -> Any:
    """Return an argument of a user-defined function; a text without a type is sent without one over e-CAP."""
    value = parse_lenient(text)
    return value if _TYPED.match(text) else value.plain


_APPLY: Final[dict[str, tuple[str, ...]]] = {
    "Variable": ("robot", "robot_id", "task", "extension", "file", "variable"),
    "Robot": ("robot", "robot_id"), "Task": ("task",), "Extension": ("extension",), "File": ("file",), "Command": ("command",),
}  # fmt: skip


def _check_options(entry: Function[..., Any], owning: OwnerOptions, other: ObjectOptions) -> None:
    """Refuse an option for an object that the function does not apply to, instead of ignoring the option silently."""
    apply = _APPLY.get(entry.interface, ())
    for options in (owning, other):
        for option, value in vars(options).items():
            if value is not None and option != "handle" and option not in apply:
                raise usage_error(
                    tr(
                        "--{option} does not apply to {name}, a function of the interface {interface}",
                        option=option.replace("_", "-"),
                        name=entry.name,
                        interface=entry.interface,
                    ),
                )


def _request(controller: orinkit.Controller, entry: Function[..., Any], arguments: tuple[Any, ...]) -> Reply:
    try:
        return controller.client.request(entry, *arguments, exact=True)
    except ObjectNotFound:
        if entry is functions.controller_get_message:
            raise _no_message() from None
        raise


def _no_message() -> CommandError:
    return CommandError(tr("the controller has no message"))


def find(name: str) -> Function[..., Any]:
    """Return a function by its id, name or Python name; raise CommandError if it is unknown."""
    try:
        return functions.find(name)
    except KeyError as error:
        raise CommandError(str(error.args[0]), 2) from None


def _call_service(
    entry: Function[..., Any], texts: tuple[str, ...], url: str, connection: ConnectionOptions
) -> tuple[tuple[Any, ...], Any]:
    if entry is functions.controller_connect and not texts:
        given = connection.with_url(url)
        texts = ("", given.provider, given.machine, given.option)
    arguments = read_arguments(entry, entry.arguments, texts)
    with connection.open_client(url) as client:
        if entry is not functions.service_start:
            client.call(functions.service_start)
        reply = client.request(entry, *arguments, exact=True)
        if entry is not functions.service_stop:
            client.call(functions.service_stop)
    return arguments, reply


def _target(
    entry: Function[..., Any], controller: orinkit.Controller, owning: OwnerOptions, other: ObjectOptions
) -> ObjectBase:
    """Return the object that the function applies to."""
    match entry.interface:
        case "Controller":
            return controller
        case "Variable":
            return owning.of(controller).variable(_named(entry, "variable", other.variable))
        case "Command":
            return controller.command(_named(entry, "command", other.command))
        case "Robot":
            return controller.robot(_named(entry, "robot", owning.robot), robot_option(owning.robot_id))
        case "Task":
            return controller.task(_named(entry, "task", owning.task))
        case "Extension":
            return controller.extension(_named(entry, "extension", owning.extension))
        case "File":
            return controller.file(_named(entry, "file", owning.file))
    message = controller.message()
    if message is None:
        raise _no_message()
    return message


def _named(entry: Function[..., Any], kind: str, name: str | None) -> str:
    if name is None:
        raise usage_error(
            tr("{name} requires a {kind}. Try: --{kind} NAME", name=entry.name, kind=kind),
        )
    return name


def read_arguments(
    entry: Function[..., Any], arguments: tuple[Argument, ...], texts: tuple[str, ...]
) -> tuple[Any, ...]:
    """Return the arguments of a call from words of the command line.

    Args:
        entry: The function.
        arguments: The arguments of the function, without the handle.
        texts: The words.

    Raises:
        CommandError: If there are too many or too few words.
        InvalidValue: If a word does not have the type of its argument.
        NotationError: If a word is invalid VARIANT notation.
    """
    required = sum(not argument.optional for argument in arguments)
    if not required <= len(texts) <= len(arguments):
        takes = f"{required}" if required == len(arguments) else f"{required}-{len(arguments)}"
        several = len(texts) > len(arguments) > 0 and arguments[-1].vt is VarType.VARIANT
        raise usage_error(
            tr(
                "{count} arguments given, {wanted} expected for {function}; the handle is added automatically",
                count=len(texts),
                wanted=takes,
                function=signature(entry),
            )
            + (tr(_SEVERAL) if several else "")
        )
    return tuple(read_argument(argument, text) for argument, text in zip(arguments, texts, strict=False))


_SEVERAL: Final = N_('. Try: pass several values as one argument, for example 8197,10,50 or "8204,(5,1),(11,1)"')
