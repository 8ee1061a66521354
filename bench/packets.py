"""The packets of the round trips, and the replies of a responder: slvMove with eight doubles, and a variable."""

from __future__ import annotations

from orinkit import functions
from orinkit.bcap import packet
from orinkit.bcap.requests import encode_request as encode_request  # the other modules import it from here
from orinkit.values import codec

POSE = [0.125, 45.0, 90.0, 0.25, 45.0, 0.5, 0.0, 0.0]
ARGUMENTS = (3, "slvMove", POSE)
REQUEST = encode_request(functions.robot_execute, ARGUMENTS, 1)
REPLY = packet.pack(1, 0, 1, codec.encode(POSE))
SERIAL = slice(5, 7)
FUNCTION = slice(9, 11)
VALUE = 12.5

DONE = packet.pack(1, 0, 0, b"")
REPLIES = {
    functions.controller_connect.id: packet.pack(1, 0, 1, codec.encode(2)),
    functions.controller_get_robot.id: packet.pack(1, 0, 1, codec.encode(3)),
    functions.controller_get_variable.id: packet.pack(1, 0, 1, codec.encode(4)),
    functions.robot_execute.id: REPLY,
    functions.variable_get_value.id: packet.pack(1, 0, 1, codec.encode(VALUE)),
}
"""The replies of a responder by the ID of the function; the reply to every other function is ``DONE``."""
