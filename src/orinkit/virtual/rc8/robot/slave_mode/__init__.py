"""Slave mode of the virtual RC8 (RC8 4): a client moves the arm with one set-point for each cycle.

:class:`~orinkit.virtual.rc8.robot.slave_mode.slave_mode.RC8SlaveMode` implements the mode: its owner, its cycles and
its end. ``set_point`` converts a set-point to joints, ``limits`` checks the command positions, ``io`` transfers the I/O
in addition to the poses, and ``formats`` contains the formats of a client. The buffer is in
``engine.set_point_buffer``, the result of slvMove in ``robot.slave_feedback``, the timing in ``engine.elastic_time``
and ``engine.catch_up``, and the commands of clients in ``objects.slave_commands``.
"""
