"""The page's port and token, remembered for a day: a page that is open finds the server again after a restart."""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from harness.remote import cache_root

_LONGEST_S = 24 * 3600


@dataclass(frozen=True, slots=True, kw_only=True)
class Address:
    """Port 0 is any that is free."""

    port: int
    token: str


def new_address(port: int = 0) -> Address:
    """An address with a token of its own."""
    return Address(port=port, token=secrets.token_urlsafe(24))


def last_address(labels: Path) -> Address | None:
    """That of the last page of an annotation file; None where there was none within a day."""
    file = _file(labels)
    try:
        if time.time() - file.stat().st_mtime < _LONGEST_S:
            return Address(**json.loads(file.read_text()))
    except (OSError, ValueError, TypeError):
        pass  # nothing is lost but the address
    return None


def remember(labels: Path, address: Address) -> None:
    """Note the address where this user alone can read it. Where that fails, the next one is another."""
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
