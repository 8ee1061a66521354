"""The virtual RC8: a provider that behaves like DENSO's RC8 controller (b-CAP specification for RC8).

Pass a :class:`VirtualRC8` to a server. The module ``state`` contains the state shared by all clients, ``objects`` the
objects of one client, ``robot`` the arm, and ``pacscript`` the language of the programs. Each other module is one part
of the controller. The package requires the extra ``virtual`` (numpy, lark).
"""

from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

require(tr("the virtual RC8"), "virtual", "numpy", "lark")

from orinkit.virtual.rc8.pendant import Pendant  # noqa: E402 - report a missing extra first
from orinkit.virtual.rc8.permission import AccessRight, Permission  # noqa: E402 - as above
from orinkit.virtual.rc8.provider import VirtualRC8  # noqa: E402 - as above
from orinkit.virtual.rc8.switches import ModeSwitch, Token  # noqa: E402 - as above
from orinkit.virtual.rc8.variables.database import StateError  # noqa: E402 - as above

__all__ = ["AccessRight", "ModeSwitch", "Pendant", "Permission", "StateError", "Token", "VirtualRC8"]
