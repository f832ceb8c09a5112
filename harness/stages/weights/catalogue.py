"""The model catalogue: the known models, their licences, and the sources of their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Self

from pydantic import Field, model_validator

from harness.files.digests import file_digest
from harness.files.parsing import read_toml
from vfoa.errors import VfoaError, did_you_mean
from vfoa.settings import Settings
from vfoa.validation import parse
from vfoa.weights import cache_directory, locate

Progress = Callable[[int, int | None], None]
"""Called with the bytes received, and the bytes of the whole file if known."""


class CatalogueEntry(Settings):
    """One model of ``harness/stages/weights/catalogue.toml``, whose head explains the keys. None: not known."""

    file: str
    task: str
    stage: str | None = Field(default=None, pattern=r"^\w+\.\w+$")
    licence: str
    non_commercial: bool = False
    home: str
    address: str | None = None
    note: str | None = None
    sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")
    bytes: int | None = Field(default=None, gt=0)
    megabytes: float | None = Field(default=None, gt=0)
    inputs: Mapping[str, tuple[int | str, ...]] = Field(default_factory=dict)
    outputs: Mapping[str, tuple[int | str, ...]] = Field(default_factory=dict)
    integers: tuple[str, ...] = ()
    by_position: bool = False
    sizes: Mapping[str, int] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _check_what_is_fetched(self) -> Self:
        if self.address is not None and self.sha256 is None:
            raise ValueError("address: expected sha256 beside it: without one, a login page would pass for the model")
        return self

    @property
    def is_onnx(self) -> bool:
        """Whether the file is a network that can be run; otherwise it is a checkpoint to be exported."""
        return self.file.endswith(".onnx")

    @property
    def size(self) -> str | None:
        """Size of the file, such as "7.5 MB"; None if not known."""
        megabytes = self.bytes / 1e6 if self.bytes else self.megabytes
        return None if megabytes is None else f"{megabytes:.1f} MB"

    def find(self) -> Path | None:
        """Return the path of its file on this machine; None if it is missing."""
        try:
            return locate(self.file)
        except VfoaError:
            return None


@cache
def catalogue() -> Mapping[str, CatalogueEntry]:
    """Return every model by name, in the order of the file.

    Raises
    ------
    VfoaError
        If the file has an unknown key or a wrong value.
    """
    with resources.as_file(resources.files("harness.stages.weights") / "catalogue.toml") as path:
        return {name: parse(CatalogueEntry, table, str(path), name) for name, table in read_toml(path).items()}


def find_model(name: str) -> CatalogueEntry:
    """Return the model of this name.

    Raises
    ------
    VfoaError
        If there is none; the message suggests the nearest name.
    """
    models = catalogue()
    if name not in models:
        raise VfoaError(f"models: no {name!r}; {did_you_mean(name, models)}")
    return models[name]


def fetch_model(name: str, entry: CatalogueEntry, *, accept_licence: bool, progress: Progress | None = None) -> Path:
    """Download a model's file, if it is not on this machine yet, and return its path.

    Raises
    ------
    VfoaError
        If its licence was not accepted, no address with a checksum is known, another file would hide it, or
        the download fails.
    """
    from harness.files.download import download

    here = entry.find()
    if here and (entry.sha256 is None or file_digest(here) == entry.sha256):
        return here
    target = cache_directory() / entry.file
    if here and here != target:
        raise VfoaError(
            f"{here}: not the catalogue's {name} (another checksum), and it would hide the fetched one; "
            "expected it to be moved away"
        )
    if entry.non_commercial and not accept_licence:
        raise VfoaError(f"{name}: licence: {entry.licence}; expected --accept-licence")
    if entry.address is None:
        note = f" ({entry.note})" if entry.note else ""
        raise VfoaError(
            f"{name}: no address with a checksum is known{note}; expected you to get it from {entry.home} as {target}"
        )
    download(entry.address, target, sha256=entry.sha256, progress=progress)
    return target
