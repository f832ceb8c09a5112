"""Learned models: the catalogue, downloads, checks of their files, and the stages that can run on this machine."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field

from harness.files.digests import file_digest
from harness.files.io import atomic_write
from harness.files.parsing import read_toml
from harness.pipeline.configuration import STAGES, StageChoice, StageKind
from vfoa.errors import VfoaError, check_known
from vfoa.onnx import Model, RuntimeSettings, Signature
from vfoa.settings import Settings
from vfoa.validation import parse
from vfoa.weights import cache_directory, directories, is_lfs_pointer, locate, weights_of

DownloadProgress = Callable[[int, int | None], None]
"""Called with the bytes received, and the bytes of the whole file if known."""


class PublishedFile(Settings):
    """A published file: address, size and SHA-384."""

    address: str
    bytes: int = Field(gt=0)
    sha384: str = Field(pattern=r"^[0-9a-f]{96}$")


class OpenVinoFiles(Settings):
    """The two files of a network in OpenVINO's own format: its layers, and their constants."""

    xml: PublishedFile
    bin: PublishedFile


class CatalogueEntry(Settings):
    """One model of ``harness/pipeline/weights.toml``, whose head explains the keys. None: not known."""

    file: str
    task: str
    stage: str | None = Field(default=None, pattern=r"^\w+\.\w+$")
    licence: str
    non_commercial: bool = False
    home: str
    address: str | None = None
    openvino: OpenVinoFiles | None = None
    checkpoint: PublishedFile | None = None
    note: str | None = None
    sha256: str | None = Field(default=None, pattern=r"^[0-9a-f]{64}$")
    other_sha256: tuple[str, ...] = ()
    bytes: int | None = Field(default=None, gt=0)
    megabytes: float | None = Field(default=None, gt=0)
    inputs: Mapping[str, tuple[int | str, ...]] = Field(default_factory=dict)
    outputs: Mapping[str, tuple[int | str, ...]] = Field(default_factory=dict)
    integers: tuple[str, ...] = ()
    by_position: bool = False
    sizes: Mapping[str, int] = Field(default_factory=dict)

    @property
    def can_be_fetched(self) -> bool:
        """Whether ``vfoa models fetch`` brings it."""
        return any((self.address, self.openvino, self.checkpoint))

    def is_file_of(self, path: Path) -> bool:
        """Whether a file is this model by its checksum; True if none is known."""
        return self.sha256 is None or file_digest(path) in (self.sha256, *self.other_sha256)

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
        return _find(self.file)


@cache
def catalogue() -> Mapping[str, CatalogueEntry]:
    """Return every model by name, in the order of the file.

    Raises
    ------
    VfoaError
        If the file has an unknown key or a wrong value.
    """
    path = Path(__file__).with_suffix(".toml")
    return {name: parse(CatalogueEntry, table, str(path), name) for name, table in read_toml(path).items()}


def find_model(name: str) -> CatalogueEntry:
    """Return the model of this name.

    Raises
    ------
    VfoaError
        If there is none; the message suggests the nearest name.
    """
    models = catalogue()
    check_known(name, models, "models: no")
    return models[name]


def fetch_model(
    name: str, entry: CatalogueEntry, *, accept_licence: bool, progress: DownloadProgress | None = None
) -> Path:
    """Download a model's file, if it is not on this machine yet, and return its path.

    A network that is published in OpenVINO's format, or as a checkpoint of PyTorch, is converted to ONNX.

    Raises
    ------
    VfoaError
        If its licence was not accepted, no address with a checksum is known, another file would hide it, or
        the download fails.
    """
    from harness.files.download import download

    here = entry.find()
    if here and entry.is_file_of(here):
        return here
    target = cache_directory() / entry.file
    if here and here != target:
        raise VfoaError(
            f"{here}: its checksum is not that of {name} in the catalogue, and it would be used in place of the "
            "fetched file; move it away"
        )
    if entry.non_commercial and not accept_licence:
        raise VfoaError(f"{name}: its licence allows no commercial use: {entry.licence}; expected --accept-licence")
    if entry.openvino is not None:
        from harness.pipeline import openvino_ir

        files = {target.with_suffix(".xml"): entry.openvino.xml, target.with_suffix(".bin"): entry.openvino.bin}
        _fetch_converted(files, openvino_ir.convert, target, sha256=entry.sha256, progress=progress)
    elif entry.checkpoint is not None:
        from harness.pipeline import tddfa_checkpoint

        files = {target.with_suffix(".pth"): entry.checkpoint}
        _fetch_converted(files, tddfa_checkpoint.convert, target, sha256=entry.sha256, progress=progress)
    elif entry.address is not None:
        download(entry.address, target, checksum=entry.sha256, progress=progress)
    else:
        note = f" ({entry.note})" if entry.note else ""
        raise VfoaError(f"{name}: no address with a checksum is known{note}; get it from {entry.home} as {target}")
    return target


