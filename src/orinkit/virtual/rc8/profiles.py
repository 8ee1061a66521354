"""The controllers that a virtual RC8 can represent, one row each (docs/howto/virtual-rc8.md)."""

from __future__ import annotations

from typing import Final

from orinkit.core.i18n import tr
from orinkit.core.record import record


@record
class Profile:
    """A controller of the RC8 family.

    Attributes:
        name: Name of the profile, for example ``"rc9"``.
        version: Software version (``@VERSION``) by default.
        type: Type of the controller (``@TYPE``).
        model: Name of the arm by default (:data:`orinkit.arms.MODEL_NAMES`).
        dated_errors: True if GetCurErrorInfo has the date of the error as its eighth element, and the error code as its
            additional code.
    """

    name: str
    version: str
    type: str
    model: str
    dated_errors: bool = False


# The provider guide has the type of an RC8. The versions are assumptions: 2.13 is the lowest that published programs for a
# COBOTTA require. Programs for an RC9 show the form of its errors.
_ROWS: Final = (
    Profile("rc8", "2.6.0", "RC8 Controller", "VS-050"),
    Profile("rc8a", "2.13.0", "RC8 Controller", "VS-050"),
    Profile("rc9", "1.0.0", "RC9 Controller", "COBOTTA-PRO-900", dated_errors=True),
    Profile("cobotta", "2.13.0", "RC8 Controller", "COBOTTA"),
)

PROFILES: Final = {row.name: row for row in _ROWS}
"""The profiles by name."""


def find_profile(name: str) -> Profile:
    """Return a profile by its name, in upper or lower case.

    Raises:
        ValueError: If there is no such profile.
    """
    profile = PROFILES.get(name.strip().lower())
    if profile is None:
        names = ", ".join(PROFILES)
        raise ValueError(tr("controller {name!r}: not one of {names}", name=name[:60], names=names))
    return profile
