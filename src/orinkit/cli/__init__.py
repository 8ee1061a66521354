"""The command line, ``orinkit``: :mod:`~orinkit.cli.app` is the entry point; each command has its own module.

The function of a command imports everything that its options do not need, so that ``orinkit --help`` stays fast.
Results go to stdout (with ``--json`` as one JSON document); everything else goes to stderr. Exit codes: 0 success,
1 failure, 2 invalid command line, 130 interrupted.
"""
