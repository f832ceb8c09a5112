"""Runs in Rerun's catalogue: each run is a dataset, each clip a segment, each file of its recording a layer.

The recordings are read in place. Two things are added, in a folder that is removed with the server: a layer ``run`` for
each clip, which has properties that the catalogue's table can be sorted by, and the layouts of table and segments.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import rerun as rr
from rerun.blueprint import table

from harness.record.composed import RecordedClip, common_layout, find_clips
from harness.record.reading import RecordingFile
from harness.run.directory import RunDirectory
from harness.run.manifest import RunManifest
from harness.server.local_server import HOST
from vfoa.errors import VfoaError, first_line

if TYPE_CHECKING:
    from rerun.catalog import DatasetEntry
    from rerun.server import Server

RUN = "run"
"""The layer, and the property, of what is known of a clip in its run."""

_FIRST = ("run", "clip", "labelled")
_OF_CONFIGURATION = ("frr", "commonest_error", "settings")
"""Properties that the table shows, in order; the names of the columns are ``property:OWNER:NAME``."""

_LINK = "recording link"
"""A column that the viewer adds: a link that opens the segment."""


class Catalogue(NamedTuple):
    """A server that holds runs: its ``address`` for viewers and clients, and the runs' folders by dataset."""

    address: str
    datasets: dict[str, Path]


@contextmanager
def serving(runs: Sequence[Path], port: int = 0) -> Iterator[Catalogue]:
    """Serve the recordings of runs on 127.0.0.1 until the block ends; port 0 is any free port.

    Raises
    ------
    VfoaError
        If DataFusion is not installed, the port is taken, a run has no recordings, or one of them is damaged.
    """
    if find_spec("datafusion") is None:
        raise VfoaError("catalog: needs the package datafusion; expected vfoa installed with its extra: vfoa[catalog]")
    clips = {run: find_clips(run, None, None) for run in dict.fromkeys(runs)}
    with tempfile.TemporaryDirectory(prefix="vfoa-catalog-") as scratch:
        server = _server(port)
        try:
            names = _names(list(clips))
            for number, (run, name) in enumerate(names.items()):
                folder = Path(scratch) / str(number)
                folder.mkdir()
                _add(server, name, run, clips[run], folder)
            yield Catalogue(server.url(), {name: run for run, name in names.items()})
        finally:
            server.shutdown()


def _server(port: int) -> Server:
    from rerun.server import Server

    try:
        return Server(host=HOST, port=port)
    except (RuntimeError, ValueError, OSError) as error:
        raise VfoaError(f"--port {port}: cannot listen on {HOST}: {first_line(error)}") from None


def _names(runs: Sequence[Path]) -> dict[Path, str]:
    """The name of each run's dataset: its folder's; a second one of that name gets a number."""
    names: dict[Path, str] = {}
    for run in runs:
        name, number = run.resolve().name, 2
        while name in names.values():
            name, number = f"{run.resolve().name}-{number}", number + 1
        names[run] = name
    return names


def _add(server: Server, name: str, run: Path, clips: Sequence[RecordedClip], folder: Path) -> None:
    dataset = server.client().create_dataset(name)
    settings, layers = _settings(RunDirectory(run).read_manifest()), dict[Path, str]()
    for clip in clips:
        by_name = clip.layer_files()
        layers |= {file: layer for layer, file in by_name.items()}
        verdicts = (clip.files.verdicts(each.configuration) for each in clip.layers)
        properties = [RecordingFile(path).properties() for path in verdicts if path.is_file()]
        labelled = max(map(_count, properties), default=0)
        about = {RUN: {"run": name, "clip": clip.files.clip, "labelled": labelled}}
        about |= {name: {"settings": text} for name, text in settings.items() if text}
        layers[_write_properties(folder / f"{clip.files.clip}.rrd", next(iter(by_name.values())), about)] = RUN
    _register(dataset, layers)
    _set_layouts(dataset, clips, folder)


def _count(known: Mapping[str, Any]) -> int:
    """The scored pairs of frame and subject, from the properties of a layer of verdicts."""
    return sum(int(known.get(outcome, 0)) for outcome in ("correct", "wrong"))


def _settings(manifest: RunManifest) -> dict[str, str]:
    """What distinguishes each configuration of a run, as text; empty for a run without a grid."""
    return {
        name: ", ".join(f"{key} = {value}" for key, value in manifest.factors.get(name, {}).items())
        for name in manifest.configurations
    }


def _write_properties(path: Path, recording: Path, about: Mapping[str, Mapping[str, Any]]) -> Path:
    """Write a layer of properties for the recording that the file ``recording`` belongs to."""
    ids = RecordingFile(recording).ids
    with rr.RecordingStream(ids.application, recording_id=ids.recording, send_properties=False) as stream:
        stream.save(path)
        for owner, values in about.items():
            stream.send_property(owner, rr.AnyValues(**values))
    return path


def _register(dataset: DatasetEntry, layers: Mapping[Path, str]) -> None:
    addresses = [file.resolve().as_uri() for file in layers]
    try:
        dataset.register(addresses, layer_name=list(layers.values())).wait()
    except ValueError as error:
        for file in layers:
            RecordingFile(file)  # Rerun names no file: a damaged one is an error here
        raise VfoaError(f"{dataset.name}: Rerun refused its recordings: {first_line(error)}") from None


def _set_layouts(dataset: DatasetEntry, clips: Sequence[RecordedClip], folder: Path) -> None:
    """Set the layouts of the table of all clips, and of a clip."""
    application = str(dataset.id)
    common_layout(clips).save(application, str(folder / "segment.rbl"))
    dataset.register_blueprint((folder / "segment.rbl").resolve().as_uri())
    _table_layout(dataset).save(application, folder / "table.rbl")
    dataset.register_blueprint((folder / "table.rbl").resolve().as_uri(), segment_table=True)


def _table_layout(dataset: DatasetEntry) -> table.TableBlueprint:
    """The properties that a reader compares first; the others, and what Rerun stores of a segment, are hidden."""
    names = dataset.segment_table().schema().names
    owned = [match for name in names if (match := re.fullmatch(r"property:(.+):(\w+)", name))]
    of_configuration = [match for match in owned if match[2] in _OF_CONFIGURATION]
    first = [f"property:{RUN}:{name}" for name in _FIRST]
    sorted_by_kind = sorted(of_configuration, key=lambda match: _OF_CONFIGURATION.index(match[2]))
    columns = [
        table.Column(_LINK, name="open"),
        *(table.Column(source, name=source.rsplit(":", 1)[1]) for source in first),
        *(table.Column(match[0], name=f"{match[1]}: {match[2].replace('_', ' ')}") for match in sorted_by_kind),
    ]
    shown = {column.source for column in columns}
    hidden = [table.Column(name, visible=False) for name in names if name not in shown]
    return table.TableBlueprint(
        table_layout=table.TableLayout(columns=[*columns, *hidden]), sort_by=f"property:{RUN}:clip"
    )
