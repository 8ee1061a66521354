"""Common features of all commands: help, version, exit codes, both languages, and a fast start of help."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import socket
import subprocess
import sys

import pytest

import orinkit
from orinkit.cli._shared.help import wrapped
from orinkit.cli.app import build
from orinkit.core import i18n

COMMANDS = (
    "demo",
    "serve",
    "tester",
    "get",
    "put",
    "call",
    "info",
    "shell",
    "decode",
    "dissector",
    "raw",
    "functions",
    "pendant",
    "move",
    "stream",
    "plot",
    "gateway",
    "abh3",
)

NO = {
    "--no-browser",
    "--no-samples",
    "--no-motor",
    "--no-slave-licence",
    "--no-providers",
    "--no-reset",
}  # the only negative flags


def japanese(program: list[str], *argv: str) -> str:
    done = subprocess.run(
        [*program, *argv], env={**os.environ, "ORINKIT_LANG": "ja"}, capture_output=True, encoding="utf-8", check=False
    )
    return done.stdout + done.stderr


@pytest.mark.parametrize("argv", [[], ["--help"], ["-h"]])
def test_help_names_every_command(run, argv):
    done = run(*argv)
    assert done.code == 0
    for command in COMMANDS:
        assert f"│ {command} " in done.out


@pytest.mark.parametrize(
    "command",
    [*COMMANDS, "serve rc8", "serve device", "serve abh3", "abh3 monitor", "abh3 decode", "abh3 dbc", "abh3 drive"],
)
def test_every_command_has_help(run, command):
    done = run(*command.split(), "--help")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith(f"Usage: orinkit {command}")
    assert set(re.findall(r"--no-[a-z-]+", done.out)) <= NO


@pytest.mark.parametrize("lang", ["en", "ja"])
def test_help_of_abh3(run, monkeypatch, lang):
    i18n.use(lang)
    monkeypatch.setenv("COLUMNS", "80")
    usage = {"en": "Usage", "ja": "使い方"}[lang]
    drive = run("abh3", "drive", "--help").out
    assert drive.startswith(f"{usage}: orinkit abh3 drive [URL] --seconds S [--ay N] [--bx N] [OPTIONS]\n")
    for command in ("abh3 drive", "abh3 monitor", "serve abh3"):
        page = run(*command.split(), "--help").out
        for example in ("can://socketcan/can0", "can://slcan//dev/ttyACM0?bitrate=500000", "can://udp_multicast/239"):
            assert example in page  # on one line
    assert "127.0.0.1:5007" not in run("serve", "abh3", "--help").out  # there is no default listener
    assert "127.0.0.1:5007" in run("serve", "rc8", "--help").out


def test_help_of_abh3_describes_its_commands(run):
    page = run("abh3", "--help").out
    for word in ("monitor", "decode", "run", "DBC"):
        assert word in page.split("Commands")[0]


def test_version(run):
    assert run("--version").out == f"{orinkit.__version__}\n"


def test_help_in_japanese(program):
    assert "使い方: orinkit COMMAND" in japanese(program, "--help")
    page = japanese(program, "put", "--help")
    assert "コントローラの変数に書き込む。" in page
    assert "[必須]" in page
    assert "[既定値: 5]" in page
    assert "required" not in page


def test_the_labels_of_the_help_page_in_japanese(run):
    i18n.use("ja")
    done = run("put", "--help")
    assert done.out.startswith("使い方: orinkit put [OPTIONS] URL NAME VALUE...\n")
    assert "[既定値: CaoProv.DENSO.VRC]" in done.out
    assert "[必須]" in done.out
    assert "required" not in done.out + run("get", "--help").out


def test_every_help_text_changes_with_the_language():
    def texts() -> set[str]:
        app = build()
        return {app.help, *(app[command].help for command in COMMANDS), app["serve"]["rc8"].help, app["--help"].help}

    english = texts()
    i18n.use("ja")
    assert not english & texts()


PAGES = [
    *COMMANDS, "serve rc8", "serve ve026a", "serve abh3", "serve device", "abh3 monitor", "abh3 decode", "abh3 dbc", "abh3 drive",
]  # fmt: skip


@pytest.fixture(scope="module")
def pages() -> dict[str, dict[str, str]]:
    """The help pages by language and command; a process shows those of its language."""
    script = """
