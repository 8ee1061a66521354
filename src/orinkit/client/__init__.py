"""Clients. ``_async`` is written by hand; ``tools/make_sync.py`` generates ``_sync`` from it. Do not edit ``_sync``."""
