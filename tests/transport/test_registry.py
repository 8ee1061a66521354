"""The registry of transports, and an additional transport: one module and one row."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from importlib import metadata
from inspect import isclass, signature
from pathlib import Path

import pytest

import orinkit
from orinkit.cao.transport_profile import TransportProfile
from orinkit.core.errors import ConnectFailed, InvalidAddress, InvalidValue, StreamError
from orinkit.transport import links, registry
from orinkit.transport.address import parse_address
from orinkit.transport.registry import GROUP, LinkOptions, Transport, find, register, resolve, row_of, rows
from orinkit.values.poses import J
from orinkit.virtual.rc8 import VirtualRC8
from support.both import Both
from support.devices import Recorder
from support.distributions import environment, forgetting, install
from support.streams import HOME, served
from support.unix_transport import UNIX
from support.waiting import until

REFERENCES = [(row.scheme, reference) for row in rows() for reference in row.references]


@pytest.fixture
def unchanged() -> Iterator[None]:
    """Restore the registry after the test."""
    before = dict(registry._rows)
    yield
    registry._rows.clear()
    registry._rows.update(before)


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: None) -> Path:
    """Install a package that provides unix://."""
    directory = install(tmp_path / "site", "unix-for-orinkit", "unix = support.unix_transport:UNIX", group=GROUP)
    monkeypatch.syspath_prepend(str(directory))
    return directory


@pytest.fixture
def rc8() -> Iterator[VirtualRC8]:
    device = VirtualRC8(language="en")
    yield device
    device.close()


@pytest.fixture
def url(tmp_path: Path) -> str:
    return f"unix://{tmp_path}/socket"


# --- the rows of orinkit ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("scheme", "reference"), REFERENCES)
def test_every_reference_is_there(scheme: str, reference: str) -> None:
    if reference.startswith(("orinkit.server.serial_line", "orinkit.transport.serial")):
        pytest.importorskip("serialx")
    found = resolve(reference)
    assert callable(found) or isinstance(found, TransportProfile)
    assert not isclass(found)


@pytest.mark.parametrize("row", rows(), ids=lambda row: row.scheme)
def test_what_a_row_says_fits_together(row: Transport) -> None:
    address = parse_address(row.example)
    assert address.scheme == (row.alias or row.scheme)
    assert row_of(address).parse
    assert bool(row.link) == bool(row.aio_link) == bool(row.profile)
    for reference, count in ((row.link, 2), (row.aio_link, 2), (row.adopt, 1), (row.listener, 3 if row.http else 2)):
        if reference:
            assert len(signature(resolve(reference)).parameters) == count
    if row.profile:
        named = find(resolve(row.profile).name)
        assert named is not None
        assert named.profile == row.profile
        assert named.adopt == row.adopt
    elif not row.alias:
        assert isinstance(links.refused(address), InvalidAddress)
    if row.option is not None:
        assert row.listener
        assert not row.option.secure or find(row.option.secure) is not None


def test_messages_list_the_rows() -> None:
    with pytest.raises(InvalidAddress, match=r"'gopher'; available: tcp, udp, serial, com, http, https, pty, can"):
        parse_address("gopher://x")


def test_the_library_imports_no_transport_that_is_not_used() -> None:
    code = "import sys, orinkit, orinkit.transport.registry; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], env=environment(), capture_output=True, text=True, check=True)
    modules = done.stdout.split()
    assert not {"asyncio", "importlib.metadata", "httpx2", "serialx"} & set(modules)
    assert not [name for name in modules if name.startswith(("orinkit.transport.sockets", "orinkit.transport.serial."))]
    assert "orinkit.server.aio_server" not in modules


# --- a transport from elsewhere ---------------------------------------------------------------------------------------


def test_a_variable_over_a_transport_of_a_package(both: Both, rc8: VirtualRC8, installed: Path, url: str) -> None:
    assert not registry.known("unix")
    with orinkit.serve(rc8, url, "tcp://127.0.0.1:0") as server:
        assert server.urls[0] == url
        controller = both.connect(url)
        variable = both.run(controller.variable("@TYPE"))
        assert both.run(variable.value if both.loop is None else variable.get_value()) == "RC8 Controller"
        assert controller.client.profile.name == "unix"
        both.run(controller.close())
    assert registry.known("unix")


def test_a_transport_that_a_program_registers(both: Both, rc8: VirtualRC8, unchanged: None, url: str) -> None:
    register(UNIX)
    register(UNIX)
    with orinkit.serve(rc8, url) as server:
        both.run(both.connect(server.url).close())
    with pytest.raises(ConnectFailed, match=f"cannot connect to {url}"):
        both.connect(url)


def test_where_nobody_can_listen(unchanged: None, tmp_path: Path) -> None:
    register(UNIX)
    with pytest.raises(ConnectFailed, match=r"cannot listen on unix:///.*No such file or directory"):
        orinkit.serve(Recorder(), f"unix://{tmp_path}/there/is/none")