from contextlib import redirect_stdout
from io import StringIO
from orinkit.cli.app import main
import json, sys
pages = {}
for command in sys.argv[1:]:
    with redirect_stdout(StringIO()) as out:
        main([*command.split(), "--help"])
    pages[command] = out.getvalue()
print(json.dumps(pages))
"""
    return {
        language: json.loads(
            subprocess.run(
                [sys.executable, "-c", script, *PAGES], capture_output=True, encoding="utf-8", check=True,
                env={**os.environ, "ORINKIT_LANG": language, "COLUMNS": "100", "PYTHONUNBUFFERED": ""},
            ).stdout
        )  # without a buffer, a signal can cut long output (CPython)
        for language in ("en", "ja")
    }  # fmt: skip


@pytest.mark.parametrize("language", ["en", "ja"])
@pytest.mark.parametrize("command", PAGES)
def test_the_usage_names_the_arguments_as_the_page_does(pages, command, language):
    usage, _, page = pages[language][command].partition("\n")
    arguments = set(re.findall(r"(?<!-)\b[A-Z]+\b", usage)) - {"S", "N"}  # --seconds S, --ay N
    assert arguments <= set(re.findall(r"\b[A-Z]+\b", page)) | {"COMMAND", "OPTIONS"}
    assert not re.search(r"--\w+ \[OPTIONS\]", usage)  # an option without its value


@pytest.mark.parametrize("command", PAGES)
def test_the_sections_of_a_page_have_the_same_order_in_both_languages(pages, command):
    english, japanese = (re.findall(r"^╭─ (.+?) ─", pages[each][command], re.MULTILINE) for each in ("en", "ja"))
    assert japanese == [i18n.translate("ja", title) for title in english]


@pytest.mark.parametrize(
    ("text", "lines"),
    [
        ("あいうえおかきく", ["あいうえお", "かきく"]),
        ("あいうえお、かきく", ["あいうえ", "お、かきく"]),  # no punctuation mark at the beginning of a line
        ("あいうえ「おかき」く", ["あいうえ", "「おかき」", "く"]),
        ("あい robot うえお", ["あい robot", "うえお"]),
        ("あいうrobot えお", ["あいう", "robot えお"]),  # a word is not divided
        ("あいうえ (おかき)、く", ["あいうえ", "(おかき)、", "く"]),
        ("あいう [値: x]", ["あいう", "[値: x]"]),  # neither is a note
        ("あいう\nえ", ["あいう", "え"]),
        ("", [""]),
    ],
)
def test_the_lines_of_japanese_text(text, lines):
    assert wrapped(text, 10) == lines


def test_lines_of_a_japanese_page_are_full(pages):
    """Rich alone breaks lines at spaces only, which leaves most of them half empty."""
    page = pages["ja"]["serve rc8"]
    assert "--control-secret-file  --control のシークレットのファイル。なければ新しいシークレットで生成し、" in page
    assert "[選択肢: rc8, ve026a]" in pages["ja"]["demo"]


def test_help_does_not_load_modules_of_commands(program):
    script = (
        "import sys; from orinkit.cli.app import main; main(['--help']);"
        "print(sorted({'asyncio', 'numpy', 'sqlite3', 'markdown_it', 'orinkit.virtual', 'orinkit.cli.commands.get'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (
            ["frob"],
            "unknown command frob; did you mean demo, serve, get, put, call, info, decode, dissector, functions, pendant, move, stream, plot, gateway, raw, shell, tester, abh3? (see orinkit --help)",
        ),
        (
            ["serve", "frob"],
            "unknown command frob; did you mean rc8, ve026a, abh3, device? (see orinkit serve --help)",
        ),
        (["get"], "URL is missing (see orinkit get --help)"),
        (["get", "a"], "NAME is missing (see orinkit get --help)"),
        (["get", "a", "b", "c"], "too many arguments: c (see orinkit get --help)"),
        (["get", "a", "b", "--zip"], "unknown option --zip (see orinkit get --help)"),
        (
            ["get", "a", "b", "--timout", "3"],
            "unknown option --timout; did you mean --timeout? (see orinkit get --help)",
        ),
        (
            ["serve", "rc8", "--controller", "rc7"],
            "'rc7' is not a valid value for --controller. Try: one of rc8, rc8a, rc9, cobotta (see orinkit serve rc8 --help)",
        ),
        (["get", "a", "b", "--timeout", "x"], "'x' is not a valid value for --timeout (see orinkit get --help)"),
        (["get", "a", "b", "--timeout"], "--timeout is missing (see orinkit get --help)"),
        (["get", "a", "b", "--timeout", "3", "--timeout", "4"], "--timeout is given twice (see orinkit get --help)"),
    ],
)
def test_a_wrong_command_line_is_reported_in_one_line(refused, argv, message):
    assert refused(*argv, code=2) == message


@pytest.mark.parametrize(
    ("argv", "message"),
    [
        (["frob"], "コマンド frob はありません"),
        (["get"], "URL が指定されていません"),
        (["get", "a", "b", "c"], "余分な引数があります: c"),
        (["get", "a", "b", "--zip"], "オプション --zip はありません"),
        (["get", "a", "b", "--timeout", "x"], "--timeout の値 'x' が不正です"),
        (["get", "a", "b", "--timeout", "3", "--timeout", "4"], "--timeout が二重に指定されています"),
    ],
)
def test_a_wrong_command_line_in_japanese(refused, argv, message):
    i18n.use("ja")
    assert refused(*argv, code=2).startswith(message)


def test_an_unexpected_exception_is_one_line_too(refused, run, monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    assert refused("decode", "-").startswith("unexpected AttributeError: ")
    monkeypatch.setenv("ORINKIT_TRACEBACK", "1")
    with pytest.raises(AttributeError):
        run("decode", "-")


def test_interrupted(program):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        process = subprocess.Popen(
            [*program, "get", f"127.0.0.1:{port}", "I1", "--timeout", "100"],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, "ORINKIT_LANG": "en"}, text=True,
        )  # fmt: skip
        peer, _ = silent.accept()
        assert peer.recv(1)  # it has sent a request and waits for the reply
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
        peer.close()
    assert (process.returncode, out, err) == (130, "", "orinkit: interrupted\n")


@pytest.mark.parametrize("module", ["orinkit.cli.app", "cyclopts", "orinkit.cli.commands.functions"])
def test_interrupted_during_start(module):
    """Ctrl-C while modules are imported."""
    script = f"""
