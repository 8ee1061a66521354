"""A device with decorators, served over a real socket and called by the client."""

from __future__ import annotations

import asyncio
import subprocess
import sys
import threading
from datetime import datetime
from decimal import Decimal

import pytest

import orinkit
from orinkit import Device, Part, Provider, VarType, command, variable
from orinkit.cao.provider import CommandObject, RobotObject
from orinkit.core import hresult, i18n
from orinkit.core.errors import CallError, ConnectFailed, InvalidArgument, ObjectNotFound, error_for
from orinkit.device import command_object, extension, file, robot, task
from support.waiting import PATIENCE


class Finger(Part):
    """A finger."""

    @variable("POS", quick=True)
    def position(self) -> float:
        return 1.5

    @command("Bend", quick=True)
    def bend(self, degrees: float) -> float:
        return degrees * 2


class Arm(RobotObject):
    def get_variable_names(self, option: str) -> list[str]:
        return [f"names with {option!r}"]


class Homing(CommandObject):
    def get_state(self) -> int:
        return 7


class Gripper(Device):
    """A gripper."""

    provider_names = ("CaoProv.Example.Gripper",)

    def __init__(self) -> None:
        self.mm = 30.0
        self.count = 0
        self.gate = threading.Event()
        self.finger = Finger()

    @variable("WIDTH", help="Opening in mm", type=VarType.R4)
    def width(self) -> float:
        return self.mm

    @width.setter
    def set_width(self, mm: float) -> None:
        self.mm = mm

    @variable("COUNT", quick=True)
    def counter(self) -> int:
        """The number of closings."""
        return self.count

    @counter.setter
    def set_counter(self, count: int) -> None:
        self.count = count

    @variable("NAME")
    async def label(self) -> str:
        await asyncio.sleep(0)
        return "G1"

    @label.setter
    async def set_label(self, label: str) -> None:
        await asyncio.sleep(0)
        self.seen = label

    @variable("ANY", quick=True)
    def anything(self) -> object:
        return orinkit.Variant(VarType.I2, 5)

    @anything.setter
    def set_anything(self, value: object) -> None:
        self.any = value

    @variable("POSE", type=VarType.R4 | VarType.ARRAY, quick=True)
    def pose(self) -> list[float]:
        return [1, 2, 3]

    @pose.setter
    def set_pose(self, pose: list[float]) -> None:
        self.seen_pose = pose

    @command("Close")
    def close_fingers(self, force: float = 10.0, times: int = 1) -> str:
        self.count += times
        return f"closed with {force}"

    @command("Sum", quick=True)
    def total(self, *values: float) -> float:
        return sum(values)

    @command("Take", quick=True)
    def take(self, pose: list[float]) -> int:
        return len(pose) if isinstance(pose, list) else -1

    @command("Wait")
    def wait(self) -> bool:
        return self.gate.wait(30)

    @command("Boom", quick=True)
    def boom(self) -> None:
        raise RuntimeError("bang")

    @command("Refuse", quick=True)
    def refuse(self) -> None:
        raise error_for(hresult.E_ACCESSDENIED)

    @extension("Finger0", help="The only finger")
    def finger0(self) -> Part:
        return self.finger

    @robot("Arm")
    def arm(self) -> RobotObject:
        return Arm("Arm")

    @task("T1")
    def first_task(self) -> Part:
        return self.finger

    @file("F1")
    def folder(self) -> Part:
        return Folder()

    @command_object("Homing")
    def homing(self) -> CommandObject:
        return Homing("Homing")

    @command_object("Wrong")
    def wrong(self) -> Part:
        return self.finger


class Folder(Part):
    @file("Inner")
    def inner(self) -> Part:
        return Folder()


@pytest.fixture
def gripper():
    device = Gripper()
    with orinkit.serve(device, "tcp://127.0.0.1:0") as server:
        device.url = server.url
        yield device
        device.gate.set()


@pytest.fixture
def client(gripper):
    with orinkit.connect(gripper.url, provider="caoprov.example.gripper", timeout=PATIENCE) as controller:
        yield controller


