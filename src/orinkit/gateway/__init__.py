"""The gateway: a provider that forwards calls to a controller, so that clients of any protocol can use the controller.

::

    serve(RemoteProvider("tcp://192.168.0.1:5007"), "http://127.0.0.1:8080", "udp://127.0.0.1:5007")
"""

from __future__ import annotations

from orinkit.gateway.remote import RemoteProvider
from orinkit.gateway.rules import AccessRules, RestrictedProvider
from orinkit.gateway.upstream import Upstream

__all__ = ["AccessRules", "RemoteProvider", "RestrictedProvider", "Upstream"]
