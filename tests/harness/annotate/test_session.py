"""The clip as the page gets it: outlines, names, a run's predictions, new targets; and its refusals."""

from __future__ import annotations

import os
import shutil
import socket
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from typer.testing import CliRunner

from harness.annotate.actions import Action
from harness.annotate.app import PageServer
from harness.annotate.clip_pictures import colour, head, outline
from harness.annotate.journaled_store import StaleRevisionError
from harness.annotate.session import Session
from harness.cli import app
from harness.clips.manifest import load_manifest
from harness.clips.manifest_text import with_target
from harness.clips.naming import NameRule
from harness.run.directory import RunDirectory
from tests.annotating import MANIFEST
from tests.disk import HEIGHT, WIDTH, write_text
from tests.measured import MANIFEST as MEASURED
from tests.measured import measured_tables
from tests.records import write_manifest
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError
from vfoa.types import Disparity


def test_an_outline_is_the_edge_of_the_mask() -> None:
    mask = np.zeros((40, 60), bool)
    mask[10:30, 20:50] = True
    (polygon,) = outline(mask)
    drawn = cv2.fillPoly(np.zeros(mask.shape, np.uint8), [np.array(polygon)], (1,))
    assert np.array_equal(drawn.astype(bool), mask)


def test_a_clip_without_images_is_refused_with_what_to_do(tmp_path: Path) -> None:
    measured_tables(tmp_path / "data" / "talk")
    manifest = write_text(tmp_path / "datasets" / "talk.toml", MEASURED)
    with pytest.raises(VfoaError) as refused:
        Session(str(manifest))
    assert f"vfoa labels import FILE --clip {manifest} --format FORMAT" in str(refused.value)


def test_a_run_shows_its_boxes_and_names(opened: Any, work: Path) -> None:
    scene = opened(run=work / "run").scene(0)
    names = [each["name"] for each in scene["objects"]]
    assert sorted(names) == ["ann", "book", "clock#4", "cup"]
    boxes = [
        (each["box_px"][2] - each["box_px"][0]) * (each["box_px"][3] - each["box_px"][1]) for each in scene["objects"]
    ]
    assert boxes == sorted(boxes, reverse=True)  # what is small lies on top
    cup = next(each for each in scene["objects"] if each["name"] == "cup")
    assert cup["outline"] == [[[4, 30], [14, 30], [14, 44], [4, 44]]]
    assert scene["heads_px"] == {"ann": (0.0, 0.0, 5.0, 5.0)}


def test_without_a_run_the_clips_own_masks_are_shown_by_the_manifests_names(tmp_path: Path) -> None:
    text = (REPOSITORY / "datasets" / "studio_table.toml").read_text()
    text = text.replace("studio_table", "tabletop").replace("frames = 60", "frames = 1")
    session = Session(str(write_text(tmp_path / "datasets" / "tabletop.toml", text)))
    try:
        scene = session.scene(0)
        assert {each["name"] for each in scene["objects"]} == {"anna", "laptop", "mug", "book", "bottle", "vase"}
        u0, v0, u1, v1 = scene["heads_px"]["anna"]
        assert u0 < u1
        assert v0 < v1
        assert session.picture("head", 0, "anna") is not None
    finally:
        session.close()


def test_a_clip_of_which_nothing_is_known_has_an_empty_scene(opened: Any) -> None:
    assert opened().scene(3) == {"objects": [], "heads_px": {}, "size_px": (WIDTH, HEIGHT)}


