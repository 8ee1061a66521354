"""The pendant of a virtual RC8, over its control port: :class:`PendantLink`."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Mapping
from typing import Any, Final

from orinkit import aio
from orinkit.client._async.controller import AsyncController
from orinkit.core.errors import CallError, OrinError, ProtocolError
from orinkit.core.i18n import tr
from orinkit.tester.state.connection_spec import ConnectionSpec
from orinkit.values.variant import Value

logger = logging.getLogger("orinkit.tester")

PROVIDER: Final = "CaoProv.orinkit.Pendant"
_CLOSE_TIMEOUT: Final = 1.0  # s


class PendantLink:
    """The pendant. It is connected at the first use, and again after an error.

    The enable switch belongs to this connection: if the Tester ends, the switch is released.

    Args:
        spec: Parameters of the connection, with the control port.

    Attributes:
        status: The newest status (``orinkit pendant URL status``); empty if it is unknown.
    """

    def __init__(self, spec: ConnectionSpec) -> None:
        self._spec = spec
        self._controller: AsyncController | None = None
        self._lock = asyncio.Lock()
        self.status: Mapping[str, Any] = {}

    async def press(self, command: str, parameter: Value = None) -> None:
        """Execute the command of a button, then read the status.

        Raises:
            OrinError: If the control port cannot be reached, or refuses.
        """
        async with self._lock:
            await self._execute(command, parameter)
            await self._read()

    async def refresh(self) -> None:
        """Read the status.

        Raises:
            OrinError: If the control port cannot be reached.
        """
        async with self._lock:
            await self._read()

    async def close(self) -> None:
        """Disconnect."""
        controller, self._controller = self._controller, None
        self.status = {}
        if controller is not None:
            try:
                await controller.close(deadline=_CLOSE_TIMEOUT)
            except (OrinError, OSError) as error:
                logger.debug("closing the pendant failed: %s", error)

    async def _read(self) -> None:
        answer = await self._execute("Status", None)
        try:
            status = json.loads(answer)
        except (TypeError, ValueError, RecursionError):
            status = None
        if not isinstance(status, dict):
            raise ProtocolError(tr("unexpected reply to Status: {answer!r:.80}", answer=answer))
        self.status = status

    async def _execute(self, command: str, parameter: Value) -> Any:
        if self._controller is None:
            robot = f",Robot={self._spec.robot}" if self._spec.robot else ""
            option = f"Secret={self._spec.secret}{robot}"
            self._controller = await aio.connect(self._spec.control, provider=PROVIDER, option=option)
        try:
            return await self._controller.execute(command, parameter)
        except CallError:
            raise
        except OrinError:  # the connection may be lost
            await self.close()
            raise