def test_a_variable_has_the_declared_type_both_ways(gripper, client):
    width = client.variable("width")
    assert width.value == 30.0
    reply = client.client.request(orinkit.functions.variable_get_value, width.handle, exact=True)
    assert reply.value == orinkit.Variant(VarType.R4, 30.0)
    for given in (12.5, "12.5", [12.5], orinkit.Variant(VarType.R4, 12.5)):
        gripper.mm = 0.0
        width.value = given
        assert gripper.mm == 12.5
    width.value = True
    assert gripper.mm == -1.0


@pytest.mark.parametrize(
    ("name", "value"), [("WIDTH", "wide"), ("COUNT", 1.5), ("NAME", 3), ("POSE", "x"), ("COUNT", None)]
)
def test_a_value_of_the_wrong_type_is_a_type_mismatch(client, name, value):
    with pytest.raises(InvalidArgument) as caught:
        client.variable(name).value = value
    assert caught.value.code == hresult.DISP_E_TYPEMISMATCH


def test_types_come_from_the_annotation_of_the_getter(gripper, client):
    assert client.variable("COUNT").value == 0
    client.variable("COUNT").value = 4.0
    assert gripper.count == 4
    assert client.variable("NAME").value == "G1"
    client.variable("NAME").value = "G2"
    assert gripper.seen == "G2"
    assert client.variable("ANY").value == 5
    client.variable("ANY").value = [1, 2.5]
    assert gripper.any == [1, 2.5]
    assert client.variable("POSE").value == [1.0, 2.0, 3.0]
    client.variable("POSE").value = [4, 5, 6]
    assert gripper.seen_pose == [4.0, 5.0, 6.0]


def test_names_help_attribute_tag_id_and_time(client):
    width = client.variable("WIDTH")
    assert (width.name, width.help, width.attribute) == ("WIDTH", "Opening in mm", 3)
    count = client.variable("COUNT")
    assert count.help == "The number of closings."
    assert client.extension("finger0").variable("POS").attribute == 1
    width.tag, width.id = ["mine", 1], 5
    assert (width.tag, width.id) == (["mine", 1], 5)
    assert client.variable("WIDTH").tag is None
    before = datetime.now().replace(microsecond=0)
    assert width.value is not None
    assert before <= width.date_time <= datetime.now()
    assert 0 <= width.microsecond < 1_000_000
    assert client.help == "A gripper."
    assert client.variable_names() == ["WIDTH", "COUNT", "NAME", "ANY", "POSE"]
    assert client.extension_names() == ["Finger0"]
    assert client.robot_names() == ["Arm"]
    assert client.task_names() == ["T1"]
    assert client.file_names() == ["F1"]
    assert client.command_names() == ["Homing", "Wrong"]


def test_a_variable_without_setter_is_not_writable(client):
    with pytest.raises(CallError) as caught:
        client.extension("Finger0").variable("POS").value = 2.0
    assert caught.value.code == hresult.E_CAO_NOT_WRITABLE


def test_a_parameter_is_spread_over_the_arguments(client):
    assert client.execute("CLOSE") == "closed with 10.0"
    assert client.execute("close", 5.0) == "closed with 5.0"
    assert client.execute("close", [5.0, 2]) == "closed with 5.0"
    assert client.variable("COUNT").value == 4
    assert client.execute("Sum", [1.0, 2.0, 3.0]) == 6.0
    assert client.execute("Take", [1.0, 2.0]) == 2
    assert client.execute("Take", 1.0) == -1


@pytest.mark.parametrize(("name", "parameter", "code"), [
    ("Close", [1.0, 2.0, 3.0], hresult.E_INVALIDARG), ("Take", None, hresult.E_INVALIDARG),
    ("Nothing", None, hresult.E_INVALID_CMD_NAME), ("Refuse", None, hresult.E_ACCESSDENIED),
])  # fmt: skip
def test_refusals_have_their_codes(client, name, parameter, code):
    with pytest.raises(CallError) as caught:
        client.execute(name, parameter)
    assert caught.value.code == code


def test_an_exception_in_a_handler_is_e_fail_and_nothing_else_breaks(client, caplog):
    with pytest.raises(CallError) as caught:
        client.execute("Boom")
    assert caught.value.code == hresult.E_FAIL
    assert "bang" in caplog.text
    assert client.execute("Sum", [1.0]) == 1.0


