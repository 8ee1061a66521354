"""Options of serving e-CAP over HTTP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.cli._shared.errors import CommandError, unusable
from orinkit.cli._shared.files import read, read_token
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.server.http.options import DEFAULT_HTTP, HttpOptions

HTTP: Final = Group(tr("HTTP"), sort_key=9)


@Parameter(name="*", group=HTTP)
@dataclass(frozen=True)
class HttpServerOptions:
    """Who is let in over HTTP, and the server's certificate."""

    token_file: Annotated[
        str | None,
        Parameter(help=tr('File with a token that clients have to show ("Authorization: Bearer ...").')),
    ] = None
    cert: Annotated[
        str | None,
        Parameter(help=tr("PEM file with the server's certificate, for https.")),
    ] = None
    key: Annotated[
        str | None,
        Parameter(help=tr("PEM file with its key, if it is not in --cert.")),
    ] = None
    http_host: Annotated[
        tuple[str, ...],
        Parameter(
            help=tr(
                "Further name by which clients call this server; addresses, localhost and the machine's "
                "name are taken anyway."
            )
        ),
    ] = ()
    http_idle: Annotated[
        float,
        Parameter(
            help=tr("Seconds of silence after which an HTTP client is forgotten and all that it holds is released.")
        ),
    ] = DEFAULT_HTTP.idle

    @property
    def secure(self) -> bool:
        """Whether the server has a certificate."""
        return self.cert is not None

    def options(self, *, served: bool) -> HttpOptions:
        """Return what the server is told.

        Args:
            served: there is an address for HTTP.

        Raises:
            Failure: a file cannot be read, or an option makes no sense.
        """
        self._refuse_what_does_nothing(served=served)
        for option, path in (("--cert", self.cert), ("--key", self.key)):
            if path is not None:
                read(option, path)
        token = "" if self.token_file is None else read_token(self.token_file)
        try:
            return HttpOptions(token, self.cert or "", self.key or "", self.http_host, self.http_idle)
        except InvalidValue as error:
            raise CommandError(str(error), 2) from None

    def _refuse_what_does_nothing(self, *, served: bool) -> None:
        if self.key is not None and self.cert is None:
            raise unusable(tr("--key needs --cert"))
        given = {
            "--token-file": self.token_file is not None,
            "--cert": self.cert is not None,
            "--http-host": bool(self.http_host),
            "--http-idle": self.http_idle != DEFAULT_HTTP.idle,
        }
        options = ", ".join(option for option, is_given in given.items() if is_given)
        if options and not served:
            raise unusable(
                tr(
                    "{options} needs --http HOST:PORT: it is for e-CAP over HTTP, b-CAP has no such thing",
                    options=options,
                ),
            )
