"""The virtual RC8: a provider that answers as DENSO's RC8 controller does (b-CAP specification for RC8).

:class:`VirtualRC8` is what a server is given. Below it ``state`` holds what all clients share, ``controller`` and
``variables`` are the objects one client holds, and each other module has one concern of the controller.
"""

from orinkit.virtual.rc8.pendant import Mode
from orinkit.virtual.rc8.permission import Access, Permission
from orinkit.virtual.rc8.provider import VirtualRC8
from orinkit.virtual.rc8.store import StateError

__all__ = ["Access", "Mode", "Permission", "StateError", "VirtualRC8"]
