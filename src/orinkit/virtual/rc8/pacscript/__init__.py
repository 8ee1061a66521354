"""PacScript, the robot language of the RC8: programs are loaded whole, checked, and run in slices.

A program is compiled once (:func:`~orinkit.virtual.rc8.pacscript.compiler.compile_program`); a
:class:`~orinkit.virtual.rc8.pacscript.machine.Machine` runs it on a
:class:`~orinkit.virtual.rc8.pacscript.host_interface.HostInterface`. What is not supported is refused at load, by name and place.
"""