# --- error descriptions -----------------------------------------------------------------------------------------------


class Faulty(Device):
    provider_names = ("Test.Faulty",)

    def __init__(self) -> None:
        self.entered = threading.Event()
        self.gate = threading.Event()

    @command("Fail")
    def fail(self, text: str) -> None:
        raise RuntimeError(text)

    @command("FailAtOnce", quick=True)
    def fail_at_once(self, text: str) -> None:
        raise RuntimeError(text)

    @command("FailAwaited")
    async def fail_awaited(self, text: str) -> None:
        await asyncio.sleep(0)
        raise RuntimeError(text)

    @command("FailBehindTheGate")
    def fail_behind_the_gate(self, text: str) -> None:
        self.entered.set()
        assert self.gate.wait(30)
        raise RuntimeError(text)

    @command("Refuse")
    def refuse(self, code: int, detail: str = "") -> None:
        raise error_for(code, detail)

    @variable("BROKEN")
    def broken(self) -> float:
        raise OSError("the cable is out")

    @broken.setter
    def set_broken(self, value: float) -> None:
        raise OSError(f"no {value}")

    @variable("STATE", quick=True)
    def state(self) -> int:
        return 1

    @extension("Broken")
    def broken_extension(self) -> Part:
        raise LookupError("no such board")


class Telling(Faulty):
    provider_names = ("Test.Telling",)

    @command("getErrorDescription")
    def tell(self, code: int) -> str:
        return f"mine: {code}"


@pytest.fixture
def faulty(listen_at):
    device = Faulty()
    with orinkit.serve(device, listen_at) as server:
        device.url = server.url
        yield device
        device.gate.set()


def talk_to(device: Faulty) -> orinkit.Controller:
    return orinkit.connect(device.url, provider="Test.Faulty", timeout=PATIENCE)


def code_of(call, *arguments: object) -> int:
    with pytest.raises(CallError) as caught:
        call(*arguments)
    return caught.value.code


@pytest.mark.parametrize("way", ["Fail", "FailAtOnce", "FailAwaited"])
def test_a_client_can_read_the_exception_of_a_handler(faulty, way, caplog):
    with talk_to(faulty) as c:
        for text in ("bang", "ドカン", "again"):
            assert code_of(c.execute, way, text) == hresult.E_FAIL
            assert c.error_description(hresult.E_FAIL) == f"RuntimeError: {text}"
            assert text in caplog.text
        assert c.execute("GETERRORDESCRIPTION", [hresult.signed(hresult.E_FAIL)]) == "RuntimeError: again"
        assert c.variable("STATE").value == 1


def test_a_client_can_read_the_exception_of_a_variable_or_a_child_object(faulty):
    with talk_to(faulty) as c:
        broken = c.variable("BROKEN")
        assert code_of(broken.get_value) == hresult.E_FAIL
        assert c.error_description(hresult.E_FAIL) == "OSError: the cable is out"
        assert code_of(broken.put_value, 2.5) == hresult.E_FAIL
        assert c.error_description(hresult.E_FAIL) == "OSError: no 2.5"
        assert code_of(c.extension, "Broken") == hresult.E_FAIL
        assert c.error_description(hresult.E_FAIL) == "LookupError: no such board"


def test_the_description_is_the_detail_or_else_the_meaning_of_the_code(faulty):
    with talk_to(faulty) as c:
        assert c.error_description(0x80040201) == hresult.lookup(0x80040201).text
        assert c.error_description(hresult.E_FAIL) == hresult.lookup(hresult.E_FAIL).text
        assert code_of(c.execute, "Refuse", [hresult.signed(0x80040201), "too wide"]) == 0x80040201
        assert code_of(c.execute, "Refuse", hresult.signed(0x80040202)) == 0x80040202
        assert c.error_description(0x80040201) == "too wide"
        assert c.error_description(hresult.signed(0x80040201)) == "too wide"
        assert c.execute("GetErrorDescription", float(0x80040201)) == "too wide"
        assert c.error_description(0x80040202) == hresult.lookup(0x80040202).text
        assert code_of(c.execute, "Refuse", hresult.signed(0x80040201)) == 0x80040201
        assert c.error_description(0x80040201) == hresult.lookup(0x80040201).text  # the last error has no detail
        assert code_of(c.variable, "NOBODY") == hresult.E_CAO_OBJECT_NOTFOUND
        assert "'NOBODY'" in c.error_description(hresult.E_CAO_OBJECT_NOTFOUND)
        assert c.error_description(0) == hresult.lookup(0).text


