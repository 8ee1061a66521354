"""The command line, ``orinkit``: :mod:`~orinkit.cli.app` is the frame, beside it stands one module per command.

What a command needs beyond its own options is imported inside its function, so that ``orinkit --help`` stays quick.
Results go to stdout (with ``--json`` as one JSON document), everything else to stderr. Exit codes: 0 done, 1 it failed, 2
the command line cannot be used, 130 interrupted.
"""
