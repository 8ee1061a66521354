"""A minimal provider: variables that store a value. It is served in separate processes, on the last core."""

from __future__ import annotations

import multiprocessing.connection

import orinkit
from measuring import on_core
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, VariableObject
from orinkit.values.variant import Value, Variant

PROVIDER = "CaoProv.DENSO.VRC"


class Cell(VariableObject):
    """A variable that stores a value."""

    value: Variant | float = 0.0

    def get_value(self) -> Value:
        """Return the value."""
        return self.value

    def put_value(self, value: Variant) -> None:
        """Set the value."""
        self.value = value


class Bench(ControllerObject):
    """A minimal controller."""

    def get_variable(self, name: str, option: str) -> Cell:
        """Return a new variable for any name."""
        return Cell(name)


class BenchProvider(Provider):
    """The provider of the controller."""

    provider_names = (PROVIDER,)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Bench:
        """Accept every client."""
        return Bench(name)


def serve_until_terminated(provider: Provider, pipe: multiprocessing.connection.Connection, *urls: str) -> None:
    """Serve until the parent ends; send it the addresses in one text."""
    on_core(-1)
    with orinkit.serve(provider, *urls) as server:
        pipe.send(" ".join(server.urls))
        pipe.recv()


def tcp_server(pipe: multiprocessing.connection.Connection) -> None:
    """Serve the provider over b-CAP."""
    serve_until_terminated(BenchProvider(), pipe, "tcp://127.0.0.1:0")


def both_servers(pipe: multiprocessing.connection.Connection) -> None:
    """Serve the provider over b-CAP and e-CAP."""
    serve_until_terminated(BenchProvider(), pipe, "tcp://127.0.0.1:0", "http://127.0.0.1:0")
