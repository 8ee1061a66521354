"""Secrets: validation; wrong secrets: delay of the replies, and logging; on a manual clock."""

from __future__ import annotations

import pytest

from orinkit.cao.shared_secret import FREE, LONGEST, SecretAttempts, check_secret
from orinkit.core import i18n
from orinkit.core.errors import InvalidValue

pytestmark = pytest.mark.core


def test_five_attempts_are_free_and_then_the_delay_grows():
    guesses = SecretAttempts()
    delays = [guesses.failed("10.0.0.7", 100.0).delay for _ in range(FREE + 6)]
    assert delays == [0, 0, 0, 0, 0, 0.125, 0.25, 0.5, LONGEST, LONGEST, LONGEST]
    for _ in range(5000):  # arbitrarily large
        assert guesses.failed("10.0.0.7", 100.0).delay == LONGEST


def test_each_address_has_its_own_count():
    guesses = SecretAttempts()
    for _ in range(100):
        guesses.failed("10.0.0.7", 100.0)
    assert guesses.failed("10.0.0.8", 100.0).delay == 0


def test_addresses_without_further_failures_are_dropped():
    guesses = SecretAttempts()
    for _ in range(100):
        guesses.failed("10.0.0.7", 100.0)
    assert guesses.failed("10.0.0.7", 700.0).delay == LONGEST
    assert guesses.failed("10.0.0.7", 1300.5).delay == 0


def test_one_log_entry_in_ten_seconds_with_the_count():
    guesses = SecretAttempts()
    counts = [guesses.failed("10.0.0.7", 100.0 + number / 64).failures_to_log for number in range(1000)]
    assert [(number, count) for number, count in enumerate(counts) if count] == [(4, 5), (644, 640)]
    assert guesses.failed("10.0.0.7", 130.0).failures_to_log == 1000 - 645 + 1


def test_the_number_of_stored_addresses_is_limited():
    guesses = SecretAttempts()
    for number in range(10_000):
        guesses.failed(f"{number}", 100.0)
    assert len(guesses._records) == 1000
    assert next(iter(guesses._records)) == "9000"


@pytest.mark.parametrize("secret", ["0123456789abcdef", "-._~" * 64])
def test_secrets(secret):
    assert check_secret(secret) == secret


@pytest.mark.parametrize(
    "secret", ["", "0123456789abcde", "a" * 257, "0123456789abcdef,", "0123456789 abcdef", "０" * 16]
)
def test_invalid_secrets(secret):
    with pytest.raises(InvalidValue, match="a secret must have 16 to 256"):
        check_secret(secret)
    i18n.use("ja")
    with pytest.raises(InvalidValue, match="16～256 文字"):
        check_secret(secret)
