"""The garbage collector of a server: rare collections are for the start only."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import gc
from orinkit.cli._shared import collector
usual = gc.get_threshold()
collector.collect_rarely()
assert gc.get_threshold()[0] > 2 * usual[0]
from orinkit.cli.commands import serve_rc8
collector.collect_as_usual()
assert gc.get_threshold() == usual
assert gc.get_freeze_count() > 10_000
"""


def test_a_server_collects_garbage_as_usual_when_it_has_started() -> None:
    subprocess.run([sys.executable, "-c", PROGRAM], check=True)


def test_a_served_controller_has_the_usual_thresholds() -> None:
    program = """
import gc, sys, threading, time, os, signal
usual = gc.get_threshold()
def look():
    while gc.get_freeze_count() == 0:
        time.sleep(0.01)
    time.sleep(0.1)
    print(gc.get_threshold() == usual, flush=True)
    os.kill(os.getpid(), signal.SIGTERM)
threading.Thread(target=look, daemon=True).start()
sys.argv = ["orinkit", "serve", "rc8", "--tcp", "127.0.0.1:0"]
from orinkit.__main__ import main
sys.exit(main())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60)
    assert "True" in done.stdout.split(), done
