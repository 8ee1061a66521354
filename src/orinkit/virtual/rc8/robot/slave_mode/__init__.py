"""Slave mode of the virtual RC8 (RC8 4): a client moves the arm by one set-point for each cycle.

:class:`~orinkit.virtual.rc8.robot.slave_mode.slave_mode.RC8SlaveMode` is the mode itself: its buffer and what ends it. ``target`` makes joints of
a set-point, ``limits`` says which commands are refused, ``points`` has the I/O beside them, ``answer`` what slvMove tells,
``pace`` and ``bridge`` what happens in a server that is late; ``commands`` is what clients call.
"""
