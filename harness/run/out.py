"""The directory that a run writes to: a folder, or the copy of one on object storage, which no other run uses."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from harness.mirror import Mirror
from harness.remote import Remote, folder_of, is_address
from harness.run.lease import leased
from vfoa.errors import VfoaError


@contextmanager
def opened(out: str | Path, tell: Callable[[str], None] = lambda line: None) -> Iterator[Path]:
    """Yield the folder to write to; if ``out`` is an address, a copy that is uploaded at the end, even after an error.

    ``tell`` is called if the lock of a killed run is taken over.

    Raises
    ------
    VfoaError
        If the address cannot be read or written, or another run writes there.
    """
    address = str(out).rstrip("/")
    here = folder_of(address) if is_address(address) else Path(out)
    if here is not None:
        yield here if here.name not in ("", "..") else here.resolve()  # "." has no name, which another run is named by
        return
    Remote(address).check_writable()
    with leased(address, tell) as check_lease:
        mirror = Mirror(address)
        mirror.pull()
        try:
            yield mirror.folder
        except BaseException:
            with suppress(VfoaError):  # the error that ended the run says more
                check_lease()
                mirror.push()
            raise
        check_lease()
        mirror.push()