def _fetch_converted(
    files: Mapping[Path, PublishedFile],
    convert: Callable[..., bytes],
    target: Path,
    *,
    sha256: str | None,
    progress: DownloadProgress | None,
) -> None:
    """Download published files, convert them to ``target``, and remove what was downloaded."""
    from harness.files.download import download

    done = 0

    def report(of_file: int, _: int | None) -> None:
        if progress is not None:
            progress(done + of_file, sum(file.bytes for file in files.values()))

    for path, file in files.items():
        download(file.address, path, checksum=file.sha384, algorithm="sha384", progress=report)
        done += file.bytes
    try:
        content = convert(*files)
        if (found := hashlib.sha256(content).hexdigest()) != sha256:
            raise VfoaError(f"{target}: wrong checksum of the conversion: found sha256 {found}, expected {sha256}")
        atomic_write(target, content)
    finally:
        for path in files:
            path.unlink(missing_ok=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class ModelCheck:
    """The result of checking one model.

    ``provider`` and ``inference_ms`` are None if nothing was run; ``checksum_known`` says whether the catalogue has a
    checksum to compare with. ``message`` says what is wrong, or what else a reader must know.
    """

    name: str
    verdict: Literal["ok", "fails", "absent"]
    provider: str | None = None
    inference_ms: float | None = None
    checksum_known: bool = False
    message: str | None = None


def check_model(name: str, entry: CatalogueEntry, settings: RuntimeSettings) -> ModelCheck:
    """Load a model, check its signature, run it once on zeros, compare its checksum; a failure is a verdict."""
    path = entry.find()
    if path is None:
        source = f"vfoa models fetch {name}" if entry.can_be_fetched else f"its home: {entry.home}"
        return ModelCheck(name=name, verdict="absent", message=f"no file {entry.file} here ({source})")
    try:
        if is_lfs_pointer(path):
            raise VfoaError(f"{path}: a Git LFS pointer; expected the model itself (fetch it with git lfs pull)")
        same = entry.is_file_of(path)
        if entry.bytes is not None and (size := path.stat().st_size) < entry.bytes and not same:
            raise VfoaError(f"{path}: truncated: found {size} bytes, expected {entry.bytes}")
        provider, inference_ms = _run_once(path, entry, settings) if entry.is_onnx else (None, None)
        if entry.sha256 is not None and not same:
            raise VfoaError(
                f"{path}: corrupt, or another version: found sha256 {file_digest(path)[:16]}..., expected "
                f"{entry.sha256[:16]}..."
            )
    except VfoaError as error:
        return ModelCheck(name=name, verdict="fails", message=str(error))
    return ModelCheck(
        name=name,
        verdict="ok",
        provider=provider,
        inference_ms=inference_ms,
        checksum_known=entry.sha256 is not None,
        message=None if entry.is_onnx else entry.note,
    )


def signature(entry: CatalogueEntry) -> Signature:
    """Return the catalogue's signature of a model; a length given as a word becomes None."""

    def shapes(tensors: dict[str, tuple[int | str, ...]]) -> dict[str, tuple[int | None, ...]]:
        return {
            name: tuple(length if isinstance(length, int) else None for length in shape)
            for name, shape in tensors.items()
        }

    return Signature(
        inputs=shapes(dict(entry.inputs)),
        outputs=shapes(dict(entry.outputs)),
        by_position=entry.by_position,
        integers=frozenset(entry.integers),
    )


def _run_once(path: Path, entry: CatalogueEntry, settings: RuntimeSettings) -> tuple[str, float]:
    """Return the provider, and the milliseconds of one inference on zeros."""
    model = Model(str(path), signature(entry), settings)
    zeros = {
        name: np.zeros([entry.sizes[length] if isinstance(length, str) else length for length in shape], np.float32)
        for name, shape in entry.inputs.items()
    }
    provider = model.provider()
    started = time.perf_counter()
    model.run(**zeros)
    return provider, (time.perf_counter() - started) * 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadyStage:
    """A stage of the library that can run here, and the settings that choose it, such as ``gaze.model=l2cs``."""

    name: str
    settings: tuple[str, ...]
    licences: tuple[str, ...]

    @property
    def options(self) -> str:
        """Options of ``vfoa run`` that choose it."""
        return " ".join(f"--set {setting}" for setting in self.settings)

    @property
    def described(self) -> str:
        """Its options, with the licences of its weights."""
        return f"{self.options} ({', '.join(self.licences)})" if self.licences else self.options


def ready_stages(slot: StageKind) -> list[ReadyStage]:
    """The stages of the library in a slot that need no weights, or whose weights are on this machine.

    A stage whose default weights are missing is ready with another network of the catalogue.
    """
    ready = []
    for name in slot.library.builtin:
        needed: tuple[str, ...] | None = None
        with suppress(ValueError):  # its settings must name them
            needed = tuple(weights_of(slot.stage_class(name).Settings()))
        chosen: tuple[str, ...] = (f"{slot.name}.{slot.key}={name}",)
        if needed is None or not all(map(_find, needed)):
            networks = (entry for entry in catalogue().values() if entry.stage == f"{slot.name}.{name}")
            other = next((entry for entry in networks if entry.find()), None)
            if other is None or (needed is not None and len(needed) > 1):
                continue
            needed, chosen = (other.file,), (*chosen, f"{slot.name}.weights={other.file}")
        licences = {entry.licence for entry in catalogue().values() if entry.file in needed}
        ready.append(ReadyStage(name=name, settings=chosen, licences=tuple(sorted(licences))))
    return ready


def models_of(choices: Iterable[StageChoice]) -> dict[str, CatalogueEntry]:
    """Return the models of the catalogue whose files the stages name, by name."""
    files = {file for choice in choices for file in weights_of(choice.settings)}
    return {name: entry for name, entry in catalogue().items() if entry.file in files}


@dataclass(frozen=True, slots=True, kw_only=True)
class MissingWeights:
    """Models of the catalogue that stages name and that are not here.

    ``instead`` are the stages that can run in place of those without weights: None for one that nothing can replace.
    """

    models: Mapping[str, CatalogueEntry]
    instead: tuple[ReadyStage | None, ...]

    @property
    def fetch(self) -> str:
        """The command that fetches them, or says where to get them."""
        return f"vfoa models fetch {' '.join(self.models)}"

    @property
    def alternatives(self) -> list[str]:
        """Options that choose the stages that can run instead, with the licences of their weights."""
        return [stage.described for stage in self.instead if stage]

    @property
    def hint(self) -> str:
        """The end of a message: options with which nothing is missing; empty if a stage has no replacement."""
        ready = [stage for stage in self.instead if stage]
        if len(ready) < len(self.instead):
            return ""
        licences = sorted({licence for stage in ready for licence in stage.licences})
        of_ready = f" ({', '.join(licences)})" if licences else ""
        return f"; or what is here already{of_ready}: {' '.join(stage.options for stage in ready)}"


def missing_weights(choices: Iterable[StageChoice], others: Iterable[StageChoice] = ()) -> MissingWeights | None:
    """Return what is missing of the weights that the stages name; None if all are here.

    What could run instead fits these stages and the ``others``: where one needs a face, the detector finds some.
    """
    choices = list(choices)
    without = [choice for choice in choices if _absent([choice])]
    if not without:
        return None
    need_face = any(STAGES[choice.slot].needs_face(choice) for choice in (*choices, *others))
    instead = []
    for slot, name in dict.fromkeys((choice.slot, choice.name) for choice in without):
        ready = [] if name in STAGES[slot].of_clip else ready_stages(STAGES[slot])
        if slot == "heads" and need_face:
            ready = [stage for stage in ready if STAGES[slot].finds_faces(stage.name)]
        # the same stage with other weights, else another network, else any
        ready.sort(key=lambda stage: (stage.name != name, not stage.licences))
        instead.append(ready[0] if ready else None)
    return MissingWeights(models=_absent(without), instead=tuple(instead))


def _absent(choices: Iterable[StageChoice]) -> dict[str, CatalogueEntry]:
    return {name: entry for name, entry in models_of(choices).items() if not entry.find()}


def locate_weights(
    choices: Iterable[StageChoice], fetch: str | None = None, *, where: str | None = None
) -> dict[str, Path]:
    """Return the path of each weights file that the stages name.

    ``fetch`` is a command that fetches just what is missing; by default one that names every model. ``where`` opens the
    message about a file that is not of the catalogue.

    Raises
    ------
    VfoaError
        If some are missing. For those of the catalogue, the message gives licence and size, the command that fetches
        them, and, if each stage without its weights has another one that can run here, the options that choose those.
    """
    choices = list(choices)
    if missing := missing_weights(choices):
        models = (
            f"{name} ({entry.licence}, {entry.size or 'size not known'})" for name, entry in missing.models.items()
        )
        folders = " and ".join(map(str, directories()))
        raise VfoaError(
            f"weights missing in {folders}: {', '.join(models)}; expected: {fetch or missing.fetch}{missing.hint}"
        )
    named_by = {file: choice for choice in reversed(choices) for file in weights_of(choice.settings)}
    located = {}
    for file, choice in sorted(named_by.items()):
        try:
            located[file] = locate(file)
        except VfoaError as error:
            raise VfoaError(": ".join(filter(None, (where, _key_of(file, choice), str(error))))) from None
    return located


def _key_of(file: str, choice: StageChoice) -> str:
    """The dotted key of the setting that names a weights file."""
    keys = (key for key, value in choice.settings if file == value or (isinstance(value, tuple) and file in value))
    return ".".join((choice.slot, *[*keys][:1]))


def _find(file: str) -> Path | None:
    try:
        return locate(file)
    except VfoaError:
        return None
