"""What scoring keeps between two times, so that only what has changed is read: ``score_cache/`` in a run's directory.

    index.json      the blocks of results.jsonl, each with the digest of its lines
    <key>.part      what the logs have of a block; the key is of its lines, its labels and the code

All of it can be removed at any time. Lines are digested anew by each scoring, and a part that is damaged is made anew.
"""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec

import harness
import vfoa
from harness.files import atomic_write, file_digest, replacing
from harness.report.record_logs import Part, RecordLogs
from harness.run.results import Block, block_bytes, find_blocks, lines_digest, read_block
from harness.score.finished_run import FinishedRun
from harness.score.reference import Reference

FOLDER = "score_cache"
_CHECKSUM_BYTES = 16
_log = logging.getLogger(__name__)


class KeptParts:
    """The blocks of a run's results, and the parts of the logs that belong to them under a reference."""

    def __init__(self, run: FinishedRun, reference: Reference, probabilistic: Sequence[str]) -> None:
        self._results = run.directory.results
        self._folder = run.directory.path / FOLDER
        self._reference, self._probabilistic = reference, probabilistic
        self._labels: dict[tuple[str, tuple[int, ...]], str] = {}
        blocks = _indexed(self._results, self._folder / "index.json")
        self._scored = [(block, self._key(block)) for block in run.scored_blocks(blocks)]

    def logs(self) -> RecordLogs:
        """The logs of all blocks. What was made anew is kept, what nobody needs any more is removed."""
        logs = RecordLogs(self._reference, self._probabilistic)
        for block, key in self._scored:
            path = self._folder / f"{key}.part"
            part = _load(path)
            if part is None:
                part = self._watched(block)
                _save(path, part)
            logs.add(block.clip, block.configuration, part)
        needed = {key for _, key in self._scored}
        for path in self._folder.glob("*.part"):
            if path.stem not in needed:
                path.unlink(missing_ok=True)
        return logs

    def _watched(self, block: Block) -> Part:
        logs = RecordLogs(self._reference, self._probabilistic)
        logs.watch(read_block(self._results, block))
        return logs.part(block.clip, block.configuration)

    def _key(self, block: Block) -> str:
        name = block.configuration
        of = (
            *(block.digest, self._labelled(block)),
            *(name in self._reference.says_nowhere, name in self._probabilistic, _code_digest()),
        )
        return hashlib.blake2b(repr(of).encode(), digest_size=16).hexdigest()

    def _labelled(self, block: Block) -> str:
        """The digest of the labels in a block's frames; configurations have the same frames as a rule."""
        key = block.clip, block.frames
        if key not in self._labels:
            labels = self._reference.labels.get(block.clip)
            found = list(labels.labelled(block.frames)) if labels else None
            self._labels[key] = hashlib.blake2b(repr(found).encode(), digest_size=16).hexdigest()
        return self._labels[key]


def _indexed(results: Path, index: Path) -> list[Block]:
    """The blocks of the results: as the index has them, if every line is the same, or cut anew."""
    try:
        blocks = msgspec.json.decode(index.read_bytes(), type=list[Block])
    except (OSError, msgspec.DecodeError):
        blocks = []
    size = results.stat().st_size if results.is_file() else None
    if blocks and blocks[-1].end == size and all(_is_unchanged(results, block) for block in blocks):
        return blocks
    blocks = find_blocks(results)
    atomic_write(index, msgspec.json.encode(blocks))
    return blocks


def _is_unchanged(results: Path, block: Block) -> bool:
    return lines_digest(block_bytes(results, block)) == block.digest


def _load(path: Path) -> Part | None:
    try:
        content = path.read_bytes()
    except OSError:
        return None
    body = memoryview(content)[_CHECKSUM_BYTES:]
    if hashlib.blake2b(body, digest_size=_CHECKSUM_BYTES).digest() == content[:_CHECKSUM_BYTES]:
        return _codec()[1].decode(body)
    _log.warning("%s: damaged; its records are read again", path)
    return None


def _save(path: Path, part: Part) -> None:
    """Keep a part. It is not forced to the disk: what a power cut spoils, its checksum tells."""
    body = _codec()[0].encode(part)
    with replacing(path) as draft:
        draft.write_bytes(hashlib.blake2b(body, digest_size=_CHECKSUM_BYTES).digest() + body)


@cache
def _codec() -> tuple[msgspec.msgpack.Encoder, msgspec.msgpack.Decoder[Any]]:
    return msgspec.msgpack.Encoder(), msgspec.msgpack.Decoder(Part)


@cache
def _code_digest() -> str:
    """The digest of all code of both packages: a part of another version is made anew."""
    total = hashlib.blake2b(digest_size=16)
    for package in (harness, vfoa):
        root = Path(package.__file__ or "").parent
        for path in sorted(root.rglob("*.py")):
            total.update(f"{path.relative_to(root).as_posix()} {file_digest(path)}\n".encode())
    return total.hexdigest()
