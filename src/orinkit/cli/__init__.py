"""The command line, ``orinkit``: :mod:`~orinkit.cli.app` is the entry point; each command has its own module.

The module of a command imports only what the options of the command require. The function of the command imports
everything else when it is called, so that ``orinkit --help`` stays fast.
Results go to stdout (with ``--json`` as one JSON document); everything else goes to stderr. Exit codes: 0 success,
1 failure, 2 invalid command line, 130 interrupted.
"""
