"""PacScript, the robot language of the RC8: programs are loaded and checked as a whole, then run in slices.

A program is compiled once (:func:`~orinkit.virtual.rc8.pacscript.compiler.compile_program`); a
:class:`~orinkit.virtual.rc8.pacscript.machine.Machine` runs it on a
:class:`~orinkit.virtual.rc8.pacscript.host_interface.HostInterface`. Unsupported statements are rejected at load, with
their name and position.
"""
