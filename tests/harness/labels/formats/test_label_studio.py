"""Regions of Label Studio's timelines and sound, in the form of its documents."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from harness.labels.formats.exchange import Imported
from harness.labels.formats.label_studio import LabelStudio
from harness.labels.labels import Labels
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, row
from vfoa.errors import VfoaError

TEN = PlainClip(frames=range(1, 11))
"""Frame n is shown at (n - 1) / 25 s."""


def _region(first: int, last: int, *targets: str, tag: str = "girl") -> dict[str, Any]:
    value = {"ranges": [{"start": first, "end": last}], "timelinelabels": [*targets]}
    return {
        "id": "a",
        "type": "timelinelabels",
        "origin": "manual",
        "from_name": tag,
        "to_name": "video",
        "value": value,
    }


def _sound(start_s: float | str, end_s: float | str, target: str) -> dict[str, Any]:
    value = {"start": start_s, "end": end_s, "channel": 0, "labels": [target]}
    return {"original_length": 10.1, "type": "labels", "from_name": "girl", "to_name": "audio", "value": value}


def _task(
    *regions: Any, film: str = "/data/upload/1/3d3ad63e-talk.mp4", number: int = 7, **more: Any
) -> dict[str, Any]:
    annotations = [{"id": number, "completed_by": 1, "result": [*regions], "lead_time": 3.2, **more}]
    return {"id": 1, "data": {"title": "A talk", "video": film}, "annotations": annotations, "predictions": []}


def _read(folder: Path, tasks: Any, clip: PlainClip = TEN, **options: Any) -> Imported:
    path = write_text(folder / "project-1.json", json.dumps(tasks))
    return LabelStudio().read(path, exchange(clip, **{"fps": 25, **options}))


@pytest.mark.parametrize(
    ("fps", "regions", "expected"),
    [
        (25, [_region(1, 3, "bird"), _region(4, 10, "cup")], [(1, 3, "bird"), (4, 10, "cup")]),
        (12.5, [_region(1, 2, "bird"), _region(3, 5, "cup")], [(1, 3, "bird"), (4, 9, "cup")]),
        (50, [_region(1, 6, "bird"), _region(7, 20, "none")], [(1, 3, "bird"), (4, 10, "none")]),
        (
            25,
            [_region(2, 2, "bird", tag="girl"), _region(1, 10, "cup", tag="boy")],
            [(2, 2, "bird"), (1, 10, "cup", "boy")],
        ),
        (None, [_sound(0.0, 0.12, "bird"), _sound(0.12, 0.4, "cup")], [(1, 3, "bird"), (4, 10, "cup")]),
    ],
)
def test_frames_are_those_of_label_studio_s_rate_and_seconds_those_of_the_film(
    tmp_path: Path, fps: float | None, regions: Sequence[Any], expected: Sequence[Any]
) -> None:
    imported = _read(tmp_path, [_task(*regions)], fps=fps)
    assert imported.labels == Labels([row(*each) for each in expected])
    assert imported.notes == ()


@pytest.mark.parametrize("region", [_region(1607, 1608, "bird"), _sound(64.24, 64.32, "bird")])
def test_times_are_read_to_the_millisecond(tmp_path: Path, region: dict[str, Any]) -> None:
    """As a floating point number, 64.24 s is a little less than so many milliseconds."""
    imported = _read(tmp_path, [_task(region)], PlainClip(frames=range(2000)))
    assert imported.labels == Labels([row(1606, 1607, "bird")])


def test_a_frame_that_ends_one_range_and_begins_the_next_has_the_next_one_s_label(tmp_path: Path) -> None:
    """Drawn from where the last one ended, as scripts that make predictions of seconds write them, too."""
    regions = [_region(4, 7, "cup"), _region(1, 4, "bird"), _region(7, 10, "none"), _region(4, 10, "cup", tag="boy")]
    imported = _read(tmp_path, [_task(*regions)])
    expected = [row(1, 3, "bird"), row(4, 6, "cup"), row(7, 10, "none"), row(4, 10, "cup", "boy")]
    assert imported.labels == Labels(expected)
    (note,) = imported.notes
    assert "2 frames" in note
    left_out = {"girl:none": "", "cup": "bird"}
    assert _read(tmp_path, [_task(*regions)], renamed=left_out).labels == Labels(
        [row(1, 3, "bird"), row(4, 7, "bird"), row(4, 10, "bird", "boy")]
    )
    for overlapping in ([_region(1, 5, "bird"), _region(4, 7, "cup")], [_region(4, 4, "bird"), _region(4, 7, "cup")]):
        with pytest.raises(VfoaError, match="'girl' has two labels in frame 4"):
            _read(tmp_path, [_task(*overlapping)])


def test_the_rate_of_label_studio_s_frames_is_asked_for(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"--fps: found None; expected the frameRate of Label Studio's Video tag"):
        _read(tmp_path, [_task(_region(1, 3, "bird"))], fps=None)


def test_the_film_and_the_annotator_are_chosen(tmp_path: Path) -> None:
    task = _task(_region(1, 10, "bird"))
    task["annotations"] += _task(_region(1, 10, "cup"), number=8)["annotations"]
    task["annotations"] += _task(_region(1, 10, "none"), number=9, was_cancelled=True)["annotations"]
    tasks = [task, _task(_region(1, 10, "none"), film="s3://films/other.mp4")]
    with pytest.raises(VfoaError, match=r"found the films talk\.mp4, other\.mp4; expected --film"):
        _read(tmp_path, tasks)
    with pytest.raises(VfoaError, match="found the annotations 7, 8; expected one, or --observation ID"):
        _read(tmp_path, tasks, films={"talk.mp4": 0.0})
    imported = _read(tmp_path, tasks, film="talk.mp4", observation="8")
    assert imported.labels == Labels([row(1, 10, "cup")])
    assert imported.notes == (f"{tmp_path / 'project-1.json'}: left out: 1 task of other films.",)
    alone = [_task(_region(1, 10, "bird")), _task(_region(1, 10, "none"), film="other.mp4", number=8)]
    assert _read(tmp_path, alone, film="talk.mp4").labels == Labels([row(1, 10, "bird")])
    with pytest.raises(VfoaError, match="--observation: no annotation '9'"):
        _read(tmp_path, tasks, film="talk.mp4", observation="9")


def test_a_task_of_cloud_storage_and_other_regions(tmp_path: Path) -> None:
    box = {"sequence": [{"frame": 1, "x": 1.5}], "labels": ["cup"], "framesCount": 10, "duration": 0.4}
    choice = {"type": "choices", "from_name": "quality", "to_name": "video", "value": {"choices": ["good"]}}
    words = {"start": "0", "end": "4", "text": "a cup", "labels": ["cup"]}
    said = {"start": 0.1, "end": 0.2, "channel": 0, "text": ["hm"]}
    others = (("videorectangle", "box", box), ("labels", "girl", words), ("textarea", "girl", said))
    more = [{"type": kind, "from_name": name, "value": value} for kind, name, value in others]
    regions = [_region(1, 10, "bird"), *more, choice]
    imported = _read(tmp_path, _task(*regions, film="/data/local-files/?d=films/talk.mp4"), films={"talk.mp4": 0.0})
    assert imported.labels == Labels([row(1, 10, "bird")])
    assert [note.partition(": ")[2] for note in imported.notes] == [
        "left out: 4 regions not of a timeline or of sound."
    ]


@pytest.mark.parametrize(
    ("tasks", "message"),
    [
        ([{"video": "talk.mp4", "girl": []}], "expected what Label Studio exports as JSON"),
        ([_task(_region(1, 3, "bird", "cup"))], "'bird, cup'"),
        ([_task(_region(1, 3, "bird", tag="videoLabels"))], "no tag is named after a subject; found 'videoLabels'"),
        ([_task(_region(3, 1, "bird"))], "before it begins"),
        ([_task(_sound("0", "1", "bird"))], "found '0' to '1'; expected seconds"),
        ([_task(_sound("0", 1.0, "bird"))], "found '0' to 1.0; expected seconds"),
        ([_task(_sound(0.0, "1", "bird"))], "found 0.0 to '1'; expected seconds"),
        ([_task(_region(-(10**15), 1, "bird"))], "expected times in a film"),
        ([_task({"type": "timelinelabels", "value": {"ranges": [{"start": 1}]}})], "missing required field"),
        ([_task(_region(1, 10**15, "bird"))], "expected times in a film"),
        ([_task({"type": "choices", "value": {}}, film="/data/upload/1/0a1b2c3d-000001.png")], "--format table"),
    ],
)
def test_what_is_no_label_is_named(tmp_path: Path, tasks: Any, message: str) -> None:
    with pytest.raises(VfoaError, match=message) as error:
        _read(tmp_path, tasks)
    assert str(error.value).startswith(str(tmp_path / "project-1.json"))
