"""Access to the pages: Host, Origin, token."""

from __future__ import annotations

import pytest

from orinkit.tester.access import AccessRules, read_cookies

LOCAL = AccessRules.for_host("127.0.0.1", ["cell.local"])
OPEN = AccessRules.for_host("0.0.0.0")


@pytest.mark.parametrize("host", ["127.0.0.1:8450", "localhost:8450", "[::1]:8450", "LOCALHOST", "cell.local:1"])
def test_accepted_hosts(host):
    assert LOCAL.refusal({"host": host}, "GET") == ""


@pytest.mark.parametrize(
    "host", ["", "evil.example", "evil.example:8450", "127.0.0.1.evil.example", "192.168.0.7:8450"]
)
def test_a_rebound_host_name_is_refused(host):
    assert "--allow-host" in LOCAL.refusal({"host": host}, "GET")


def test_an_open_address_accepts_numeric_hosts_and_requires_a_token():
    assert OPEN.refusal({"host": "192.168.0.7:8450"}, "GET") == ""
    assert OPEN.refusal({"host": "evil.example:8450"}, "GET")
    assert not OPEN.accepts_token("")
    assert not OPEN.accepts_token(OPEN.token[:-1])
    assert OPEN.accepts_token(OPEN.token)
    assert LOCAL.accepts_token("")


@pytest.mark.parametrize("method", ["GET", "POST", "WEBSOCKET"])
@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "null",
        "http://127.0.0.1:9999",
        "file://",
        "http://localhost:8450",
        "http://[::1",
        "http://[evil]:8450",
        "http://127.0.0.1:8450/",
        "http://127.0.0.1:8450 http://evil.example",
    ],
)
def test_other_origins_are_refused(method, origin):
    assert LOCAL.refusal({"host": "127.0.0.1:8450", "origin": origin}, method)


@pytest.mark.parametrize("method", ["GET", "POST", "WEBSOCKET"])
def test_the_own_origin_is_accepted(method):
    assert LOCAL.refusal({"host": "127.0.0.1:8450", "origin": "http://127.0.0.1:8450"}, method) == ""


@pytest.mark.parametrize(("method", "site", "refused"), [
    ("POST", "cross-site", True), ("WEBSOCKET", "same-site", True), ("POST", "same-origin", False), ("GET", "cross-site", False),
])  # fmt: skip
def test_requests_without_origin(method, site, refused):
    assert bool(LOCAL.refusal({"host": "127.0.0.1:8450", "sec-fetch-site": site}, method)) is refused


@pytest.mark.parametrize("other", ["Virtual RC8", '{"program": 1}', "\u00e4\u00f6", 'a"b', "", "="])
def test_a_cookie_of_any_form_does_not_hide_the_others(other):
    cookies = read_cookies(f"x={other}; flag; orinkit_user=abc_-1;other={other}; orinkit_dark=1")
    assert (cookies["orinkit_user"], cookies["orinkit_dark"]) == ("abc_-1", "1")
    assert read_cookies("") == {}


def test_the_value_of_a_cookie_is_decoded():
    assert read_cookies("orinkit_connection=%E4%BB%AE%E6%83%B3%20RC8%3B")["orinkit_connection"] == "仮想 RC8;"