def test_the_streaming_process_adopts_its_links(unchanged: None, url: str) -> None:
    pytest.importorskip("ruckig")
    register(UNIX)
    with served(listen=url, joints=HOME) as arm:
        with orinkit.connect(url) as rc8:
            robot = rc8.robot()
            with robot.arm(), robot.slave_mode() as stream:
                stream.target = J(20, 45, 90, 0, 45, 0)
                until(lambda: stream.latest is not None and stream.latest.joints[0] == pytest.approx(20, abs=1e-3))
        assert arm.errors == []


def test_the_option_of_serve(installed: Path, url: str) -> None:
    """The transport is known, and its package is imported on first use."""
    command = [sys.executable, "-m", "orinkit", "serve", "rc8"]
    directories = environment(installed, Path(__file__).parents[1])
    helped = subprocess.run([*command, "--help"], env=directories, capture_output=True, text=True, check=True).stdout
    assert "--unix" in helped
    process = subprocess.Popen(
        [*command, "--unix", url.removeprefix("unix://"), "--no-providers"],
        env=directories, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    with process:
        assert process.stdout is not None
        assert process.stdout.readline() == f"ready {url}\n"
        with orinkit.connect(url) as rc8:
            assert rc8.variable("@TYPE").value == "RC8 Controller"
        process.terminate()
        assert process.wait() == 0
        assert process.stdout.read() == ""


def test_an_address_that_a_package_refuses(installed: Path) -> None:
    with pytest.raises(InvalidAddress, match=r"an absolute path is needed\. Example: unix:///run/controller"):
        parse_address("unix://socket")


# --- packages that are no good ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("entry", "source", "said"),
    [
        ("bad_transport:ROW", "1 / 0", "ZeroDivisionError"),
        ("bad_transport:ROW", "import there_is_none", "No module named 'there_is_none'"),
        ("bad_transport:ROW", "", "AttributeError"),
        ("bad_transport:ROW", "ROW = 1", "it is not a Transport with the scheme bad"),
        ("no_such_module:ROW", "", "No module named 'no_such_module'"),
    ],
)
def test_a_package_that_cannot_be_loaded_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unchanged: None, entry: str, source: str, said: str
) -> None:
    install(tmp_path, "bad-transport", f"bad = {entry}", group=GROUP, bad_transport=source)
    with forgetting(tmp_path), monkeypatch.context() as patch:
        patch.syspath_prepend(str(tmp_path))
        with pytest.raises(InvalidAddress, match="the transport bad of the package bad-transport") as caught:
            orinkit.connect("bad://x")
        assert said in str(caught.value)
        with pytest.raises(InvalidAddress, match=r"unknown transport 'gopher'; available: .* bad"):
            parse_address("gopher://x")
        assert parse_address("tcp://a").scheme == "tcp"


def test_entry_points_that_cannot_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(**_: object) -> None:
        raise ValueError("damaged")

    monkeypatch.setattr(metadata, "entry_points", fail)
    registry._entries.cache_clear()
    with pytest.raises(InvalidAddress, match="unknown transport 'gopher'"):
        parse_address("gopher://x")
    registry._entries.cache_clear()


def test_references_that_lead_nowhere(unchanged: None) -> None:
    register(UNIX._replace(scheme="one", link="there_is_none:link"))
    register(UNIX._replace(scheme="two", parse="orinkit.transport.address:there_is_none"))
    with pytest.raises(InvalidAddress, match=r"cannot import .*there_is_none:link, used by a transport"):
        resolve("there_is_none:link")
    with pytest.raises(InvalidAddress, match=r"address:there_is_none, used by a transport"):
        parse_address("two://x")


def test_rows_that_cannot_be_registered(unchanged: None) -> None:
    with pytest.raises(InvalidValue, match="the scheme tcp already has another transport"):
        register(UNIX._replace(scheme="tcp"))
    for scheme in ("Unix", "", "a b", "1"):
        with pytest.raises(InvalidValue, match="cannot be the scheme"):
            register(UNIX._replace(scheme=scheme))


def test_a_row_without_links(unchanged: None) -> None:
    register(UNIX._replace(profile="", link="", aio_link="", adopt="", listener=""))
    with pytest.raises(InvalidAddress, match="'unix:///x' cannot be used here"):
        orinkit.connect("unix:///x")
    with pytest.raises(InvalidAddress, match="'unix:///x' cannot be used here"):
        orinkit.serve(Recorder(), "unix:///x")
    for kind in ("unix", "there_is_none"):
        with pytest.raises(StreamError, match=f"not available over {kind}://. Try: tcp://, udp://, serial://"):
            links.require_handover(kind)


def test_an_address_of_no_registry() -> None:
    class Elsewhere:
        scheme = "gopher"

    with pytest.raises(InvalidAddress, match="unknown transport 'gopher'"):
        links.open_link(Elsewhere(), LinkOptions(1.0))
