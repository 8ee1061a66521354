"""The virtual VE026A, a small arm with a serial line (b-CAP document for VE026A).

:class:`VirtualVE026A` is the provider for a server. ``objects`` contains the objects of clients, ``parameters`` parses
the parameters of commands, ``arm`` is the arm with its motor, errors and operations, ``slave`` its slave mode,
``codes`` defines the device-specific return codes. The control loop, the motion queue, the servo and the kinematics are
shared with the virtual RC8. Requires the extra ``virtual`` (numpy, lark).
"""

from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

require(tr("the virtual VE026A"), "virtual", "numpy", "lark")

from orinkit.virtual.ve026a.provider import VirtualVE026A  # noqa: E402 - missing packages must be reported first

__all__ = ["VirtualVE026A"]
