"""The controller's file store, and the File objects that clients hold.

``store`` keeps the files below one directory, ``names`` reads names so that none leads out of it, ``disk`` is what touches the
disk, ``refusals`` what is refused, ``served`` the objects.
"""

from orinkit.virtual.rc8.files.store import MOST_BYTES, MOST_ENTRIES, PROGRAM, FileDates, FileStore

__all__ = ["MOST_BYTES", "MOST_ENTRIES", "PROGRAM", "FileDates", "FileStore"]
