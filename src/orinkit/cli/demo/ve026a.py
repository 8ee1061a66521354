"""``orinkit demo ve026a``: run the procedure of VE026A 6.2 over a pseudo-terminal, show packets, and check replies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

from orinkit.cli._shared.errors import CommandError
from orinkit.cli._shared.transcript import TracedPacket, Transcript
from orinkit.core.i18n import tr

if TYPE_CHECKING:
    import orinkit

_URL: Final = "pty://"
_SHOWN: Final = 3  # number of calls of slvMove that are shown at the beginning, and again at the end
_CYCLES: Final = 125  # set-points of the wave: 1 s
_HEIGHT: Final = 5.0  # deg
_PERIOD: Final = 0.008
_TRIES: Final = 5
_TOLERANCE: Final = 0.5  # deg, between the command and the encoders at the end


@dataclass(slots=True)
class VE026ADemo:
    """A run of the demo.

    Attributes:
        say: Callback invoked with each line to be printed.
        fields: True to explain packets field by field.
        steps: The steps with their packets, for JSON.
        answers: Number of replies checked.
    """

    say: Callable[[str], None]
    fields: bool
    steps: list[dict[str, Any]] = field(default_factory=list)
    answers: int = 0
    _transcript: Transcript = field(default_factory=Transcript)

    def run(self) -> None:
        """Run the demo.

        Raises:
            CommandError: If a reply differs from the document.
        """
        import orinkit
        from orinkit.bcap.profiles import MOST_TRIES
        from orinkit.virtual.ve026a import VirtualVE026A

        arm = VirtualVE026A()
        with orinkit.serve(arm, _URL) as server:
            self.say(tr("A virtual VE026A listens at {url}.", url=server.url))
            rc = self._step(
                "3",
                tr("connect"),
                lambda: orinkit.connect(server.url, provider="", tries=MOST_TRIES, trace=self._transcript),
            )
            with rc:
                self._procedure(rc)
            if arm.set_point_lateness.count:
                self.say(
                    tr(
                        "\n{lateness}: this computer was too busy. A real VE026A would have stopped.",
                        lateness=arm.set_point_lateness,
                    )
                )

    def _procedure(self, controller: orinkit.Controller) -> None:
        from orinkit.values.variant import Variant, VarType

        robot = self._step("4", tr("connect to the robot"), lambda: controller.robot("VE"))
        on, off = Variant(VarType.I2, 1), Variant(VarType.I2, 0)
        self._step("5", tr("motor on, about 3 s"), lambda: robot.execute("Motor", on))
        angles = self._step("6", tr("read @CURRENT_ANGLE"), lambda: robot.variable("@CURRENT_ANGLE").value)
        self.say(f"      {', '.join(f'{angle:g}' for angle in angles)}")
        deviation = self._slave_mode(controller, robot, angles)
        if deviation > _TOLERANCE:
            raise CommandError(tr("the arm is {deviation:.3f} deg away from its first pose", deviation=deviation))
        self._step("9", tr("motor off"), lambda: robot.execute("Motor", off))

    def _slave_mode(self, controller: orinkit.Controller, robot: orinkit.Robot, angles: list[float]) -> float:
        """Run steps 7 and 8 of VE026A 6.2; retry if this computer was too busy to send the set-points in time.

        Returns:
            Largest deviation of an axis, at the end of the wave, from its position before slave mode, deg.
        """
        steps = len(self.steps)
        for _ in range(_TRIES - 1):
            try:
                return self._there_and_back(robot, angles)
            except CommandError:
                self.say(
                    tr(
                        "      This computer was too busy for a set-point every 8 ms: clearing the error, "
                        "then retrying."
                    )
                )
                controller.clear_error()
                del self.steps[steps:]
                angles = robot.variable("@CURRENT_ANGLE").value
        return self._there_and_back(robot, angles)

    def _there_and_back(self, robot: orinkit.Robot, angles: list[float]) -> float:
        self._step(
            "7", tr("slave mode 2: synchronous"), lambda: robot.execute("slvChangeMode", 2)
        )  # fmt: skip
        there: list[float] = self._step(
            "8", tr("slvMove, {cycles} times: a wave of {height:g} deg", cycles=_CYCLES, height=_HEIGHT),
            lambda: self._wave(robot, angles),
        )  # fmt: skip
        return max(abs(now - then) for now, then in zip(there, angles, strict=True))

    def _wave(self, robot: orinkit.Robot, angles: list[float]) -> list[float]:
        """Move J1 away and back, set-point by set-point; return the feedback for the last set-point."""
        answer = angles
        for cycle in range(1, _CYCLES + 1):
            part = cycle / _CYCLES
            offset = _HEIGHT * (1 - math.cos(2 * math.pi * (part - math.sin(2 * math.pi * part) / (2 * math.pi)))) / 2
            answer = robot.execute("slvMove", [angles[0] + offset, *angles[1:]])
        robot.execute("slvChangeMode", 0)
        return answer

    def _step(self, section: str, title: str, call: Callable[[], Any]) -> Any:
        from orinkit.cli._shared.terminal import bold
        from orinkit.core.errors import OrinError

        first = len(self._transcript.packets)
        number = len(self.steps) + 1
        self.say(f"\n{bold(f'{number:2}. {title}')}  [VE026A 6.2 ({section})]")
        try:
            result = call()
        except OrinError as error:
            self._show(self._transcript.packets[first:])
            raise CommandError(f"{number}. {title}: {error}") from None
        packets = self._transcript.packets[first:]
        self._show(packets)
        self.answers += self._check(packets, title)
        self.steps.append(
            {"number": number, "title": title, "section": f"6.2 ({section})", "packets": [each.document() for each in packets]}
        )  # fmt: skip
        return result

    def _show(self, packets: list[TracedPacket]) -> None:
        """Show packets; if there are many, only the first and the last ones."""
        for place, packet in enumerate(packets):
            if place == 2 * _SHOWN and len(packets) > 4 * _SHOWN:
                self.say(tr("    ... {count} more ...", count=len(packets) - 4 * _SHOWN))
            if len(packets) <= 4 * _SHOWN or not 2 * _SHOWN <= place < len(packets) - 2 * _SHOWN:
                for line in packet.lines(fields=self.fields):
                    self.say(line)

    def _check(self, packets: list[TracedPacket], title: str) -> int:
        """Check checksum, serial number, reserved field and return code of each reply; return the number of replies.

        Replies with S_EXECUTING are checked, but not counted.
        """
        from orinkit.bcap import packet
        from orinkit.core import hresult

        requests: dict[int, int] = {}
        answers = 0
        for each in packets:
            read = packet.decode(each.data, crc=True)
            if each.direction == ">":
                requests[read.serial] = read.reserved
                continue
            good = (0, hresult.S_EXECUTING)
            if requests.get(read.serial) != read.reserved or read.code not in good:
                raise CommandError(f"{title}: {each.meaning}")
            answers += read.code == 0
        return answers


def run(say: Callable[[str], None], *, fields: bool) -> dict[str, Any]:
    """Run the demo and return its steps, for JSON.

    Raises:
        CommandError: If a reply differs from the document.
    """
    demo = VE026ADemo(say, fields)
    demo.run()
    say(tr("\nAll {count} replies match the document.", count=demo.answers))
    return {"steps": demo.steps, "as_documented": True}