@pytest.mark.parametrize(("code", "refusal"), [
    (None, hresult.E_INVALIDARGTYPE), ("", hresult.E_INVALIDARGTYPE), ("what", hresult.E_INVALIDARGTYPE),
    (2.5, hresult.E_INVALIDARG), (float("nan"), hresult.E_INVALIDARG), (float("inf"), hresult.E_INVALIDARG),
    (2.0**32, hresult.E_INVALIDARG), ("9" * 90, hresult.E_INVALIDARG), ([1, 2], hresult.E_INVALIDARGTYPE),
])  # fmt: skip
def test_invalid_codes_are_refused(faulty, code, refusal):
    with talk_to(faulty) as c:
        assert code_of(c.execute, "GetErrorDescription", code) == refusal
        assert c.variable("STATE").value == 1


def test_a_long_text_is_cut():
    device = Faulty()
    with (
        orinkit.serve(device, "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Faulty", timeout=PATIENCE) as c,
    ):
        assert code_of(c.execute, "Fail", "x" * 100_000) == hresult.E_FAIL
        text = c.error_description(hresult.E_FAIL)
        assert text.startswith("RuntimeError: xxx")
        assert len(text) == 1000


def test_a_device_can_declare_the_command_itself():
    device = Telling()
    with (
        orinkit.serve(device, "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Telling", timeout=PATIENCE) as c,
    ):
        assert code_of(c.execute, "Fail", "bang") == hresult.E_FAIL
        assert c.error_description(hresult.E_FAIL) == f"mine: {hresult.signed(hresult.E_FAIL)}"


def test_errors_of_other_clients_cannot_be_read():
    device = Faulty()
    with (
        orinkit.serve(device, "tcp://127.0.0.1:0", "udp://127.0.0.1:0") as server,
        orinkit.connect(server.urls[0], provider="Test.Faulty", timeout=PATIENCE) as one,
        orinkit.connect(server.urls[1], provider="Test.Faulty", timeout=PATIENCE) as other,
    ):
        assert code_of(one.execute, "Fail", "one") == hresult.E_FAIL
        assert other.error_description(hresult.E_FAIL) == hresult.lookup(hresult.E_FAIL).text
        assert code_of(other.execute, "Fail", "other") == hresult.E_FAIL
        assert one.error_description(hresult.E_FAIL) == "RuntimeError: one"


def test_a_late_exception_of_a_handler_does_not_affect_other_clients():
    device = Faulty()
    codes = []
    with (
        orinkit.serve(device, "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Faulty", timeout=PATIENCE) as one,
        orinkit.connect(server.url, provider="Test.Faulty", timeout=PATIENCE) as other,
    ):
        waiting = threading.Thread(target=lambda: codes.append(code_of(one.execute, "FailBehindTheGate", "late")))
        waiting.start()
        try:
            assert device.entered.wait(30)  # the handler now runs until the gate is opened
            assert other.variable("STATE").value == 1
            assert code_of(other.execute, "Fail", "meanwhile") == hresult.E_FAIL
            assert codes == []
        finally:
            device.gate.set()
            waiting.join(30)
        assert codes == [hresult.E_FAIL]
        assert one.error_description(hresult.E_FAIL) == "RuntimeError: late"
        assert other.error_description(hresult.E_FAIL) == "RuntimeError: meanwhile"
        assert one.variable("STATE").value == other.variable("STATE").value == 1


# --- exceptions of all kinds ------------------------------------------------------------------------------------------


class Rogue(Device):
    provider_names = ("Test.Rogue",)
    price = Decimal(0)

    @command("Thread")
    def in_thread(self, which: str) -> None:
        raise RAISED[which]

    @command("Quick", quick=True)
    def at_once(self, which: str) -> None:
        raise RAISED[which]

    @command("Async")
    async def awaited(self, which: str) -> None:
        await asyncio.sleep(0)
        raise RAISED[which]

    @command("Next")
    def first(self, wanted: int) -> int:
        return next(number for number in (1, 2, 3) if number == wanted)

    @variable("PRICE", type=VarType.CY)
    def get_price(self) -> Decimal:
        return self.price

    @get_price.setter
    def set_price(self, price: Decimal) -> None:
        self.price = price

    @extension("Nothing")
    def nothing(self) -> Part:
        return None


