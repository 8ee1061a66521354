"""The exceptions of the file store; each names the file or folder. The module ``store`` describes the codes."""

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
def map_os_errors(name: FileName) -> Iterator[None]:
    """Convert errors of the operating system to return codes, and log their text.

    Raises:
        CallError: FILE_NOT_FOUND if the file has been deleted; E_FAIL for any other error.
    """
    try:
        yield
    except FileNotFoundError:  # the file was deleted in the meantime
        raise not_found(name) from None
    except (OSError, UnicodeEncodeError) as error:  # UnicodeEncodeError: the system's encoding cannot express the name
        logger.error("%s: %s", name, error)  # noqa: TRY400 - the traceback does not help
        reason = getattr(error, "strerror", None) or str(error)
        raise error_for(hresult.E_FAIL, f"{name}: {reason}") from error


def not_found(name: FileName) -> CallError:
    """Return the exception for a name that does not exist."""
    return error_for(hresult.FILE_NOT_FOUND, str(name))


def taken(name: FileName) -> CallError:
    """Return the exception for a name that exists already."""
    return error_for(hresult.E_CAO_COLLECTION_REGISTERED, str(name))


def only_a_folder(name: FileName) -> CallError:
    """Return the exception for a name that only a folder can have, if the operation requires a file."""
    return error_for(
        hresult.E_INVALIDARG,
        tr("{name} is the name of a folder, expected a file", name=name),
    )


def into_itself(name: FileName) -> CallError:
    """Return the exception for moving a folder below itself."""
    return error_for(hresult.E_INVALIDARG, tr("the folder {name} cannot be moved into itself", name=name))


def no_content(name: FileName) -> CallError:
    """Return the exception for reading, writing or copying a folder like a file."""
    return error_for(hresult.E_ACCESSDENIED, tr("{name} is a folder", name=name))


def not_empty(name: FileName) -> CallError:
    """Return the exception for a folder that is not empty."""
    return error_for(
        hresult.E_ACCESSDENIED,
        tr("the folder {name} is not empty", name=name),
    )


def root_stays() -> CallError:
    """Return the exception for deleting or moving the root folder."""
    return error_for(
        hresult.E_ACCESSDENIED,
        tr("the root folder cannot be deleted or moved"),
    )


def special_file(name: FileName) -> CallError:
    """Return the exception for a change of a link or of another special file; the store never follows links."""
    return error_for(
        hresult.E_ACCESSDENIED,
        tr("{name} is a link or another special file on the disk", name=name),
    )


def too_large(name: FileName, most: int) -> CallError:
    """Return the exception for a file of more than ``most`` bytes."""
    return error_for(
        hresult.E_TOO_MUCH_DATA,
        tr("{name} exceeds the limit of {most} bytes", name=name, most=most),
    )


def too_many(count: int, most: int) -> CallError:
    """Return the exception for a new file or folder if the store has ``count`` of them and ``most`` are allowed."""
    return error_for(
        hresult.E_MAX_OBJECT,
        tr(
            "the controller has {count} files and folders, the limit is {most}. Try: delete some",
            count=count,
            most=most,
        ),
    )


def store_full(size: int, most: int) -> CallError:
    """Return the exception for a write after which all files together would have ``size`` bytes."""
    return error_for(
        hresult.E_TOO_MUCH_DATA,
        tr(
            "the files of the controller would have {size} bytes, the limit is {most} bytes. Try: delete some",
            size=size,
            most=most,
        ),
    )