def test_the_right_image_is_not_read_for_the_left_one(opened: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Playing reads every frame: a 4K video plays four times as fast without its right images."""
    session = opened()
    monkeypatch.setattr("harness.sources.stereo_pairs.StereoPairs.read", None)
    assert session.picture("left", 3) is not None
    assert session.scene(3)["size_px"] == (WIDTH, HEIGHT)


def test_the_head_is_enlarged_and_cut_at_the_edge() -> None:
    image = np.zeros((100, 200, 3), np.uint8)
    image[:, :20] = 255
    enlarged = head(image, (0.0, 40.0, 20.0, 60.0))
    assert enlarged.shape[0] == 360
    assert enlarged[:, : enlarged.shape[1] // 2].mean() > 250
    assert head(image, (500.0, 500.0, 600.0, 600.0)).max() == 0


def test_unknown_disparity_is_black_and_near_is_not_far() -> None:
    values = np.full((4, 4), np.nan, np.float32)
    assert colour(Disparity(disparity_px=values)).max() == 0
    values = values.copy()
    values[0], values[1] = 5, 50
    shown = colour(Disparity(disparity_px=values))
    assert shown[2:].max() == 0
    assert shown[1, 0, 0] > shown[1, 0, 2]  # near: red
    assert shown[0, 0, 0] < shown[1, 0, 0]


def test_predictions_come_with_their_attention_and_unsure_frames_first(opened: Any, work: Path) -> None:
    about = opened(run=work / "run", uncertain_first=True).about()
    assert about["suggestions"]["ann"][:5] == [("cup", 0.9)] * 2 + [("cup", 0.8), ("cup", 0.3), ("book", 0.9)]
    assert about["suggestions"]["ann"][-1] is None
    assert about["suggestions"]["ben"] == [None] * 12
    assert about["order"]["ann"] == [8, 9, 10, 11, 7, 3, 5, 6, 2, 0, 1, 4]


@pytest.mark.parametrize(("says_nowhere", "suggested"), [(False, None), (True, ("none", 0.0))])
def test_nothing_hit_is_none_only_of_a_method_that_can_say_so(
    opened: Any, work: Path, says_nowhere: bool, suggested: tuple[str, float] | None
) -> None:
    clip = {"name": "noise", "frames": [1], "times_ns": [0], "rate_hz": None}
    method = {"probabilistic": False, "says_nowhere": says_nowhere}
    manifest = {"clips": [clip], "configurations": {"one": {}}, "methods": {"one": method}, "finished": "now"}
    write_manifest(RunDirectory(work / "run"), manifest)
    assert opened(run=work / "run").about()["suggestions"]["ann"][-1] == suggested


def test_the_first_change_writes_down_keys_by_the_old_rule_and_keeps_comments_and_order(work: Path) -> None:
    path = work / "datasets" / "noise.toml"
    path.write_text(with_target(path, "wall clock", NameRule(category="clock", at_px=(1.5, 2))))
    text = path.read_text()
    assert [each for each in text.splitlines() if not each.startswith(("key =", "colour ="))] == [
        *MANIFEST.splitlines(),
        "",
        '[targets."wall clock"]',
        'category = "clock"',
        "at_px = [1.5, 2.0]",
    ]
    manifest = load_manifest(str(path))
    found = {name: (rule.key, rule.colour) for name, rule in {**manifest.targets, **manifest.subjects}.items()}
    assert found == {
        "cup": ("1", "blue plain"),
        "book": ("2", "orange diagonal"),
        "ann": ("3", "green vertical"),
        "ben": ("4", "pink horizontal"),
        "wall clock": ("5", "violet plain"),
    }


def test_a_first_target_opens_the_table_of_targets(tmp_path: Path) -> None:
    text = 'name = "x"\nadapter = "studio"\n\n[subjects.ann]\ncategory = "person"\n'
    path = write_text(tmp_path / "x.toml", text)
    path.write_text(with_target(path, "cup", NameRule(category="cup")))
    assert path.read_text().startswith(text)
    (rule,) = load_manifest(str(path)).targets.values()
    assert (rule.category, rule.key) == ("cup", "2")  # ann, who is a target as well, has the first


@pytest.mark.parametrize(
    ("name", "rule", "found"),
    [
        ("cup", NameRule(category="clock"), "targets.cup: exists already"),
        ("none", NameRule(category="clock"), "found the name 'none'"),
        ("no prediction", NameRule(category="clock"), "found the name 'no prediction'"),
        ("ann", NameRule(category="clock"), "a subject has this name"),
        (" ", NameRule(category="clock"), "found the name ' '"),
        ("mug", NameRule(category="cup"), "every 'cup' is 'cup' already"),
    ],
)
def test_a_target_that_the_manifest_cannot_have_is_not_written(
    work: Path, name: str, rule: NameRule, found: str
) -> None:
    path = work / "datasets" / "noise.toml"
    with pytest.raises(VfoaError, match=found):
        path.write_text(with_target(path, name, rule))
    assert path.read_text() == MANIFEST


def test_labels_of_a_target_that_the_manifest_has_no_longer_are_shown_and_can_be_changed(
    opened: Any, work: Path
) -> None:
    session = opened()
    session.make(Action(kind="range", subject="ann", at=0, last=3, target="book"))
    session.close()
    manifest = work / "datasets" / "noise.toml"
    manifest.write_text(manifest.read_text().replace('[targets.book]\ncategory = "book"\n', ""))
    session = opened()
    about = session.about()
    assert "noise.csv has labels of book, which noise.toml does not have" in about["notice"]
    assert "book" in about["names"]
    assert "book" in about["looks"]
    session.make(Action(kind="range", subject="ann", at=0, last=3, target="cup"))
    session.close()
    assert opened().about()["notice"] is None


@pytest.mark.parametrize(
    ("choices", "found"),
    [
        ({"annotator": "../ann"}, "expected a name of letters, digits"),
        ({"configuration": "one"}, "need --run"),
        ({"uncertain_first": True}, "need --run"),
        ({"run": "run", "configuration": "oen"}, r"'oen'.*'one'"),
        ({"run": "run", "blind": True, "uncertain_first": True}, "--blind shows nothing"),
        ({"run": "elsewhere"}, "elsewhere: expected a run's directory"),
    ],
)
def test_wrong_choices_are_one_line(opened: Any, work: Path, choices: dict[str, Any], found: str) -> None:
    with pytest.raises(VfoaError, match=found):
        opened(**{**choices, **({"run": work / choices["run"]} if "run" in choices else {})})


def test_a_clip_in_which_nobody_looks_is_refused(work: Path) -> None:
    path = work / "datasets" / "noise.toml"
    path.write_text(MANIFEST.replace("subjects.ann", "targets.ann").replace("subjects.ben", "targets.ben"))
    with pytest.raises(VfoaError, match="found no subject"):
        Session(str(path))


def test_a_port_that_is_taken_is_one_line(opened: Any) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(VfoaError, match=r"--port .*: cannot listen on 127"):
            PageServer(opened(), taken.getsockname()[1])


def test_the_server_listens_on_this_machine_alone(opened: Any) -> None:
    server = PageServer(opened())
    try:
        assert server.address.startswith(f"http://127.0.0.1:{server.port}/?token=")
        with pytest.raises(OSError, match="refused"), socket.create_connection(("127.0.0.2", server.port), timeout=5):
            pass
    finally:
        server.close()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_is_one_line(work: Path) -> None:
    (work / "annotations").mkdir(mode=0o500)
    with pytest.raises(VfoaError, match="cannot be written"):
        Session(str(work / "datasets" / "noise.toml"))


def test_the_verb_says_what_is_wrong_before_it_serves(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(work)
    shutil.rmtree(work / "pairs")
    result = CliRunner().invoke(app, ["annotate", "noise", "--no-open"])
    assert isinstance(result.exception, VfoaError)
    assert "noise.toml" in str(result.exception)


@pytest.mark.parametrize("kind", ["look", "clear", "undo", "redo"])
def test_a_change_made_on_an_older_state_is_refused(opened: Any, kind: str) -> None:
    session = opened()
    session.make(Action(kind="look", subject="ann", target="cup"))
    before = session.path.read_bytes()
    with pytest.raises(StaleRevisionError):
        session.make_all([Action(kind=kind, subject="ann", target="book")], 1, 1)
    assert session.path.read_bytes() == before


def test_a_lost_answer_does_not_hide_what_another_tab_has_changed(opened: Any) -> None:
    session = opened()
    made, later = (Action(kind="look", id=name, subject="ann", target="cup", at=at) for at, name in enumerate("ab"))
    session.make_all([made], 1, 1)
    session.make(Action(kind="look", id="c", subject="ann", target="book", at=1))
    before = session.path.read_bytes()
    with pytest.raises(StaleRevisionError):
        session.make_all([made, later], 1, 1)
    assert session.path.read_bytes() == before
