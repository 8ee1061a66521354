"""The least that can be served: variables that keep what is written. In processes of their own, at the last core."""

from __future__ import annotations

import multiprocessing.connection

import orinkit
from measuring import on_core
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, VariableObject
from orinkit.values.variant import Value, Variant

PROVIDER = "CaoProv.DENSO.VRC"


class Cell(VariableObject):
    """A variable that keeps what is written."""

    value: Variant | float = 0.0

    def get_value(self) -> Value:
        """The value."""
        return self.value

    def put_value(self, value: Variant) -> None:
        """Set it."""
        self.value = value


class Bench(ControllerObject):
    """The least controller."""

    def get_variable(self, name: str, option: str) -> Cell:  # noqa: ARG002
        """Any name will do."""
        return Cell(name)


class BenchProvider(Provider):
    """Serves it."""

    provider_names = (PROVIDER,)

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Bench:  # noqa: ARG002
        """Accept everyone."""
        return Bench(name)


def serve_until_told(provider: Provider, pipe: multiprocessing.connection.Connection, *urls: str) -> None:
    """Serve until the parent goes; it is told the addresses, in one text."""
    on_core(-1)
    with orinkit.serve(provider, *urls) as server:
        pipe.send(" ".join(server.urls))
        pipe.recv()


def tcp_server(pipe: multiprocessing.connection.Connection) -> None:
    """Serve it over b-CAP."""
    serve_until_told(BenchProvider(), pipe, "tcp://127.0.0.1:0")


def both_servers(pipe: multiprocessing.connection.Connection) -> None:
    """Serve it over b-CAP and e-CAP."""
    serve_until_told(BenchProvider(), pipe, "tcp://127.0.0.1:0", "http://127.0.0.1:0")
