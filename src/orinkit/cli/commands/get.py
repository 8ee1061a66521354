"""``orinkit get``: read a variable."""

from __future__ import annotations

from typing import Annotated, Final

from cyclopts import Parameter

from orinkit.cli._shared.connection import ConnectionOptions, Json, OwnerOptions, Url
from orinkit.core.i18n import tr

_CONNECTION: Final = ConnectionOptions()
_OWNING: Final = OwnerOptions()

Name = Annotated[str, Parameter(help=tr("Name of the variable: I1, IO150, P10, @MODE."))]


def get(
    url: Url,
    name: Name,
    /,
    *,
    owning: OwnerOptions = _OWNING,
    connection: ConnectionOptions = _CONNECTION,
    json: Json = False,
) -> None:
    """Read a variable and print its value."""
    from orinkit import functions
    from orinkit.cli._shared.output import print_json, text, typed_document

    with connection.opened(url) as controller:
        variable = owning.of(controller).variable(name)
        value = controller.client.request(functions.variable_get_value, variable.handle, exact=True).value
    if json:
        print_json({"name": name, **typed_document(value)})
    else:
        print(text(value))
