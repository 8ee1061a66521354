"""The file store of the controller.

``store`` keeps the files below one directory, ``names`` checks names so that none leads out of it, ``disk`` accesses
the disk, ``errors`` makes the exceptions.
"""

from orinkit.virtual.rc8.files.store import MOST_BYTES, MOST_ENTRIES, PROGRAM, FileDates, FileStore

__all__ = ["MOST_BYTES", "MOST_ENTRIES", "PROGRAM", "FileDates", "FileStore"]
