"""Texts from controllers cannot send control sequences to the terminal; pipes and --json are exact."""

from __future__ import annotations

import json
import os
import sys
import threading
import tty
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import orinkit
from orinkit.cao.provider import ClientInfo, ControllerObject, Provider, RobotObject, VariableObject
from orinkit.cli._shared.terminal import Screen, bold
from orinkit.cli.app import main
from orinkit.core.errors import error_for
from orinkit.core.hresult import E_FAIL
from orinkit.core.i18n import visible
from orinkit.values.variant import Variant

EVIL = (
    "\x1b]0;owned\x07\x1b[2J\x1b[1m\x9b31m\x08\x0b\x0c\r\x7f\x85\u061c\u200b\u200e\u202e\u2028\u2029\u2066\ufeff\U000e0041"
    "\N{IDEOGRAPHIC SPACE}日本語é\ttab\nforged: line"
)
SAFE = "\N{IDEOGRAPHIC SPACE}日本語é\ttab"
"""The part of EVIL that is shown unchanged."""
STEERING = set(EVIL) - set(SAFE) - set("\nforged: line]0;owned[2J1m31m")
"""Characters that must not reach a terminal."""


class EvilVariable(VariableObject):
    def get_value(self) -> Any:
        if self.name.startswith("@VAR"):
            return 10
        return {"ARRAY": [EVIL, "next"], "@CURRENT_TIME": EVIL}.get(self.name, EVIL)

    def put_value(self, value: Variant) -> None:
        if self.name == "BAD":
            raise error_for(E_FAIL, EVIL)


class EvilRobot(RobotObject):
    def execute(self, command: str, parameter: Variant) -> Any:
        raise error_for(E_FAIL, EVIL)


class EvilController(ControllerObject):
    def get_variable(self, name: str, option: str) -> Any:
        return EvilVariable(name)

    def get_robot(self, name: str, option: str) -> Any:
        return EvilRobot(name)

    def get_robot_names(self, option: str) -> Any:
        return [EVIL, "second"]

    def get_variable_names(self, option: str) -> Any:
        return [EVIL] * 3

    def execute(self, command: str, parameter: Variant) -> Any:
        if command == "GetCurErrorCount":
            return 1
        if command == "GetCurErrorInfo":
            return [E_FAIL - 2**32, EVIL]
        if command == "Status":
            return json.dumps({"mode": EVIL, EVIL: [EVIL]})
        if command == "GetErrorDescription":
            return EVIL
        raise error_for(E_FAIL, EVIL)


class Evil(Provider):
    provider_names = ("CaoProv.DENSO.VRC", "CaoProv.orinkit.Pendant", "Evil")

    def connect(self, name: str, machine: str, option: str, client: ClientInfo) -> Any:
        return EvilController("evil")


@pytest.fixture(scope="module", params=["tcp", "http"])
def evil(request: pytest.FixtureRequest) -> Iterator[str]:
    with orinkit.serve(Evil(), f"{request.param}://127.0.0.1:0") as server:
        yield server.url


Terminal = Callable[..., str]


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Terminal:
    """Run a command line with stdout and stderr on a terminal, and return the output."""

    def run(*argv: str) -> str:
        far, near = os.openpty()
        tty.setraw(near)
        came: list[bytes] = []

        def read() -> None:
            try:
                while data := os.read(far, 65536):
                    came.append(data)
            except OSError:  # end of file of a pseudo-terminal
                pass

        reader = threading.Thread(target=read)
        reader.start()
        with open(near, "w", encoding="utf-8", buffering=1) as stream, monkeypatch.context() as at:  # noqa: PTH123 - a device, not a file
            at.setattr(sys, "stdout", stream)
            at.setattr(sys, "stderr", stream)
            main(argv)
            assert (sys.stdout, sys.stderr) == (stream, stream)
        reader.join()
        os.close(far)
        return b"".join(came).decode()

    return run


