from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from harness.report.thumbnails import Thumbnails, lines_path, picture_path, read_thumbnails
from harness.report.thumbnails.writer import PictureWriter, ThumbnailWriter, picture, thumbnail
from harness.run.directory import Pair
from harness.score.reference import Reference
from tests.harness.record.conftest import ANN, EYES, Shown, shared, show
from tests.records import labels, score
from vfoa.errors import VfoaError
from vfoa.geometry import project

ALL = (1, 2, 3, 4)


@pytest.fixture
def shown() -> list[Shown]:
    return [show(frame, things=ALL, gaze_at=4) for frame in range(1, 7)]


@pytest.fixture
def run(tmp_path: Path, shown: list[Shown]) -> Path:
    """A run whose thumbnails two configurations have written."""
    for configuration in ("one", "two cones"):
        _write(tmp_path, shown, configuration)
    return tmp_path


def _write(run: Path, shown: Iterable[Shown], configuration: str) -> None:
    with PictureWriter(run, "clip") as pictures, ThumbnailWriter(run, "clip", configuration) as writer:
        for each in shown:
            pictures.write(shared({configuration: each}))
            writer.write(each.finished)


def _wrong(shown: list[Shown], *truth: str) -> dict[Pair, set[int]]:
    return score((each.record for each in shown), Reference(labels={"clip": labels(*truth, subject=ANN)})).wrong_frames


def _of(thumbnails: Thumbnails) -> list[int]:
    return [frame for _, frame in thumbnails.pictures]


def test_what_is_drawn_lies_where_the_image_has_it(shown: list[Shown]) -> None:
    rig = shown[0].frame.rig
    seen = thumbnail(rig, shown[0].result, shown[0].record)
    assert seen.size == (rig.width_px, rig.height_px)
    assert [name for _, name, _ in seen.boxes] == ["Ann Müller/left", "red cup", "red cup", "book#4"]
    assert seen.boxes[1][2] == (20, 20, 39, 39)
    (ann,) = seen.subjects
    assert (ann.name, ann.head) == (ANN, (2, 20, 18, 34))
    eyes = [round(each) for each in project(EYES, rig)]
    assert {cue for cue, _ in ann.lines} == {"gaze", "head"}
    for _, line in ann.lines:
        assert eyes in np.reshape(line, (-1, 2)).tolist()


def test_a_wide_image_and_all_that_is_drawn_over_it_are_made_small_alike(shown: list[Shown]) -> None:
    rig = replace(shown[0].frame.rig, width_px=1440, height_px=810)
    seen = thumbnail(rig, shown[0].result, shown[0].record)
    small = Image.open(io.BytesIO(picture(np.zeros((810, 1440, 3), dtype=np.uint8))))
    assert seen.size == small.size == (360, 202)
    assert seen.boxes[1][2] == (5, 5, 10, 10)


def test_a_line_that_passes_the_camera_is_left_out(shown: list[Shown]) -> None:
    near = shown[0].result.attentions[0]
    person = replace(near.subject.person, eye_origin_left=np.array([0.0, 0.0, 0.25]))
    towards = replace(person.view.head_pose, direction=np.array([0.0, 0.0, -1.0]))
    subject = replace(near.subject, person=person, head_pose=towards)
    result = replace(shown[0].result, attentions=(replace(near, subject=subject, cast=None),))
    (ann,) = thumbnail(shown[0].frame.rig, result, shown[0].record).subjects
    assert [cue for cue, _ in ann.lines] == ["gaze"]


def test_wrong_frames_have_their_picture_and_what_was_seen(run: Path, shown: list[Shown]) -> None:
    # the answer is the book in every frame
    wrong = _wrong(shown, "red cup", "book#4", "red cup", "ignore", "none", "book#4")
    thumbnails = read_thumbnails(run, wrong)
    assert _of(thumbnails) == [1, 3, 5]
    assert list(thumbnails.seen) == [("clip", "two cones", frame) for frame in (1, 3, 5)]
    assert thumbnails.wrong == 3
    for frame, uri in zip(_of(thumbnails), thumbnails.pictures.values(), strict=True):
        assert uri.startswith("data:image/webp;base64,")
        drawn = np.asarray(Image.open(picture_path(run, "clip", frame)).convert("L"), dtype=float)
        left = shown[frame - 1].frame.left.mean(axis=2)
        assert np.corrcoef(drawn.ravel(), left.ravel())[0, 1] > 0.8


def test_labels_that_are_edited_later_find_other_pictures(run: Path, shown: list[Shown]) -> None:
    assert _of(read_thumbnails(run, _wrong(shown, *["book#4"] * 6))) == []
    assert _of(read_thumbnails(run, _wrong(shown, "book#4", "red cup"))) == [2]


def test_as_many_as_fit_are_chosen_evenly(run: Path, shown: list[Shown]) -> None:
    wrong = _wrong(shown, *["red cup"] * 6)
    whole = read_thumbnails(run, wrong)
    weight = sum(map(len, whole.pictures.values()))
    some = read_thumbnails(run, wrong, budget=weight * 2 // 3)
    assert (_of(whole), _of(some), some.wrong) == ([1, 2, 3, 4, 5, 6], [1, 3, 5], 6)
    assert sum(map(len, some.pictures.values())) <= weight * 2 // 3


def test_the_same_run_has_the_same_stills(tmp_path: Path, shown: list[Shown]) -> None:
    found: list[dict[str, bytes]] = []
    for name in ("a", "b"):
        _write(tmp_path / name, shown, "one")
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        found.append({str(path.relative_to(tmp_path / name)): path.read_bytes() for path in files})
    assert found[0] == found[1]
    assert len(found[0]) == 7


def test_a_run_that_is_broken_off_leaves_no_lines_that_look_whole(tmp_path: Path, shown: list[Shown]) -> None:
    def broken() -> Iterator[Shown]:
        yield shown[0]
        raise RuntimeError

    with pytest.raises(RuntimeError):
        _write(tmp_path, broken(), "one")
    assert not lines_path(tmp_path, "clip", "one").exists()


def test_a_run_without_stills_has_none(tmp_path: Path, shown: list[Shown]) -> None:
    assert read_thumbnails(tmp_path, _wrong(shown, "red cup")) == Thumbnails()


@pytest.mark.parametrize("line", [b"{}\n", b'{"frame":"1"}\n', b"not JSON\n", b'{"frame":1}\n'])
def test_a_damaged_file_is_named(run: Path, shown: list[Shown], line: Any) -> None:
    lines_path(run, "clip", "two cones").write_bytes(line)
    with pytest.raises(VfoaError, match=r"clip__two cones\.jsonl: "):
        read_thumbnails(run, _wrong(shown, "red cup"))


def test_a_picture_that_cannot_be_written_leaves_no_draft(
    tmp_path: Path, shown: list[Shown], monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "write_bytes", fail)
    with pytest.raises(OSError, match="disk full"):
        _write(tmp_path, shown, "one")
    assert list(picture_path(tmp_path, "clip", 1).parent.iterdir()) == []
