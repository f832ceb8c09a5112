"""Files over HTTP: resumed after interruptions, checked, and put in place atomically."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from hashlib import file_digest
from http import HTTPStatus
from pathlib import Path
from typing import Literal

import httpx

from harness.files.io import opened, take_lock
from vfoa.errors import VfoaError, first_line
from vfoa.weights import is_lfs_pointer

_TIMEOUT_S = 30.0
"""Seconds that a server may be silent."""

_PAGES = ("text/html", "application/xhtml+xml")


def download(
    url: str,
    target: Path,
    *,
    checksum: str | None,
    algorithm: Literal["sha256", "sha384"] = "sha256",
    resume: bool = False,
    progress: Callable[[int, int | None], None] | None = None,
) -> None:
    """Download a file to ``target``. Received data is kept beside it as ``<name>.partial`` until it is complete.

    ``checksum`` is that of the file in hexadecimal digits, by ``algorithm``; None if it is not known.

    An interrupted download continues where it stopped if the checksum is known: otherwise nothing would show that the
    two parts belong together. ``resume``: continue without a checksum, since the caller checks the content.
    ``progress`` is called with the bytes received, and the bytes of the whole file.

    Raises
    ------
    VfoaError
        If the server does not answer or not with the file (as with a page that asks to log in), the connection is cut,
        or the checksum is wrong.
    """
    partial = target.with_name(f"{target.name}.partial")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        if partial.is_symlink():  # its target is not a part of this file
            partial.unlink()
        with _alone(partial):
            if checksum is None and not resume:
                os.truncate(partial, 0)
            _receive(url, partial, progress or (lambda done, total: None))
            _verify(url, partial, checksum, algorithm)
            partial.replace(target)
    except OSError as error:
        raise VfoaError(f"{partial}: cannot be written: {error.strerror or error}") from None


@contextmanager
def _alone(partial: Path) -> Iterator[None]:
    """Lock a partial file for this process; two that append to one file would mix their bytes."""
    with partial.open("ab") as file:
        if not take_lock(file):
            raise VfoaError(f"{partial}: another process is downloading this file; wait for it, and try again")
        try:
            yield
        finally:
            if os.fstat(file.fileno()).st_size == 0:
                partial.unlink(missing_ok=True)


def _receive(url: str, partial: Path, progress: Callable[[int, int | None], None]) -> None:
    start = partial.stat().st_size if partial.exists() else 0
    # A compressed answer would have other bytes, and another length, than the file.
    headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={start}-"} if start else {})
    try:
        with _client(url) as client, client.stream("GET", url, headers=headers) as response:
            if start and response.status_code == HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
                return  # nothing is missing: it was cut after the last byte
            _append(response, partial, _first_byte(response, url, start), progress)
    except (httpx.ConnectError, httpx.ProxyError) as error:
        raise VfoaError(
            f"{url}: cannot be reached: {first_line(error)}; expected a connection, behind a proxy with HTTPS_PROXY set"
        ) from None
    except httpx.HTTPError as error:
        kept = partial.stat().st_size if partial.exists() else 0
        raise VfoaError(
            f"{url}: cut after {kept} bytes: {first_line(error)}; expected the whole file (try again)"
        ) from None


def _client(url: str) -> httpx.Client:
    """A client with the proxies and certificates of the surroundings; raises a :class:`VfoaError` if it takes none."""
    try:
        return httpx.Client(follow_redirects=True, timeout=_TIMEOUT_S)
    except (ValueError, httpx.InvalidURL) as error:
        raise VfoaError(
            f"{url}: not requested: {first_line(error)}; expected proxies as http://HOST:PORT or socks5://HOST:PORT "
            "(ALL_PROXY, HTTPS_PROXY, NO_PROXY)"
        ) from None
    except OSError as error:
        raise VfoaError(
            f"{url}: not requested: SSL_CERT_FILE or SSL_CERT_DIR: {error.strerror or error}; expected certificates"
        ) from None


def _first_byte(response: httpx.Response, url: str, start: int) -> int:
    """The offset in the file at which the answer begins."""
    kind = response.headers.get("Content-Type", "").partition(";")[0].strip().lower()
    if response.is_success and kind in _PAGES:
        raise VfoaError(f"{url}: answered with a web page ({kind}), perhaps a login page; expected the file")
    if response.status_code == HTTPStatus.OK:
        return 0
    if start and response.status_code == HTTPStatus.PARTIAL_CONTENT:
        content_range = response.headers.get("Content-Range", "nothing")
        if not content_range.startswith(f"bytes {start}-"):
            raise VfoaError(f"{url}: answered with {content_range}; expected bytes {start}- of the file")
        return start
    raise VfoaError(f"{url}: HTTP {response.status_code} {response.reason_phrase}; expected the file")


def _append(response: httpx.Response, partial: Path, first: int, progress: Callable[[int, int | None], None]) -> None:
    length = response.headers.get("Content-Length", "")
    done, total = first, first + int(length) if length.isdigit() else None
    with partial.open("r+b" if first else "wb") as file:
        file.seek(first)
        progress(done, total)
        for chunk in response.iter_raw():
            file.write(chunk)
            done += len(chunk)
            progress(done, total)
        file.flush()
        os.fsync(file.fileno())


def _verify(url: str, partial: Path, checksum: str | None, algorithm: str) -> None:
    """Remove data that is not the file, so that the next attempt begins anew."""
    if is_lfs_pointer(partial):
        problem = "answered with a Git LFS pointer; expected the file itself"
    elif checksum is not None and (digest := _digest(partial, algorithm)) != checksum:
        problem = f"wrong checksum, removed: found {algorithm} {digest}, expected {checksum}"
    else:
        return
    partial.unlink()
    raise VfoaError(f"{url}: {problem}")


def _digest(path: Path, algorithm: str) -> str:
    with opened(path) as file:
        return file_digest(file, algorithm).hexdigest()