RAISED = {
    "exit": SystemExit(3),
    "interrupt": KeyboardInterrupt(),
    "cancelled": asyncio.CancelledError(),
    "generator": GeneratorExit(),
    "base": BaseException("base"),
    "success": CallError(0),
    "executing": CallError(hresult.S_EXECUTING),
}


@pytest.mark.parametrize("way", ["Thread", "Quick", "Async"])
@pytest.mark.parametrize("which", RAISED)
def test_any_exception_of_a_handler_is_e_fail_and_the_server_continues(way, which, caplog):
    with (
        orinkit.serve(Rogue(), "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Rogue", timeout=PATIENCE) as c,
    ):
        for _ in range(2):
            with pytest.raises(CallError) as caught:
                c.execute(way, which)
            assert caught.value.code == hresult.E_FAIL
        with orinkit.connect(server.url, provider="Test.Rogue") as other:
            assert other.variable_names() == ["PRICE"]
    assert "the device raised an exception" in caplog.text


def test_stop_iteration_in_a_handler_is_e_fail():
    with (
        orinkit.serve(Rogue(), "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Rogue", timeout=PATIENCE) as c,
    ):
        assert c.execute("Next", 2) == 2
        with pytest.raises(CallError) as caught:
            c.execute("Next", 7)
        assert caught.value.code == hresult.E_FAIL
        with pytest.raises(CallError) as caught:
            c.extension("Nothing")
        assert caught.value.code == hresult.E_FAIL
        price = c.variable("PRICE")
        for given, kept in ((Decimal("2.5"), Decimal("2.5")), (3, Decimal(3)), ("1.25", Decimal("1.25"))):
            price.value = given
            assert price.value == kept


