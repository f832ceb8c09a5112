"""The port and token of the last labelling page of the same labels, in the cache for a day.

An open page finds the server again after a restart. The cache can be a folder that others write to: a file is used
only if it is this user's, nobody else can read or write it, and it holds what is expected; any other is replaced.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import stat
import time
from pathlib import Path

from pydantic import Field

from harness.files.folders import cache_root
from harness.files.parsing import parse_json
from vfoa.errors import VfoaError
from vfoa.settings import Settings
from vfoa.validation import parse

_LONGEST_S = 24 * 3600
_MOST_BYTES = 4096
_log = logging.getLogger(__name__)


class Address(Settings):
    """A server's port, and its token."""

    port: int = Field(ge=1, le=65535, strict=True)
    token: str = Field(pattern=r"^[A-Za-z0-9_-]{16,256}$")


def read_address(labels: Path) -> Address | None:
    """The address of the last page of these labels, if it is of the last day and its file can be trusted; else None.

    A warning says why a file is not used.
    """
    try:
        return _read(_file_of(labels))
    except VfoaError as error:
        _log.warning("%s; the page has a new address", error)
        return None


def _read(file: Path) -> Address | None:
    try:
        with open(file, "rb", opener=_open_plainly) as opened:
            status = os.fstat(opened.fileno())
            content = opened.read(_MOST_BYTES) if stat.S_ISREG(status.st_mode) else b""
    except FileNotFoundError:
        return None
    except OSError as error:
        raise VfoaError(f"{file}: {error.strerror or error}; expected a plain file") from None
    mode = stat.S_IMODE(status.st_mode)
    if status.st_uid != os.geteuid():
        raise VfoaError(f"{file}: belongs to user {status.st_uid}; expected {os.geteuid()}")
    if mode & 0o077:
        raise VfoaError(f"{file}: others may read or write it (mode {mode:03o}); expected 600")
    if time.time() - status.st_mtime >= _LONGEST_S:
        return None
    found = parse_json(content, file)
    if not (isinstance(found, list) and len(found) == 2):
        raise VfoaError(f"{file}: damaged; expected a port and a token: remove the file")
    return parse(Address, {"port": found[0], "token": found[1]}, str(file))


def _open_plainly(path: str, flags: int) -> int:
    """Open a file, but not through a link, and without waiting for who writes to a pipe."""
    return os.open(path, flags | os.O_NOFOLLOW | os.O_NONBLOCK)


def write_address(labels: Path, address: Address) -> None:
    """Store the address of a page of these labels in place of the last one; a warning says why it is not stored."""
    file = _file_of(labels)
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        file.unlink(missing_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
            json.dump([address.port, address.token], opened)
    except OSError as error:
        reason = error.strerror or error
        _log.warning("%s: cannot be written: %s; the page has another address after a restart", file, reason)


def _file_of(labels: Path) -> Path:
    name = hashlib.sha256(os.fsencode(labels.resolve())).hexdigest()[:24]
    return cache_root() / "annotate" / f"{name}.json"
