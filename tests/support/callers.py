"""Raw clients for UDP and serial lines, for tests of servers, and a device that counts the calls that it executes."""

from __future__ import annotations

import os
import select
import socket
import time
import tty
from abc import ABC, abstractmethod
from typing import Any, Self

from orinkit.bcap import packet
from orinkit.bcap.packet import Packet
from orinkit.bcap.profiles import DATAGRAM, LINE, BcapProfile
from orinkit.cao.provider import ClientInfo
from orinkit.values.codec import DEFAULT_LIMITS
from orinkit.values.variant import Variant, plain
from support.devices import Workshop, WorkshopController
from support.waiting import PATIENCE

START, STOP, CONNECT, GET_VARIABLE, EXECUTE, GET, PUT = 1, 2, 3, 9, 17, 101, 102
NOTHING = 0.15  # s, much longer than a reply takes


class CountingController(WorkshopController):
    """A workshop controller with the commands Count and CountLater."""

    def __init__(self, counting: Counting) -> None:
        super().__init__(counting)
        self._counting = counting

    def execute(self, command: str, parameter: Variant) -> Any:
        if command.startswith("Count"):
            self._counting.counts.append(plain(parameter))
            count = len(self._counting.counts)
            return count if command == "Count" else self._count_later(parameter, count)
        return super().execute(command, parameter)

    async def _count_later(self, parameter: Variant, count: int) -> int:
        await self._wait(parameter)
        return count


class Counting(Workshop):
    """A workshop that records the parameters of its commands Count and CountLater; CountLater waits for the gate.

    Attributes:
        counts: the parameters.
        visitors: the clients that have connected.
    """

    def __init__(self) -> None:
        super().__init__()
        self.counts: list[Any] = []
        self.visitors: list[ClientInfo] = []

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> CountingController:
        self.visitors.append(client)
        return CountingController(self)


class RawCaller(ABC):
    """A client that sends given bytes and returns received packets.

    Attributes:
        wire: the packet format of the transport.
    """

    wire: BcapProfile

    def __init__(self) -> None:
        self._serial = 0
        self._framer = self.wire.framer(self.wire.bound(DEFAULT_LIMITS))

    @abstractmethod
    def send(self, data: bytes) -> None:
        """Send bytes as they are."""

    @abstractmethod
    def receive(self, seconds: float) -> bytes | None:
        """Return the next bytes received, ``None`` after a time-out."""

    @abstractmethod
    def close(self) -> None:
        """Close the transport."""

    def encode(self, serial: int, function: int, *arguments: Any, reserved: int = 0) -> bytes:
        """Return a request as bytes."""
        return packet.encode(Packet(serial, function, list(arguments), reserved), crc=self.wire.crc)

    def request(self, function: int, *arguments: Any, serial: int | None = None, reserved: int = 0) -> int:
        """Send a request and return its serial."""
        self._serial = self._serial % 0xFFFF + 1 if serial is None else serial
        self.send(self.encode(self._serial, function, *arguments, reserved=reserved))
        return self._serial

    def packet(self, seconds: float = PATIENCE) -> Packet:
        """Return the next packet."""
        frame = self._framer.next_frame()
        end = time.monotonic() + seconds
        while frame is None:
            data = self.receive(end - time.monotonic())
            assert data is not None, "no reply"
            frame = self._framer.feed(data)
        return packet.decode(frame, crc=self.wire.crc)

    def nothing_comes(self) -> bool:
        """Return True if no reply arrives."""
        return self.receive(NOTHING) is None

    def ask(self, function: int, *arguments: Any) -> Any:
        """Send a request and return the result of the reply; the return code unless it is S_OK."""
        serial = self.request(function, *arguments)
        answer = self.packet()
        assert answer.serial == serial
        if answer.code:
            return answer.code
        return answer.arguments[0] if answer.arguments else None

    def open_workshop(self) -> int:
        """Connect to a workshop and return the handle."""
        handle = self.ask(CONNECT, "", "Test.Workshop", "", "")
        assert isinstance(handle, int)
        return handle

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class UdpRaw(RawCaller):
    """A raw client on UDP."""

    wire = DATAGRAM

    def __init__(self, url: str, family: int = socket.AF_INET, host: str = "127.0.0.1") -> None:
        super().__init__()
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self.socket.connect((host, int(url.rpartition(":")[2])))

    @property
    def port(self) -> int:
        return int(self.socket.getsockname()[1])

    def send(self, data: bytes) -> None:
        self.socket.send(data)

    def receive(self, seconds: float) -> bytes | None:
        self.socket.settimeout(max(seconds, 0.001))
        try:
            return self.socket.recv(65536)
        except TimeoutError:
            return None

    def close(self) -> None:
        self.socket.close()


class SerialRaw(RawCaller):
    """A raw client on a serial line: a descriptor, or the URL of a pseudo-terminal that the server has opened."""

    wire = LINE

    def __init__(self, place: str | int) -> None:
        super().__init__()
        if isinstance(place, str):
            place = os.open(place.removeprefix("serial://"), os.O_RDWR | os.O_NOCTTY)
            tty.setraw(place)
        self.descriptor = place
        os.set_blocking(self.descriptor, False)

    def send(self, data: bytes) -> None:
        while data:
            select.select([], [self.descriptor], [], PATIENCE)
            data = data[os.write(self.descriptor, data) :]

    def receive(self, seconds: float) -> bytes | None:
        readable, _, _ = select.select([self.descriptor], [], [], max(seconds, 0))
        return os.read(self.descriptor, 65536) if readable else None

    def close(self) -> None:
        os.close(self.descriptor)
