"""What the file store refuses, as exceptions that name the file; its module tells which code means what."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager

from orinkit.core import hresult
from orinkit.core.errors import CallError, error_for
from orinkit.core.i18n import tr
from orinkit.virtual.rc8.files.names import FileName

logger = logging.getLogger("orinkit.virtual.rc8")


@contextmanager
def reported(name: FileName) -> Iterator[None]:
    """Turn what the system refuses into codes; its own words go into the log.

    Raises:
        CallError: FILE_NOT_FOUND, E_FAIL.
    """
    try:
        yield
    except FileNotFoundError:  # it went while we looked
        raise not_found(name) from None
    except (OSError, UnicodeEncodeError) as error:  # the second: not in this system's encoding of names
        logger.error("%s: %s", name, error)  # noqa: TRY400 - the reason is all there is to tell
        reason = getattr(error, "strerror", None) or str(error)
        raise error_for(hresult.E_FAIL, f"{name}: {reason}") from error


def not_found(name: FileName) -> CallError:
    """Nothing of that name is there."""
    return error_for(hresult.FILE_NOT_FOUND, str(name))


def taken(name: FileName) -> CallError:
    """Something of that name is there."""
    return error_for(hresult.E_CAO_COLLECTION_REGISTERED, str(name))


def only_a_folder(name: FileName) -> CallError:
    """The name is that of a folder, the thing is none."""
    return error_for(
        hresult.E_INVALIDARG,
        tr("{name}: a file is wanted, not a folder", name=name),
    )


def into_itself(name: FileName) -> CallError:
    """A folder would be moved below itself."""
    return error_for(hresult.E_INVALIDARG, tr("{name} cannot go into itself", name=name))


def no_content(name: FileName) -> CallError:
    """A folder is read, written or copied as if it were a file."""
    return error_for(hresult.E_ACCESSDENIED, tr("{name} is a folder", name=name))


def not_empty(name: FileName) -> CallError:
    """A folder has something in it."""
    return error_for(
        hresult.E_ACCESSDENIED,
        tr("the folder {name} is not empty", name=name),
    )


def root_stays() -> CallError:
    """The root folder is deleted or moved."""
    return error_for(
        hresult.E_ACCESSDENIED,
        tr("the root folder can be neither deleted nor moved"),
    )


def in_the_way(name: FileName) -> CallError:
    """Something that is never followed lies where something would be changed or made."""
    return error_for(
        hresult.E_ACCESSDENIED,
        tr("{name} is a link, or something else that is no file, on the disk", name=name),
    )


def too_large(name: FileName, most: int) -> CallError:
    """A file has, or would have, more than ``most`` bytes."""
    return error_for(
        hresult.E_TOO_MUCH_DATA,
        tr("{name}: more than {most} bytes", name=name, most=most),
    )


def too_many(count: int, most: int) -> CallError:
    """There is no room for one more file or folder."""
    return error_for(
        hresult.E_MAX_OBJECT,
        tr("the controller has {count} files and folders, {most} at most; delete some", count=count, most=most),
    )