def test_a_handler_that_never_returns_does_not_prevent_the_program_from_ending():
    program = """
import threading, orinkit
class Stuck(orinkit.Device):
    provider_names = ("Test.Stuck",)
    @orinkit.command("Wait")
    def wait(self) -> None:
        threading.Event().wait()
with orinkit.serve(Stuck(), "tcp://127.0.0.1:0") as server:
    client = orinkit.connect(server.url, provider="Test.Stuck", timeout=30, service="")
    client.client.timeout = 0.3
    try:
        client.execute("Wait")
    except orinkit.CallTimeout:
        client.client.close()
print("ended")
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (0, "ended\n")


def test_a_failed_start_does_not_close_the_device(gripper):
    class Closing(Gripper):
        closed = 0

        def close(self) -> None:
            self.closed += 1

    device = Closing()
    with pytest.raises(ConnectFailed):
        orinkit.serve(device, gripper.url)
    assert device.closed == 0
    with orinkit.serve(device, "tcp://127.0.0.1:0"):
        pass
    assert device.closed == 1


def test_child_objects_are_parts_or_provider_objects(client):
    finger = client.extension("Finger0")
    assert finger.help == "The only finger"
    assert finger.execute("Bend", 10.0) == 20.0
    assert client.robot("arm").variable_names("o") == ["names with 'o'"]
    assert client.task("T1").variable("pos").value == 1.5
    assert client.file("F1").file("Inner").file_names() == ["Inner"]
    assert client.command("Homing").state == 7
    with pytest.raises(CallError) as caught:
        client.command("Wrong")
    assert caught.value.code == hresult.E_FAIL


@pytest.mark.parametrize("kind", ["variable", "extension", "robot", "task", "file", "command"])
def test_unknown_names_are_not_found(client, kind):
    with pytest.raises(ObjectNotFound):
        getattr(client, kind)("Nobody")


def test_a_waiting_handler_does_not_delay_other_clients(gripper, client):
    result = []
    waiting = threading.Thread(target=lambda: result.append(client.execute("Wait")))
    waiting.start()
    with orinkit.connect(gripper.url, provider="CaoProv.Example.Gripper") as other:
        assert other.variable("WIDTH").value == 30.0
        gripper.gate.set()
    waiting.join(30)
    assert result == [True]


def test_arguments_are_converted_as_annotated(gripper, client):
    assert client.execute("Close", ["5", "2"]) == "closed with 5.0"
    assert gripper.count == 2
    with pytest.raises(InvalidArgument):
        client.execute("Close", "tight")
    with pytest.raises(InvalidArgument):
        client.execute("Close", [1.0, 0.5])


def test_errors_in_a_declaration_are_raised_immediately():
    with pytest.raises(TypeError, match="a name"):
        variable(lambda self: 1)(lambda self: 1)
    with pytest.raises(TypeError, match="VarType"):
        variable("X", type="R4")(lambda self: 1)
    with pytest.raises(TypeError, match="VarType"):
        variable("X", type=99)(lambda self: 1)
    with pytest.raises(TypeError, match="twice"):

        class Twice(Device):
            @variable("X")
            def one(self) -> int:
                return 1

            @variable("x")
            def two(self) -> int:
                return 2


def test_a_subclass_inherits_and_overrides_what_is_declared():
    class Better(Gripper):
        @variable("WIDTH", quick=True)
        def width(self) -> float:
            return 99.0

        @variable("EXTRA", quick=True)
        def extra(self) -> int:
            return 1

    device = Better()
    with (
        orinkit.serve(device, "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider=Gripper.provider_names[0]) as c,
    ):
        assert c.variable("WIDTH").value == 99.0
        assert c.variable_names() == ["WIDTH", "COUNT", "NAME", "ANY", "POSE", "EXTRA"]
    with (
        orinkit.serve(Gripper(), "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider=Gripper.provider_names[0]) as c,
    ):
        assert c.variable_names() == ["WIDTH", "COUNT", "NAME", "ANY", "POSE"]


# --- reserved names ---------------------------------------------------------------------------------------------------

RESERVED = sorted(name for name in vars(Provider) if not name.startswith("_"))
DECLARATIONS = {
    "variable": variable, "command": command, "extension": extension, "robot": robot, "task": task, "file": file,
    "command_object": command_object,
}  # fmt: skip


def make(name: str, member: object, *bases: type) -> type:
    return type("Mine", bases or (Device,), {name: member})


@pytest.mark.parametrize("decorator", DECLARATIONS)
@pytest.mark.parametrize("name", [*RESERVED, "__init__"])
def test_a_declared_member_cannot_have_a_reserved_name(name, decorator):
    declared = DECLARATIONS[decorator]("X")(lambda self: 1)
    with pytest.raises(
        TypeError, match=rf"^Mine\.{name} cannot be declared: {name} is reserved for .*\. Try: "
    ) as caught:
        make(name, declared)
    other = {"close": "as close_fingers;", "connect": "as open_port;"}.get(name, f"as my_{name.strip('_')};")
    assert other in str(caught.value)
    i18n.use("ja")
    with pytest.raises(TypeError, match=rf"Mine\.{name} は宣言に使えません"):
        make(name, declared)


def test_a_mixin_cannot_declare_a_reserved_name():
    class Mixin(Part):  # these names are not reserved in a part
        @command("Close")
        def close(self) -> None:
            pass

    with pytest.raises(TypeError, match=r"Mine\.close cannot be declared"):
        make("x", 1, Mixin, Device)


WRONG = {
    "connect": [lambda self: None, lambda self, port: None, "COM3", None, staticmethod(lambda a, b, c: None)],
    "close": [lambda self, force: None, True],
    "handle_of": [lambda self, name: 1],
    "functions": [["open"], lambda self: [], "x"],
    "guard": [lambda self: None, 5],
    "dialect": ["b-CAP"],
    "fixed_handles": [lambda self: True, 3],
    "provider_names": [lambda self: ("Test.X",)],
    "requires_secret": [lambda self: True, 1],
    "unique_names": [lambda self: True, 1],
    "unwraps_variants": [lambda self: True, 1],
    "user_functions": [lambda self, number: [], 5],
}


def test_every_reserved_name_is_checked():
    assert sorted(WRONG) == RESERVED


@pytest.mark.parametrize(("name", "member"), [(name, member) for name, members in WRONG.items() for member in members])
def test_a_plain_member_that_the_server_cannot_use_is_refused(name, member):
    with pytest.raises(TypeError, match=rf"^Mine\.{name} must be .*: it is reserved for the server\. Try: "):
        make(name, member)
    i18n.use("ja")
    with pytest.raises(
        TypeError, match=rf"^Mine\.{name} は .* でなければなりません: サーバ用に予約された名前です。対処: "
    ):
        make(name, member)


def test_an_attribute_of_the_object_that_the_server_cannot_use_is_refused():
    device = Gripper()
    for name, value in (("connect", object()), ("functions", ["a"]), ("close", None), ("guard", 1)):
        with pytest.raises(TypeError, match=rf"^Gripper\.{name} must be "):
            setattr(device, name, value)


def test_what_the_server_can_use_may_be_overridden():
    async def connect(self, *arguments: object) -> None: ...

    for name, member in (
        ("connect", connect), ("connect", lambda self, name, machine, option, client, extra=1: None),
        ("close", lambda self: None), ("close", staticmethod(lambda: None)), ("close", classmethod(lambda cls: None)),
        ("handle_of", lambda self, interface, name: 2), ("functions", frozenset({3})), ("functions", None),
        ("guard", threading.Lock()), ("guard", property(lambda self: threading.Lock())), ("fixed_handles", True), ("requires_secret", True),
        ("provider_names", ["Test.X"]), ("provider_names", property(lambda self: ("Test.X",))),
    ):  # fmt: skip
        make(name, member)
    device = Gripper()
    device.guard, device.provider_names, device.close = threading.RLock(), ["Test.X"], lambda: None


class Free(Device):
    """A device with members whose names are no longer reserved."""

    provider_names = ("Test.Free",)

    def __init__(self) -> None:
        self.declared = {"a": 1}
        self.kind = self._declared = self._names = None

    @variable("NAMES")
    def names(self) -> str:
        return "a, b"

    @command("Close")
    def close_fingers(self) -> str:
        return "closed"


class Plain(Free):
    names = ["left", "right"]  # noqa: RUF012 - as people write it

    def __init__(self) -> None:
        super().__init__()
        self.names = ["other"]


@pytest.mark.parametrize("kind", [Free, Plain])
def test_names_and_declared_are_free(kind):
    with (
        orinkit.serve(kind(), "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Free", timeout=PATIENCE) as c,
    ):
        assert c.variable_names() == ["NAMES"]
        assert c.variable("NAMES").value == "a, b"
        assert c.execute("Close") == "closed"


@pytest.mark.parametrize("decorator", DECLARATIONS)
def test_a_decorator_without_a_name_raises_immediately(decorator):
    for wrong in (lambda self: 1, "", None, 5):
        with pytest.raises(TypeError, match=rf'@{decorator}\("NAME"\)$'):
            DECLARATIONS[decorator](wrong)
    i18n.use("ja")
    with pytest.raises(TypeError, match=rf'コントローラでの名前が必要です。対処: @{decorator}\("名前"\)$'):
        DECLARATIONS[decorator](lambda self: 1)


def test_a_declared_variable_is_a_property_in_its_class() -> None:
    class Door(orinkit.Device):
        provider_names = ("Test.Door",)

        def __init__(self) -> None:
            self._width = 1.5

        @variable("WIDTH")
        def width(self) -> float:
            return self._width

        @width.setter
        def set_width(self, width: float) -> None:
            self._width = width

        @variable("AREA")
        def area(self) -> float:
            return self.width * 2.0

    door = Door()
    assert (door.width, door.area) == (1.5, 3.0)
    door.width = 2.0
    assert (door.width, door.area) == (2.0, 4.0)
    with pytest.raises(AttributeError, match="AREA"):
        door.area = 1.0
    assert Door.width.name == "WIDTH"
    with (
        orinkit.serve(door, "tcp://127.0.0.1:0") as server,
        orinkit.connect(server.url, provider="Test.Door") as controller,
    ):
        assert sorted(controller.variable_names()) == ["AREA", "WIDTH"]
        controller.variable("WIDTH").value = 3.0
        assert controller.variable("AREA").value == 6.0
