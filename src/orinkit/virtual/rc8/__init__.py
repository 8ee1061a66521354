"""The virtual RC8: a provider that answers as DENSO's RC8 controller does (b-CAP specification for RC8).

:class:`VirtualRC8` is what a server is given. Below it ``state`` holds what all clients share, ``controller`` and
``variables`` are the objects one client holds, ``robot`` and ``motion`` are the arm, ``pacscript`` its programs, and each
other module has one concern of the controller. Needs the extra ``virtual`` (numpy, lark).
"""

from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

require(tr("the virtual RC8"), "virtual", "numpy", "lark")

from orinkit.virtual.rc8.pendant import Pendant  # noqa: E402 - what is missing is to be told first
from orinkit.virtual.rc8.permission import AccessRight, Permission  # noqa: E402
from orinkit.virtual.rc8.provider import VirtualRC8  # noqa: E402
from orinkit.virtual.rc8.switches import ModeSwitch, Token  # noqa: E402
from orinkit.virtual.rc8.variables.database import StateError  # noqa: E402

__all__ = ["AccessRight", "ModeSwitch", "Pendant", "Permission", "StateError", "Token", "VirtualRC8"]
