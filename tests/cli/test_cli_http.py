"""Command line options of e-CAP and gateways: tokens, certificates, schemes, machine names, ports."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

import pytest

import orinkit
from orinkit.cli._shared.http import HttpServerOptions
from orinkit.cli._shared.serving import ServerListenAddresses, ServerOptions, _urls, _warnings
from orinkit.core import i18n
from orinkit.core.errors import ConnectFailed, InvalidAddress, InvalidValue, ProtocolError
from orinkit.gateway import RemoteProvider
from orinkit.server.http.options import HttpOptions
from orinkit.transport.address import HttpAddress
from orinkit.transport.credentials import Credentials
from orinkit.transport.http.response import HttpServerInfo, no_certificates, tls_failed
from orinkit.virtual.rc8 import VirtualRC8
from support.http_peers import CERTIFICATE, KEY

ADDRESS = HttpAddress("http", "127.0.0.1", 8080)


# --- machine names ----------------------------------------------------------------------------------------------------


def test_a_controller_behind_a_gateway_is_selected(run, refused, url):
    other = VirtualRC8(language="en")
    with (
        orinkit.serve(other, "tcp://127.0.0.1:0") as second,
        orinkit.serve(RemoteProvider({"left": url, "right": second.url}), "tcp://127.0.0.1:0") as both,
    ):
        assert run("put", both.url, "I1", "7", "--machine", "left").code == 0
        assert run("get", both.url, "I1", "--machine", "left").out == "7\n"
        assert run("get", both.url, "I1", "--machine", "right").out == "0\n"
        assert run("call", both.url, "Controller_Connect", "--machine", "right").code == 0
        assert "E_INVALIDARG" in refused("get", both.url, "I1")
    other.close()


# --- options without effect -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "named"),
    [
        (["--token-file", str(CERTIFICATE)], "--token-file: requires --http"),
        (["--cert", str(CERTIFICATE), "--key", str(KEY)], "--cert: requires --http"),
        (["--http-host", "cell7", "--http-idle", "5"], "--http-host, --http-idle: requires --http"),
        (["--key", str(KEY)], "--key requires --cert"),
    ],
)
def test_options_of_http_without_http(refused, options, named):
    assert named in refused("serve", "rc8", "--tcp", "127.0.0.1:0", *options, code=2)
    assert named in refused("gateway", "--upstream", "tcp://192.0.2.1", *options, code=2)


def test_a_token_file_that_others_can_read(tmp_path):
    file = tmp_path / "token"
    file.write_text("0123456789abcdef")
    listening = ServerOptions(ServerListenAddresses(http=("8080",)), HttpServerOptions(token_file=str(file)))
    for mode in (0o600, 0o400):
        file.chmod(mode)
        assert list(_warnings(listening)) == []
    for mode in (0o644, 0o640, 0o602):
        file.chmod(mode)
        (warning,) = _warnings(listening)
        text = f"--token-file {file}: other accounts can access the file (mode {mode:o}). Try: chmod 600 {file}"
        assert warning == f"orinkit: warning: {text}"
    i18n.use("ja")
    (warning,) = _warnings(listening)
    assert "他のアカウントがアクセスできるファイルです (モード 602)" in warning


def test_a_private_key_that_others_can_read(tmp_path):
    key, cert, both = (tmp_path / name for name in ("key.pem", "cert.pem", "both.pem"))
    key.write_bytes(KEY.read_bytes())
    cert.write_bytes(CERTIFICATE.read_bytes())
    both.write_bytes(CERTIFICATE.read_bytes() + KEY.read_bytes())

    def warnings(**files: str) -> list[str]:
        return list(_warnings(ServerOptions(ServerListenAddresses(http=("8080",)), HttpServerOptions(**files))))

    for file in (key, cert, both):
        file.chmod(0o644)
    (warning,) = warnings(cert=str(cert), key=str(key))  # anyone may read the certificate
    assert warning.startswith(f"orinkit: warning: --key {key}: other accounts can access the file (mode 644)")
    (warning,) = warnings(cert=str(both))
    assert warning.startswith(f"orinkit: warning: --cert {both}: other accounts can access the file (mode 644)")
    for file in (key, both):
        file.chmod(0o600)
    assert warnings(cert=str(cert), key=str(key)) == warnings(cert=str(both)) == []


def test_clients_warn_about_a_token_file_that_others_can_read(run, refused, rc8, url, tmp_path):
    file = tmp_path / "token"
    file.write_text("0123456789abcdef")
    with orinkit.serve(rc8, "http://127.0.0.1:0", http=HttpOptions(token=file.read_text())) as server:
        file.chmod(0o600)
        assert run("get", server.url, "I1", "--token-file", str(file)).err == ""
        file.chmod(0o644)
        done = run("get", server.url, "I1", "--token-file", str(file))
    assert (done.code, done.out) == (0, "0\n")
    assert done.err.startswith(f"orinkit: warning: --token-file {file}: other accounts can access the file (mode 644)")
    done = run("gateway", "--upstream", url, "--tcp", "192.0.2.1:1", "--upstream-token-file", str(file))
    assert f"orinkit: warning: --upstream-token-file {file}: other accounts" in done.err
    file.write_text("")
    message = refused("gateway", "--upstream", url, "--upstream-token-file", str(file), code=2)
    assert message == f"--upstream-token-file {file}: the file does not contain a token"


def test_a_token_does_not_protect_b_cap():
    http = HttpServerOptions(token_file="token.txt")
    assert list(_warnings(ServerOptions(ServerListenAddresses(http=("8080",)), http))) == []
    (warning,) = _warnings(ServerOptions(ServerListenAddresses(http=("8080",), tcp=("5007",), pty=True), http))
    assert warning.startswith("orinkit: warning: --token-file protects --http only")
    assert "--tcp, --pty" in warning
    i18n.use("ja")
    (warning,) = _warnings(ServerOptions(ServerListenAddresses(http=("8080",), udp=("5007",)), http))
    assert "--udp のアドレスに接続できるクライアント" in warning


# --- addresses --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("listening", "urls"),
    [
        (
            ServerOptions(ServerListenAddresses(tcp=("5008",), udp=("5009",))),
            ["tcp://127.0.0.1:5008", "udp://127.0.0.1:5009"],
        ),
        (
            ServerOptions(ServerListenAddresses(http=("8080", "192.0.2.1"))),
            ["http://127.0.0.1:8080", "http://192.0.2.1"],
        ),
        (ServerOptions(ServerListenAddresses(http=("0",)), HttpServerOptions(cert="c.pem")), ["https://127.0.0.1:0"]),
    ],
)
def test_a_port_alone_means_the_loopback_address(listening, urls):
    assert _urls(listening) == urls


@pytest.mark.parametrize("port", ["65536", "99999999999"])
def test_a_port_out_of_range(port):
    with pytest.raises(InvalidAddress, match="is not 0 to 65535"):
        _urls(ServerOptions(ServerListenAddresses(tcp=(port,))))


def test_a_client_requires_a_host(refused):
    assert "Example: tcp://127.0.0.1:5007" in refused("get", "5007", "I1", code=2)


# --- certificates -----------------------------------------------------------------------------------------------------


def other_key(folder: Path) -> Path:
    """Return a key that does not match the certificate: on P-256, with the secret 1 (RFC 5915)."""
    curve = bytes.fromhex("a00a06082a8648ce3d030107")
    der = bytes.fromhex("3031020101") + b"\x04\x20" + (1).to_bytes(32, "big") + curve
    path = folder / "other.pem"
    path.write_text(f"-----BEGIN EC PRIVATE KEY-----\n{b64encode(der).decode()}\n-----END EC PRIVATE KEY-----\n")
    return path


def test_certificates_that_cannot_be_used(rc8, tmp_path):
    for options, message in (
        (HttpOptions(), "https requires a certificate"),
        (HttpOptions(cert=str(CERTIFICATE)), "contains no private key"),
        (HttpOptions(cert=str(KEY), key=str(CERTIFICATE)), "they may be swapped"),
        (HttpOptions(cert=str(KEY)), "contains no certificate"),
        (
            HttpOptions(cert=str(CERTIFICATE), key=str(other_key(tmp_path))),
            "other.pem does not match the certificate in",
        ),
        (HttpOptions(cert=str(tmp_path / "none.pem"), key=str(KEY)), "No such file"),
    ):
        with pytest.raises(ConnectFailed, match=message) as caught:
            orinkit.serve(rc8, "https://127.0.0.1:0", http=options)
        assert "port 0" not in str(caught.value)
        assert "--key" in str(caught.value)


def test_http_to_a_server_with_tls(rc8, refused):
    options = HttpOptions(cert=str(CERTIFICATE), key=str(KEY))
    with orinkit.serve(rc8, "https://127.0.0.1:0", http=options) as server:
        plain = server.url.replace("https:", "http:")
        message = refused("get", plain, "I1")
    assert (
        message
        == f"{plain}: the server closed the connection without a reply. Try: {server.url}, if the server uses TLS"
    )


def test_a_token_with_the_line_feed_of_its_file():
    with pytest.raises(InvalidValue, match=r"no line feed at the end\. Try: Path\(\.\.\.\)\.read_text\(\)\.strip\(\)"):
        HttpOptions(token="0123456789abcdef\n")


def test_a_certificate_without_its_key(refused):
    message = refused("serve", "rc8", "--http", "0", "--cert", str(CERTIFICATE))
    assert message.startswith(f"cannot listen on https://127.0.0.1:0: {CERTIFICATE} contains no private key")
    assert "another port" not in message


# --- hints ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["en", "ja"])
def test_hints_name_the_options_too(name):
    i18n.use(name)
    refusal = HttpServerInfo(ADDRESS, Credentials(), 1000).refusal(401, [], b"", 10)
    assert "token= (--token-file)" in str(refusal)
    with_token = HttpServerInfo(ADDRESS, Credentials("0123456789abcdef"), 1000)
    wrong = with_token.refusal(401, [], b"a token is required (Authorization: Bearer ...)", 10)
    assert "a token is required" not in str(wrong)  # that applies to clients without a token
    assert "token= (--token-file)" in str(wrong)
    assert "cafile= (--cafile)" in str(tls_failed(ADDRESS, OSError("x")))
    assert "--cafile" in str(no_certificates("x.pem", OSError("x")))


def test_tls_on_an_http_port():
    contact = HttpServerInfo(ADDRESS, Credentials(), 1000)
    for begin in (b"", b"H", b"HTTP/"):
        contact.check_begin(begin)
    with pytest.raises(ProtocolError, match=r"Try: https://127\.0\.0\.1:8080"):
        contact.check_begin(b"\x15\x03\x01\x00\x02")
    with pytest.raises(ProtocolError, match="not HTTP"):
        contact.check_begin(b"\x01\x15\x00\x00\x00")


@pytest.mark.parametrize(
    ("argv", "hinted"),
    [
        (["Controller_Execute", "X", "1", "2"], True),
        (["Controller_GetName", "1"], False),
        (["Task_Start"], False),
        (["Controller_GetVariable", "I1", "", "x"], False),
    ],
)
def test_hint_for_several_values_of_one_argument(refused, argv, hinted):
    message = refused("call", "tcp://192.0.2.1", *argv, code=2)
    assert ('8197,10,50 or "8204,(5,1),(11,1)"' in message) is hinted


# --- help -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "default"), [("en", "[default: all names]"), ("ja", "[既定値: すべて]")])
def test_the_help_of_the_gateway(run, name, default):
    i18n.use(name)
    page = " ".join(run("gateway", "--help").out.replace("│", " ").split())
    assert default in page
    assert "'*'" not in page
    assert "443" in page
