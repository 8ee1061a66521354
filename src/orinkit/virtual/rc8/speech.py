"""The language a controller speaks: its own setting, apart from the language of the program that runs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from orinkit.language import Language, pick

Say: TypeAlias = Callable[[str, str], str]
"""Picks the English or the Japanese one of two texts."""


def speaker(language: Language | None) -> Say:
    """Return what picks a controller's texts.

    Args:
        language: ``"en"``, ``"ja"``, or ``None`` for the language of the process, whatever it is at the time.

    Raises:
        ValueError: another language.
    """
    if language is None:
        return pick
    if language not in ("en", "ja"):
        raise ValueError(
            pick(f'language must be "en" or "ja", not {language!r}', f'language は "en" か "ja" です: {language!r}')
        )
    return lambda en, ja: ja if language == "ja" else en
