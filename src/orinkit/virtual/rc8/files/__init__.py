"""The file store of the controller.

``store`` manages the files below one directory. ``names`` checks the names, so that no name leads out of this
directory. ``disk`` accesses the disk, and ``errors`` creates the exceptions.
"""

from orinkit.virtual.rc8.files.location import MOST_BYTES
from orinkit.virtual.rc8.files.store import MOST_ENTRIES, PROGRAM, FileDates, FileStore

__all__ = ["MOST_BYTES", "MOST_ENTRIES", "PROGRAM", "FileDates", "FileStore"]
