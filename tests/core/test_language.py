"""The language of texts: initially from the environment, changed with ``use``."""

from __future__ import annotations

import errno
import os
import pickle
import subprocess
import sys
from collections.abc import Callable, Iterator

import pytest

from orinkit.core import i18n
from orinkit.transport.link_errors import connect_failed, lost

pytestmark = pytest.mark.core

NAMES = ("ORINKIT_LANG", "LC_ALL", "LC_MESSAGES", "LANG")


def at_start(**environment: str) -> str:
    clean = {name: value for name, value in os.environ.items() if name not in NAMES}
    program = "from orinkit.core import i18n; print(i18n.current())"
    done = subprocess.run(
        [sys.executable, "-c", program], env={**clean, **environment}, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


def test_a_new_process_takes_the_language_of_its_environment():
    assert at_start(LANG="ja_JP.UTF-8") == "ja"
    assert at_start() == "en"


@pytest.mark.parametrize(
    ("environment", "expected"),
    [
        ({}, "en"),
        ({"LANG": "ja_JP.UTF-8"}, "ja"),
        ({"LANG": "JA"}, "ja"),
        ({"LANG": "en_US.UTF-8"}, "en"),
        ({"LANG": "C"}, "en"),
        ({"LANG": "de_DE.UTF-8"}, "en"),
        ({"LANG": "en_US.UTF-8", "LC_MESSAGES": "ja_JP.UTF-8"}, "ja"),
        ({"LC_MESSAGES": "ja_JP.UTF-8", "LC_ALL": "C.UTF-8"}, "en"),
        ({"LC_ALL": "en_GB.UTF-8", "ORINKIT_LANG": "ja"}, "ja"),
        ({"ORINKIT_LANG": "", "LANG": "ja_JP"}, "ja"),
    ],
)
def test_the_first_variable_that_is_set_decides(monkeypatch, environment, expected):
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    assert i18n._from_environment() == expected


def test_use_changes_all_further_texts():
    i18n.use("ja")
    assert (i18n.current(), i18n.choose("cat", "猫"), i18n.tr("a serial port")) == ("ja", "猫", "シリアルポート")
    i18n.use("en")
    assert (i18n.current(), i18n.choose("cat", "猫"), i18n.tr("a serial port")) == ("en", "cat", "a serial port")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("", ""),
        ("Robot_Move, 日本語 'x' \\n", "Robot_Move, 日本語 'x' \\n"),
        ("a\nb\t\x1b[2J\x7f", r"a\nb\t\x1b[2J\x7f"),
        ("\0\u202e\ud800é", r"\x00\u202e\ud800é"),
        ("\u2028\u061c\ufeff", r"\u2028\u061c\ufeff"),
    ],
)
def test_external_text_is_made_printable(text, shown):
    assert i18n.printable(text) == shown
    assert shown.isprintable()


def test_spaces_and_joiners_of_other_languages_are_kept():
    assert i18n.visible("日本語\u3000\u00a0\u200d\x1b") == "日本語\u3000\u00a0\u200d\\x1b"
    assert i18n.visible("a\tb\nc\r", "\t\n") == "a\tb\nc\\r"


def test_another_language_is_refused_and_changes_nothing():
    with pytest.raises(ValueError, match="not 'fr'"):
        i18n.use("fr")
    assert i18n.current() == "en"


def test_a_context_may_have_its_own_language():
    """Without a language of the context, the one of ``use`` applies."""
    languages = iter(["ja", None])
    i18n.set_source(lambda: next(languages))
    try:
        assert i18n.tr("a serial port") == "シリアルポート"
        assert i18n.current() == "en"
    finally:
        i18n.set_source(None)
    assert i18n.current() == "en"


@pytest.fixture
def shown_in() -> Iterator[Callable[[i18n.Language, object], str]]:
    """A function that displays something in a context with a language of its own; the language of the process is English."""
    language: i18n.Language | None = None

    def show(wanted: i18n.Language, what: object) -> str:
        nonlocal language
        language = wanted
        shown = f"{what}"
        language = None
        return shown

    i18n.set_source(lambda: language)
    yield show
    i18n.set_source(None)


def test_an_error_is_shown_in_the_language_of_each_context(shown_in):
    error = connect_failed("tcp://h:1", OSError(errno.ECONNREFUSED, "x"))  # created in the language of the process
    assert shown_in("en", error).startswith("cannot connect to tcp://h:1: no program listens at this address. Try: ")
    assert shown_in("ja", error).startswith("tcp://h:1 に接続できません")
    assert "このアドレスで待ち受けているプログラムがありません" in shown_in("ja", error)
    lost_again = lost(error)
    assert shown_in("ja", lost_again).endswith(shown_in("ja", error))
    assert "cannot" not in shown_in("ja", lost_again)


def test_a_shared_text_is_a_string_in_the_language_in_which_it_was_created(shown_in):
    text = i18n.tr("a serial port")
    assert shown_in("ja", text) == "シリアルポート"
    assert text == "a serial port"
    assert {text: 1}["a serial port"] == 1
    assert shown_in("ja", f"{text:.8}") == "a serial"
    assert type(pickle.loads(pickle.dumps(text))) is str


def test_programs_with_one_language_have_plain_strings():
    assert type(i18n.tr("a serial port")) is str
