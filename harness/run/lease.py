"""A lock on an address of object storage, so that two runs do not write there at once.

The lock is an object that names its owner, who writes it again every few seconds. If the owner has not done so for
``LEASE_SECONDS``, by the clock of the storage, it was killed or cut off, and another run takes over. On the machine of
the owner, another run takes over as soon as its process has ended.
"""

from __future__ import annotations

import json
import os
import platform
import sys
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from uuid import uuid4

from harness.remote import Remote
from vfoa.errors import VfoaError

LOCK = ".lock"
"""Name of the object; hidden, so that no copy of the directory has it."""

RENEW_SECONDS = 20.0
LEASE_SECONDS = 120.0


@contextmanager
def leased(address: str, tell: Callable[[str], None]) -> Iterator[Callable[[], None]]:
    """Lock an address for this process; ``tell`` is called if the lock of a run that has ended is taken over.

    Yields a function that raises a :class:`VfoaError` if another run has taken the lock meanwhile, because this one
    could not reach the storage in time.

    Raises
    ------
    VfoaError
        If another run holds the lock, or the storage cannot be reached.
    """
    remote, ours = Remote(address), _owner()
    content = json.dumps(ours).encode()
    if not remote.create(LOCK, content):
        tell(f"{address}: took over the lock of {_ended(remote)}, which has ended")
        remote.remove([LOCK])
        if not remote.create(LOCK, content):
            raise _held(address, _read(remote), LEASE_SECONDS)
    ending = threading.Event()
    renewing = threading.Thread(target=_renew, args=(remote, ours, content, ending), daemon=True)
    renewing.start()

    def check() -> None:
        if (found := _read(remote)) != ours:
            raise VfoaError(f"{address}: {_name(found)} has taken over the lock of this run; expected one run")

    try:
        yield check
    finally:
        ending.set()
        renewing.join()
        with suppress(VfoaError):  # of a storage that cannot be reached; then the lock expires
            if _read(remote) == ours:
                remote.remove([LOCK])


def _renew(remote: Remote, ours: Mapping[str, Any], content: bytes, ending: threading.Event) -> None:
    while not ending.wait(RENEW_SECONDS):
        with suppress(VfoaError):  # it is tried again until the lease ends
            if _read(remote) == ours:
                remote.write(LOCK, content)


def _ended(remote: Remote) -> str:
    """The name of the owner, if its run has ended.

    Raises
    ------
    VfoaError
        If it may not have ended.
    """
    owner, age_s = _read(remote), remote.age_s(LOCK)
    if age_s is None or age_s >= LEASE_SECONDS or _process_ended(owner):
        return _name(owner)
    raise _held(remote.address, owner, LEASE_SECONDS - age_s)


def _held(address: str, owner: Mapping[str, Any], left_s: float) -> VfoaError:
    return VfoaError(
        f"{address}: {_name(owner)} runs here since {owner.get('since', 'an unknown time')}; expected one run at an "
        f"address: wait for it, or choose another --out (if it was killed: run again in {max(left_s, 1):.0f} s)"
    )


def _owner() -> dict[str, Any]:
    return {
        "process": os.getpid(),
        "host": platform.node(),
        "machine": _machine(),
        "since": datetime.now(UTC).isoformat(timespec="seconds"),
        "token": uuid4().hex,
    }


def _machine() -> str:
    """Identify the machine since its last start and, in a container, the container: each numbers its own processes."""
    boot, processes = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
    with suppress(OSError):
        return f"{platform.node()} {boot.read_text().strip()} {processes.readlink()}"
    return platform.node()


def _process_ended(owner: Mapping[str, Any]) -> bool:
    """Whether the owner was a process of this machine that has ended; False if that cannot be known."""
    if owner.get("machine") != _machine() or sys.platform == "win32":
        return False
    try:
        os.kill(int(owner["process"]), 0)
    except ProcessLookupError:
        return True
    except (OSError, KeyError, ValueError):
        pass
    return False


def _read(remote: Remote) -> dict[str, Any]:
    """The owner that the lock names; empty if there is none, or it is not a lock."""
    with suppress(ValueError):
        found = json.loads(remote.read(LOCK) or b"{}")
        return found if isinstance(found, dict) else {}
    return {}


def _name(owner: Mapping[str, Any]) -> str:
    return f"process {owner['process']} on {owner['host']}" if {"process", "host"} <= owner.keys() else "another run"
