"""The page's port and token, stored for a day: an open page finds the server again after a restart."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.files.cache import cache_root

_LONGEST_S = 24 * 3600


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Port and token of a page; port 0 is any free port."""

    port: int
    token: str


def new_address(port: int = 0) -> Address:
    """Return an address with a new token."""
    return Address(port=port, token=secrets.token_urlsafe(24))


def last_address(labels: Path) -> Address | None:
    """Return the last page's address for an annotation file; None if there was none within a day."""
    file = _file(labels)
    try:
        if time.time() - file.stat().st_mtime < _LONGEST_S:
            return Address(**json.loads(file.read_text()))
    except (OSError, ValueError, TypeError):
        pass  # only the address is lost
    return None


def remember(labels: Path, address: Address) -> None:
    """Store the address so that only this user can read it. If that fails, the next address is a new one."""
    file = _file(labels)
    try:
        file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        file.unlink(missing_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as opened:
            json.dump(asdict(address), opened)
    except OSError:
        pass


def _file(labels: Path) -> Path:
    name = hashlib.sha256(os.fsencode(labels.resolve())).hexdigest()[:24]
    return cache_root() / "annotate" / f"{name}.json"
