"""The virtual VE026A: the small arm with a serial line (b-CAP document for VE026A).

:class:`VirtualVE026A` is what a server is given. Below it ``served`` has the objects that a client holds, ``parameters`` reads
what it sends, ``arm`` is the arm with its motor, errors and works that take their time, ``slave`` the mode in which it
moves, ``codes`` the return codes of its own. Cycle, command, brake, encoders and kinematics are those of the virtual RC8.
Needs the extra ``virtual`` (numpy, lark).
"""

from orinkit.core.i18n import tr
from orinkit.core.optional_deps import require

require(tr("the virtual VE026A"), "virtual", "numpy", "lark")

from orinkit.virtual.ve026a.provider import VirtualVE026A  # noqa: E402 - what is missing is to be told first

__all__ = ["VirtualVE026A"]
