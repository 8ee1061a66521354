# The extension in C (csrc); only orinkit.core.speedups imports it.

from collections.abc import Callable
from typing import Any, TypeVar

_F = TypeVar("_F", bound=Callable[..., Any])

def replaced(name: str, function: _F, /) -> _F: ...
def set_codec(
    variant: type,
    limits: type,
    default_limits: object,
    amount_to_wire: Callable[[Any], int],
    date_to_wire: Callable[[Any], float],
    amount_from_wire: Callable[[int], object],
    date_from_wire: Callable[[float], object],
    date_from_wire_exact: Callable[[float], object],
    /,
) -> None: ...
def set_exchange(unfinished: type, variant: object, integer: object, string: object, /) -> None: ...
def native_template(function: object, count: int, constants: bytes, varies: bool, most: int, /) -> object: ...
def set_timeout(descriptor: int, seconds: float, /) -> None: ...
def native_request(template: object, serial: int, value: object, /) -> bytes | None: ...
def set_requests(argument_types: dict[int, bytes], /) -> None: ...
