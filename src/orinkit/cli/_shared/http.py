"""Options for serving e-CAP over HTTP."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Final

from cyclopts import Group, Parameter

from orinkit.cli._shared.errors import CommandError, usage_error
from orinkit.cli._shared.files import contains_private_key, exposure, read, read_token
from orinkit.core.errors import InvalidValue
from orinkit.core.i18n import tr
from orinkit.core.validation import check_range
from orinkit.server.http.options import DEFAULT_HTTP, LEAST_IDLE, MOST_IDLE, HttpOptions

HTTP: Final = Group(tr("HTTP"), sort_key=9)


@Parameter(name="*", group=HTTP)
@dataclass(frozen=True)
class HttpServerOptions:
    """Options for the access of clients over HTTP, and for the server's certificate."""

    token_file: Annotated[
        str | None,
        Parameter(help=tr('File with the token that clients must send ("Authorization: Bearer ...").')),
    ] = None
    cert: Annotated[
        str | None,
        Parameter(help=tr("PEM file with the server's certificate; enables https.")),
    ] = None
    key: Annotated[
        str | None,
        Parameter(help=tr("PEM file with the private key, if it is not in --cert.")),
    ] = None
    http_host: Annotated[
        tuple[str, ...],
        Parameter(
            help=tr(
                "Additional host name that clients may use for this server; IP addresses, localhost and "
                "the machine's name are always accepted."
            )
        ),
    ] = ()
    http_idle: Annotated[
        float,
        Parameter(
            help=tr(
                "Seconds without a request after which the session of an HTTP client ends and its objects are released."
            )
        ),
    ] = DEFAULT_HTTP.idle
    http_origin: Annotated[
        tuple[str, ...],
        Parameter(
            help=tr(
                "Origin of web pages that may call this server, for example https://panel.example:8443; "
                "by default, only the server's own pages may."
            )
        ),
    ] = ()
    http_charset: Annotated[
        str,
        Parameter(help=tr("Encoding of requests that do not name one, and of their replies: utf-8 or shift_jis.")),
    ] = DEFAULT_HTTP.charset

    @property
    def secure(self) -> bool:
        """True if the server has a certificate."""
        return self.cert is not None

    def exposures(self) -> Iterator[str]:
        """Yield a message for each file with a secret that other accounts can access."""
        key = self.cert if self.cert is not None and contains_private_key(self.cert) else None
        for option, path in (("--token-file", self.token_file), ("--cert", key), ("--key", self.key)):
            if path is not None and (text := exposure(option, path)):
                yield text

    def options(self, *, served: bool) -> HttpOptions:
        """Return the options of the HTTP server.

        Args:
            served: True if the server has an address for HTTP.

        Raises:
            CommandError: If a file cannot be read, or an option has no effect.
        """
        self._refuse_unused(served=served)
        for option, path in (("--cert", self.cert), ("--key", self.key)):
            if path is not None:
                read(option, path)
        token = "" if self.token_file is None else read_token(self.token_file)
        check_range("--http-idle", self.http_idle, LEAST_IDLE, MOST_IDLE, seconds=True)
        try:
            return HttpOptions(
                token,
                self.cert or "",
                self.key or "",
                self.http_host,
                self.http_idle,
                self.http_origin,
                self.http_charset,
            )
        except InvalidValue as error:
            raise CommandError(str(error), 2) from None

    def _refuse_unused(self, *, served: bool) -> None:
        if self.key is not None and self.cert is None:
            raise usage_error(tr("--key requires --cert"))
        given = {
            "--token-file": self.token_file is not None,
            "--cert": self.cert is not None,
            "--http-host": bool(self.http_host),
            "--http-idle": self.http_idle != DEFAULT_HTTP.idle,
            "--http-origin": bool(self.http_origin),
            "--http-charset": self.http_charset != DEFAULT_HTTP.charset,
        }
        options = ", ".join(option for option, is_given in given.items() if is_given)
        if options and not served:
            raise usage_error(
                tr(
                    "{options}: requires --http HOST:PORT; applies to e-CAP over HTTP only, not to b-CAP",
                    options=options,
                ),
            )