def check(shown: str) -> None:
    assert not STEERING & set(shown)
    assert not any(line.startswith("forged") for line in shown.split("\n"))


COMMANDS = {
    "info": ["info", "URL"],
    "an array": ["get", "URL", "ARRAY"],
    "a failure": ["put", "URL", "BAD", "1"],
    "echo": ["put", "URL", "S1", EVIL],
    "call fails": ["call", "URL", "Controller_Execute", "What"],
    "no command": ["call", "URL", EVIL],
    "status": ["pendant", "URL", "status"],
    "trace": ["info", "URL", "--trace"],
    "trace of a failure": ["put", "URL", "BAD", "1", "--trace"],
    "no address": ["get", EVIL, "S1"],
    "no file": ["plot", EVIL],
    "usage": ["get", "--" + EVIL],
    "decode": ["decode", EVIL],
}


@pytest.mark.parametrize("name", COMMANDS)
def test_no_control_characters_reach_the_terminal(terminal: Terminal, evil: str, name: str) -> None:
    shown = terminal(*(evil if word == "URL" else word for word in COMMANDS[name]))
    check(shown)
    assert shown


@pytest.mark.parametrize("name", ["info", "status", "an array", "echo"])
def test_readable_text_is_unchanged(terminal: Terminal, evil: str, name: str) -> None:
    assert SAFE in terminal(*(evil if word == "URL" else word for word in COMMANDS[name]))


def test_line_breaks_of_a_value_are_kept(terminal: Terminal, evil: str) -> None:
    for command in (["get", evil, "S1"], ["call", evil, "Variable_GetValue", "--variable", "S1"]):
        shown = terminal(*command)
        assert shown == visible(EVIL, "\n\t") + "\n"
        assert not STEERING & set(shown)
        assert shown.endswith(f"{SAFE}\nforged: line\n")


@pytest.mark.parametrize("command", ["get", "info", "status"])
def test_json_on_a_terminal_is_equivalent(terminal: Terminal, run: Any, evil: str, command: str) -> None:
    argv = {"get": ["get", evil, "S1"], "info": ["info", evil], "status": ["pendant", evil, "status"]}[command]
    shown = terminal(*argv, "--json")
    assert not STEERING & set(shown)
    assert json.loads(shown) == run(*argv, "--json").json


def test_pipes_are_exact(run: Any, evil: str) -> None:
    assert run("get", evil, "S1").out == f"{EVIL}\n"
    assert run("get", evil, "ARRAY").out == f"{EVIL}\nnext\n"
    assert EVIL in run("get", evil, "S1", "--json").json["value"]
    assert EVIL.partition("\n")[0] in run("info", evil).out


def test_control_sequences_of_orinkit_reach_the_terminal(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NO_COLOR", raising=False)
    assert terminal("functions", "1").startswith("\x1b[1m")
    assert bold("x") == "x"  # not at a terminal
    monkeypatch.setenv("NO_COLOR", "1")
    assert "\x1b" not in terminal("functions", "1")


def test_the_progress_bar_is_drawn_and_robot_texts_are_escaped(terminal: Terminal, evil: str) -> None:
    shown = terminal("move", evil, "J(0,0,0,0,0,0)")
    assert not STEERING - {"\x1b", "\r"} & set(shown)
    assert "\x1b]" not in shown
    assert "\x1b[2J" not in shown


def test_help_is_shown_on_a_terminal(terminal: Terminal) -> None:
    assert "orinkit" in terminal("--help")


def test_a_screen_is_a_stream(tmp_path: Any) -> None:
    with (tmp_path / "terminal").open("w", encoding="utf-8") as file:
        screen = Screen(file)
        print("\x07", file=screen, flush=True)
        assert (screen.encoding, screen.errors, screen.isatty(), screen.writable()) == ("utf-8", "strict", True, True)
        assert screen.fileno() == file.fileno()
    assert (tmp_path / "terminal").read_text(encoding="utf-8") == "\\x07\n"
