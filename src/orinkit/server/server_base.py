"""Base class of the asyncio servers: ``async with``."""

from __future__ import annotations

from abc import ABC, abstractmethod
from types import TracebackType
from typing import Self


class ServerBase(ABC):
    """A server that is started and closed; ``async with`` does both."""

    @abstractmethod
    async def start(self) -> None:
        """Listen at every address."""

    @abstractmethod
    async def close(self) -> None:
        """Stop listening, disconnect all clients, and close the providers."""

    async def __aenter__(self) -> Self:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
