"""The language of a controller, which may differ from the language of the process."""

from __future__ import annotations

from functools import partial

from orinkit.core.i18n import Language, Translate, tr, translate


def translator(language: Language | None) -> Translate:
    """Return the function that translates a controller's messages.

    Args:
        language: ``"en"``, ``"ja"``, or None for the current language of the process.

    Raises:
        ValueError: If the language is not one of these.
    """
    if language is None:
        return tr
    if language not in ("en", "ja"):
        raise ValueError(tr('language must be "en" or "ja", not {language!r}', language=language))
    return partial(translate, language)
