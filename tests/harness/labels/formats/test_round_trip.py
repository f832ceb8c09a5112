"""Exported labels are imported again as the same ranges, in every format, at any rate and offset."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.labels.formats import FORMATS, SUFFIXES
from harness.labels.labels import Labels
from tests.exchanges import FRAMES, PlainClip, exchange, labels_of, row


def _again(name: str, path: Path, labels: Labels, **how: object) -> Labels:
    chosen = FORMATS.load(name)()
    assert chosen.write(path, labels, exchange(**how)) == ()  # type: ignore[arg-type]
    first = path.read_bytes()
    imported = chosen.read(path, exchange(**how))  # type: ignore[arg-type]
    assert all("--fps" in note for note in imported.notes)
    chosen.write(path, imported.labels, exchange(**how))  # type: ignore[arg-type]
    assert path.read_bytes() == first
    return imported.labels


@pytest.mark.parametrize("name", SUFFIXES)
@given(
    frames=FRAMES,
    rate=st.sampled_from([10.0, 24.0, 25.0, 29.97, 60.0, 120.0]),
    start_ns=st.sampled_from([0, 1_763_680_000_123_456_789]),
    fps=st.none() | st.sampled_from([24.0, 30.0]),
    offset=st.sampled_from([0.0, 0.0417, 12.5, 3600.0]),
    data=st.data(),
)
def test_formats_of_times(
    name: str,
    tmp_path: Path,
    frames: list[int],
    rate: float,
    start_ns: int,
    fps: float | None,
    offset: float,
    data: st.DataObject,
) -> None:
    clip = PlainClip(frames=frames, rate_hz=rate, start_ns=start_ns)
    labels = data.draw(labels_of(frames, notes=True, points=True, tags=True, suggested=True))
    times = {} if name == "csv" else {"fps": fps, "offset": offset}  # it has the clip's own
    assert _again(name, tmp_path / f"labels{SUFFIXES[name]}", labels, clip=clip, **times) == labels


@pytest.mark.parametrize("name", SUFFIXES)
def test_names_are_exchanged_and_left_out_in_every_format(name: str, tmp_path: Path) -> None:
    chosen, path = FORMATS.load(name)(), tmp_path / f"labels{SUFFIXES[name]}"
    chosen.write(path, Labels([row(1, 1, "cup"), row(1, 1, "bird", "boy"), row(2, 2, "none", "boy")]), exchange())
    renamed = {"girl": "boy", "boy": "girl", "cup": "bird", "bird": "cup", "none": ""}
    imported = chosen.read(path, exchange(renamed=renamed))
    assert imported.labels == Labels([row(1, 1, "cup"), row(1, 1, "bird", "boy")])
    assert [note.partition(": ")[2] for note in imported.notes] == ["left out: 1 label of 'none' (--rename)."]