import sys
import orinkit.__main__
class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            raise KeyboardInterrupt
sys.meta_path.insert(0, Interrupting())
sys.argv = ["orinkit", "functions"]
sys.exit(orinkit.__main__.main())
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, encoding="utf-8", check=False,
        env={**os.environ, "ORINKIT_LANG": "en"},
    )  # fmt: skip
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "orinkit: interrupted\n")


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="/dev/full requires Linux")  # noqa: PTH110 - a device, not a file
@pytest.mark.parametrize("argv", [["functions"], ["abh3", "dbc"], ["functions", "1", "--json"]])
def test_a_full_disk_is_one_line(program, argv):
    with open("/dev/full", "w") as full:  # noqa: PTH123 - a device, not a file
        done = subprocess.run(
            [*program, *argv], stdout=full, stderr=subprocess.PIPE, encoding="utf-8", check=False,
            env={**os.environ, "ORINKIT_LANG": "en"},
        )  # fmt: skip
    assert (done.returncode, done.stderr) == (1, "orinkit: reading or writing failed: No space left on device\n")


def test_closed_stderr(program):
    """Errors are not written to stdout."""
    line = shlex.join([*program, "get", "a", "b", "--zip"])
    done = subprocess.run(["sh", "-c", f"{line} 2>&-"], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (2, b"", b"")


def test_a_reader_that_closes_the_pipe(program):
    process = subprocess.Popen([*program, "functions"], stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 1
    assert process.stderr is not None
    assert process.stderr.read() == b""
    process.stderr.close()


def test_a_terminal_without_japanese_gets_escapes(program):
    done = subprocess.run(
        [*program, "functions", "1"], capture_output=True, check=True,
        env={**os.environ, "ORINKIT_LANG": "ja", "PYTHONIOENCODING": "ascii"},
    )  # fmt: skip
    assert b"\\u4ed5\\u69d8\\u66f8" in done.stdout
