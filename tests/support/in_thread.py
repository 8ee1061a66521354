"""Running a coroutine in a thread: the synchronous interface of Playwright keeps an event loop running in the main thread."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from typing import Any


def run_in_thread(work: Coroutine[Any, Any, None]) -> None:
    """Run a coroutine in an event loop of its own."""
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, work).result()
