"""The synchronous API of ABH3, generated from ``_async`` by ``tools/make_sync.py``."""
