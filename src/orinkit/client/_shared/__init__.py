"""Data types and functions shared by the asynchronous and the synchronous client; no I/O."""
