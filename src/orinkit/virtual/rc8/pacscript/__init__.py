"""PacScript, the robot language of the RC8: a program is checked as a whole, then executed a few statements at a time.

A program is compiled once (:func:`~orinkit.virtual.rc8.pacscript.compiler.compile_program`). A
:class:`~orinkit.virtual.rc8.pacscript.machine.Machine` executes it and accesses the controller through a
:class:`~orinkit.virtual.rc8.pacscript.host_interface.HostInterface`. If a program contains an unsupported statement, it
is not loaded; the error has the name and the position of the statement.
"""
