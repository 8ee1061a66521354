"""The file store of the controller.

``store`` manages the files below one directory. ``names`` checks the names, so that no name leads out of this
directory. ``usage`` limits the size of the store, ``disk`` accesses the disk, and ``errors`` creates the exceptions.
"""

from orinkit.virtual.rc8.files.location import MOST_BYTES
from orinkit.virtual.rc8.files.store import PROGRAM, FileDates, FileStore
from orinkit.virtual.rc8.files.usage import MOST_ENTRIES, MOST_STORED

__all__ = ["MOST_BYTES", "MOST_ENTRIES", "MOST_STORED", "PROGRAM", "FileDates", "FileStore"]
