"""Clients: ``_async`` is written by hand, ``_sync`` is made from it by ``tools/make_sync.py`` and never edited."""
