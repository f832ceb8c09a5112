"""Targets that come, go and are renamed while a clip is being labelled: the keys of the others do not move."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from harness.annotate.actions import Action
from harness.annotate.drawing_store import Draw
from harness.annotate.session import Session
from harness.clips.manifest import ClipManifest, load_manifest
from harness.clips.naming import NameRule
from harness.labels.files import write_annotations
from harness.labels.labels import Labels, Timeline
from tests.annotating import FRAMES, MANIFEST, Page, shown, wait_for
from tests.disk import write_text
from vfoa.errors import VfoaError

if TYPE_CHECKING:
    from selenium.webdriver import Chrome

HEAD = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"


def _manifest(work: Path) -> ClipManifest:
    return load_manifest(str(work / "datasets" / "noise.toml"))


def _labels(work: Path, annotator: str | None = None) -> Labels:
    manifest = _manifest(work)
    found = manifest.annotations.find(annotator)
    assert found is not None
    return manifest.read(found, Timeline(frames=FRAMES, times_ns=()))


def _said(work: Path, subject: str = "ann", annotator: str | None = None) -> str:
    """A letter a frame."""
    found = [_labels(work, annotator).at(frame, subject) for frame in FRAMES]
    return "".join("." if each is None else each.target[0] for each in found)


def _mark(session: Session, first: int, last: int, target: str, subject: str = "ann") -> None:
    session.make(Action(kind="range", subject=subject, at=first, last=last, target=target))


def test_a_new_name_is_in_the_labels_of_all_annotators(opened: Any, work: Path) -> None:
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ann,cup,\n")
    session = opened()
    _mark(session, 0, 5, "cup")
    _mark(session, 2, 3, "book")
    session.change_target("cup", new_name="mug", key="9", colour="olive plain")
    assert (_said(work), _said(work, annotator="ben")) == ("mmbbmm......", "mmmm........")
    about = session.about()
    assert about["looks"]["mug"] == {"key": "9", "colour": "olive plain"}
    assert {name: look["key"] for name, look in about["looks"].items()} == {
        "mug": "9",
        "book": "2",
        "ann": "3",
        "ben": "4",
    }


def test_a_target_in_use_is_deleted_only_with_another_for_its_labels(opened: Any, work: Path) -> None:
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ben,cup,\n")
    session = opened()
    with pytest.raises(VfoaError, match="'cup' is the target of 4 labels"):
        session.delete_target("cup", None)
    with pytest.raises(VfoaError, match="'ben' looks at 'cup' and would look at 'ben'"):
        session.delete_target("cup", "ben")
    assert (work / "datasets" / "noise.toml").read_text() == MANIFEST
    session.delete_target("cup", "book")
    assert _said(work, "ben", "ben") == "bbbb........"
    assert [*_manifest(work).targets] == ["book"]
    session.add_target("vase", _manifest(work).targets["book"].model_copy(update={"category": "vase", "key": None}))
    assert session.about()["looks"]["vase"]["key"] == "1"  # the one that is free
    assert session.about()["looks"]["book"]["key"] == "2"


def test_one_history_takes_back_labels_targets_and_drawing(opened: Any, work: Path) -> None:
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ann,cup,\n")
    session = opened()

    def shown() -> tuple[object, ...]:
        drawn = [each["name"] for each in session.drawn()["tracks"]]
        looks = {name: (look["key"], look["colour"]) for name, look in session.about()["looks"].items()}
        return _said(work), _said(work, annotator="ben"), drawn, looks, [*session.manifest.targets]

    def draw() -> None:
        session.make(Action(kind="draw", draw=Draw(name="cup", place=(1, 1, 9, 9))))

    pen = NameRule(category="pen")
    steps: list[Callable[[], None]] = [
        lambda: _mark(session, 0, 5, "cup"),
        draw,
        lambda: session.change_target("cup", new_name="mug", key="9", colour="olive plain"),
        lambda: _mark(session, 2, 3, "book"),
        lambda: session.add_target("pen", pen),
        lambda: session.change_target("book", new_name="book", key="8", colour="pink plain"),
        lambda: session.delete_target("mug", "book"),
    ]
    states = [shown() if (work / "annotations" / "noise.csv").exists() else None]
    for step in steps:
        step()
        states.append(shown())
    for expected in reversed(states[1:-1]):
        session.step_back("undo")
        assert shown() == expected
    for expected in states[2:]:
        session.step_back("redo")
        assert shown() == expected
    session.close()
    session = opened()
    assert shown() == states[-1]
    session.step_back("undo")
    assert shown() == states[-2]  # also after a restart


def test_a_target_that_another_annotator_uses_by_now_stays(opened: Any, work: Path) -> None:
    session = opened()
    session.add_target("pen", NameRule(category="pen"))
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ann,pen,\n")
    with pytest.raises(VfoaError, match=r"noise@ben\.csv has labels of 'pen'"):
        session.step_back("undo")
    assert "pen" in _manifest(work).targets
    path = work / "datasets" / "noise.toml"
    (work / "annotations" / "noise@ben.csv").unlink()
    path.write_text(path.read_text() + "# edited\n")
    with pytest.raises(VfoaError, match=r"noise\.toml was edited"):
        session.step_back("undo")
    assert not session.state()["can_undo"]
    assert path.read_text().endswith("# edited\n")


def _draw(session: Session, name: str, at: int) -> None:
    session.make(Action(kind="draw", draw=Draw(name=name, at=at, place=(1, 1, 9, 9))))


def _rename(session: Session) -> None:
    session.change_target("cup", new_name="mug", key="9", colour="olive plain")


def _delete(session: Session) -> None:
    session.delete_target("cup", "book")


@pytest.mark.parametrize("restart", [False, True])
def test_undo_takes_back_the_newest_change_also_after_the_clock_was_set_back(
    opened: Any, work: Path, monkeypatch: pytest.MonkeyPatch, restart: bool
) -> None:
    session, clock = opened(), iter((4000.0, 3000.0, 2000.0, 1000.0))

    def change(make: Callable[[], None]) -> None:
        nonlocal session
        if restart:
            session.close()
            session = opened()
        now = next(clock)
        with monkeypatch.context() as patch:
            patch.setattr("time.time", lambda: now)
            make()

    def shown() -> tuple[str, int]:
        return _said(work), len(session.drawn()["tracks"])

    change(lambda: _mark(session, 0, 3, "cup"))
    change(lambda: _draw(session, "cup", 0))
    change(lambda: _mark(session, 4, 7, "book"))
    change(lambda: _draw(session, "book", 0))
    states = [("cccc........", 0), ("cccc........", 1), ("ccccbbbb....", 1), ("ccccbbbb....", 2)]
    assert shown() == states[-1]
    for expected in reversed(states[:-1]):
        session.step_back("undo")
        assert shown() == expected
    for expected in states[1:]:
        session.step_back("redo")
        assert shown() == expected


@pytest.mark.parametrize(("change", "given"), [(_rename, "m"), (_delete, "b")])
@pytest.mark.parametrize(("annotator", "other"), [(None, "ben"), ("ben", None)])
def test_undo_leaves_labels_that_another_annotator_made_since(
    opened: Any, work: Path, change: Callable[[Session], None], given: str, annotator: str | None, other: str | None
) -> None:
    for name in ("noise", "noise@ben"):
        write_text(work / "annotations" / f"{name}.csv", f"{HEAD}1,8,ann,cup,\n")
    session = opened(annotator=annotator)
    change(session)
    session.close()
    session = opened(annotator=other)
    _mark(session, 0, 3, "none")
    session.make(Action(kind="note", subject="ann", at=6, note="glasses"))
    session.close()
    session = opened(annotator=annotator)
    session.step_back("undo")
    assert (_said(work, annotator=annotator), _said(work, annotator=other)) == ("cccccccc....", "nnnncccc....")
    label = _labels(work, other).at(7, "ann")
    assert label is not None
    assert (label.target, label.note) == ("cup", "glasses")
    session.step_back("redo")
    assert (_said(work, annotator=annotator), _said(work, annotator=other)) == (
        f"{given * 8}....",
        f"nnnn{given * 4}....",
    )


def test_undo_is_refused_where_another_annotator_has_used_a_name_since(opened: Any, work: Path) -> None:
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ann,cup,\n")
    session = opened()
    _mark(session, 0, 5, "cup")
    _rename(session)
    session.close()
    session = opened(annotator="ben")
    _mark(session, 2, 7, "mug")
    session.close()
    session = opened()
    files = {path: path.read_bytes() for path in (work / "annotations").glob("*.csv")}
    with pytest.raises(VfoaError, match=r"noise@ben\.csv has labels of 'mug' that were made since \(4 frames\)"):
        session.step_back("undo")
    assert {path: path.read_bytes() for path in (work / "annotations").glob("*.csv")} == files
    assert "mug" in _manifest(work).targets
    assert session.state()["can_undo"]


@pytest.mark.parametrize("change", [_rename, _delete])
def test_undo_leaves_shapes_that_were_drawn_since(opened: Any, work: Path, change: Callable[[Session], None]) -> None:
    session = opened()
    _draw(session, "cup", 0)
    change(session)
    path = work / "annotations" / "noise.drawn.csv"
    path.write_text(path.read_text() + "2,book,box,5,5,20,20,\n")  # by another program: no step to undo
    session.step_back("undo")
    assert [each["name"] for each in session.drawn()["tracks"]] == ["book", "cup"]
    session.step_back("redo")
    assert "book" in [each["name"] for each in session.drawn()["tracks"]]


@pytest.mark.parametrize("change", [_rename, _delete])
@pytest.mark.parametrize("kind", ["undo", "redo"])
def test_steps_of_others_bring_no_target_back_that_was_renamed_or_deleted_since(
    opened: Any, work: Path, change: Callable[[Session], None], kind: str
) -> None:
    other = opened(annotator="ben")
    _mark(other, 0, 3, "book" if kind == "redo" else "cup")
    _mark(other, 0, 3, "cup" if kind == "redo" else "book")
    if kind == "redo":
        other.step_back("undo")
    other.close()
    session = opened()
    change(session)
    session.close()
    other = opened(annotator="ben")
    other.step_back(kind)
    assert _said(work, annotator="ben") == "bbbb........"
    _mark(other, 0, 3, "none")
    other.step_back("undo")
    assert _said(work, annotator="ben") == "bbbb........"


def test_a_new_target_leaves_the_steps_of_others(opened: Any, work: Path) -> None:
    other = opened(annotator="ben")
    _mark(other, 0, 3, "cup")
    _mark(other, 0, 3, "book")
    other.close()
    session = opened()
    session.add_target("pen", NameRule(category="pen"))
    session.close()
    opened(annotator="ben").step_back("undo")
    assert _said(work, annotator="ben") == "cccc........"


def test_undo_brings_no_shape_of_a_target_back_whose_name_is_that_of_another_one(opened: Any, work: Path) -> None:
    session = opened()
    _draw(session, "cup", 0)
    _draw(session, "cup", 5)
    session.close()
    session = opened(annotator="ben")
    _rename(session)
    session.close()
    session = opened(annotator="cat")
    session.change_target("book", new_name="cup", key="8", colour="pink plain")
    session.close()
    session = opened()
    before = (work / "annotations" / "noise.drawn.csv").read_bytes()
    assert not session.state()["can_undo"]
    session.step_back("undo")
    assert (work / "annotations" / "noise.drawn.csv").read_bytes() == before


def test_a_target_whose_shapes_were_drawn_since_stays(opened: Any, work: Path) -> None:
    session = opened()
    session.add_target("pen", NameRule(category="pen"))
    _draw(session, "pen", 0)
    session.close()
    (work / "annotations" / ".journal" / "noise.drawn.jsonl").unlink()
    session = opened()
    with pytest.raises(VfoaError, match=r"noise\.drawn\.csv has shapes of 'pen'"):
        session.step_back("undo")
    assert "pen" in _manifest(work).targets


def test_names_are_not_changed_while_another_annotator_labels_the_clip(opened: Any, work: Path) -> None:
    other = opened(annotator="ben")
    _mark(other, 0, 3, "cup")
    session = opened()
    with pytest.raises(VfoaError, match=r"noise@ben\.csv is being labelled by another vfoa annotate"):
        session.change_target("cup", new_name="mug", key="1", colour="blue plain")
    assert (work / "datasets" / "noise.toml").read_text() == MANIFEST


def test_names_are_not_changed_while_another_annotator_is_about_to_label_the_clip(opened: Any, work: Path) -> None:
    session, other = opened(), opened(annotator="ben")
    for change in (_rename, _delete, lambda session: session.add_target("pen", NameRule(category="pen"))):
        with pytest.raises(VfoaError, match=r"noise@ben\.csv is being labelled by another vfoa annotate"):
            change(session)
    assert (work / "datasets" / "noise.toml").read_text() == MANIFEST
    _mark(other, 0, 3, "cup")
    other.close()
    _rename(session)
    assert _said(work, annotator="ben") == "mmmm........"


def test_a_new_name_is_in_labels_among_the_files_of_the_clip(opened: Any, work: Path) -> None:
    write_text(work / "pairs" / "labels.csv", f"{HEAD}1,4,ann,cup,\n")
    path = work / "datasets" / "noise.toml"
    path.write_text(path.read_text().replace('root = "../pairs"', 'root = "../pairs"\nlabels_file = "labels.csv"'))
    session = opened(annotator="ben")
    _rename(session)
    assert _said(work) == "mmmm........"
    session.step_back("undo")
    assert _said(work) == "cccc........"


def test_two_names_with_one_key_are_refused(opened: Any, work: Path) -> None:
    with pytest.raises(VfoaError, match="key: '2' is the key of "):
        opened().change_target("cup", new_name="cup", key="2", colour="blue plain")
    assert (work / "datasets" / "noise.toml").read_text() == MANIFEST


def test_after_a_change_that_did_not_get_into_all_files_nothing_is_labelled_until_it_is_completed(
    opened: Any, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ann,cup,\n")
    session = opened()
    _mark(session, 0, 5, "cup")

    def full(path: Path, labels: Labels) -> None:
        if path == session.path:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write_annotations(path, labels)

    with monkeypatch.context() as patch:
        patch.setattr("harness.annotate.label_store.write_annotations", full)
        with pytest.raises(VfoaError, match=r"noise\.csv.*No space left"):
            _rename(session)
    before = session.path.read_bytes()
    for change in (
        lambda: _mark(session, 6, 9, "cup"),
        lambda: _draw(session, "cup", 0),
        lambda: session.step_back("undo"),
        lambda: session.add_target("pen", NameRule(category="pen")),
    ):
        with pytest.raises(VfoaError, match=r"noise\.change\.json: .*open the clip again"):
            change()
    assert session.path.read_bytes() == before
    session.close()
    session = opened()
    assert [_said(work), _said(work, annotator="ben")] == ["mmmmmm......", "mmmm........"]
    _mark(session, 6, 9, "mug")


class Killed(BaseException):
    """As SIGKILL: nobody catches it."""


@pytest.mark.parametrize("to", ["mug", None], ids=["renamed", "deleted"])
def test_a_kill_between_any_two_files_is_finished_when_the_clip_is_opened_next(
    opened: Any, work: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch, to: str | None
) -> None:
    """Either nothing has changed, or the manifest, the labels of both annotators and the drawing have."""
    write_text(work / "annotations" / "noise@ben.csv", f"{HEAD}1,4,ann,cup,\n")
    write_text(work / "annotations" / "noise.csv", f"{HEAD}1,6,ann,cup,\n")
    head = "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
    write_text(work / "annotations" / "noise.drawn.csv", f"{head}1,cup,box,4,30,14,44,\n")
    at_first = tmp_path_factory.mktemp("as") / "it was"
    shutil.copytree(work, at_first)
    replace = Path.replace
    results: list[tuple[object, ...]] = []
    undone: list[tuple[object, ...]] = []
    for kill_at in range(20):
        shutil.rmtree(work)
        shutil.copytree(at_first, work)
        session = opened()
        left = iter(range(kill_at))

        def until_killed(source: Path, target: Path, left: Iterator[int] = left) -> Path:
            if next(left, None) is None:
                raise Killed
            return replace(source, target)

        with monkeypatch.context() as patch:
            patch.setattr(Path, "replace", until_killed)
            try:
                if to is None:
                    session.delete_target("cup", "book")
                else:
                    session.change_target("cup", new_name=to, key="9", colour="olive plain")
                was_killed = False
            except Killed:
                was_killed = True
        session.close()
        again = opened()
        found = (*again.manifest.targets, _said(work), _said(work, annotator="ben"), len(again.drawn()["tracks"]))
        again.step_back("undo")
        undone.append((*again.manifest.targets, _said(work), _said(work, annotator="ben")))
        again.close()
        assert not [*(work / "annotations" / ".journal").glob("*.json")]
        results.append(found)
        if not was_killed:
            break
    letter, names = ("b", ("book",)) if to is None else ("m", (to, "book"))
    done = (*names, letter * 6 + "." * 6, letter * 4 + "." * 8, int(to is not None))
    assert results[0] == ("cup", "book", "c" * 6 + "." * 6, "c" * 4 + "." * 8, 1)
    assert results[1:] == [done] * (len(results) - 1)
    steps = sum(names == results[0][:-1] for names in undone[1:])
    assert undone[1:] == [done[:-1]] * (len(undone) - 1 - steps) + [results[0][:-1]] * steps
    assert steps >= 2  # of which the change was in the journal of these labels before the kill
    assert len(results) >= 6  # what is to be done, the manifest, two files of labels, what is drawn, and unharmed


@pytest.mark.parametrize(("kill_at", "letter"), [(1, "c"), (2, "m")], ids=["before the manifest", "after it"])
def test_a_manifest_that_is_edited_before_an_interrupted_change_is_finished_keeps_what_was_edited(
    opened: Any, work: Path, monkeypatch: pytest.MonkeyPatch, kill_at: int, letter: str
) -> None:
    write_text(work / "annotations" / "noise.csv", f"{HEAD}1,6,ann,cup,\n")
    session, path = opened(), work / "datasets" / "noise.toml"
    replace, left = Path.replace, iter(range(kill_at))

    def until_killed(source: Path, target: Path) -> Path:
        if next(left, None) is None:
            raise Killed
        return replace(source, target)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", until_killed)
        with pytest.raises(Killed):
            _rename(session)
    session.close()
    edited = path.read_text() + "# edited\n"
    path.write_text(edited)
    again = opened()
    assert path.read_text() == edited
    assert _said(work) == letter * 6 + "......"
    assert not [*(work / "annotations" / ".journal").glob("*.json")]
    again.add_target("pen", NameRule(category="pen"))


def _is_settled(browser: Chrome) -> bool:
    return bool(browser.execute_script("return document.body.getAttribute('aria-busy') === 'false'"))


def _press(browser: Chrome, *keys: str) -> None:
    from selenium.webdriver import ActionChains

    for key in keys:
        ActionChains(browser, duration=0).send_keys(key).perform()
    wait_for(lambda: _is_settled(browser))


def _keys(browser: Chrome) -> dict[str, str]:
    """The key that each name's button shows."""
    shown = browser.execute_script(
        "return [...document.querySelectorAll('#names [data-target]')].map((each) => "
        "[each.dataset.target, each.firstChild.textContent, each.className])"
    )
    return {name: f"{key} {look.replace('look ', '')}" for name, key, look in shown}


def test_keys_stay_while_targets_are_added_renamed_and_deleted(
    browser: Chrome, noise: Callable[..., Page], work: Path
) -> None:
    page = noise()
    browser.get(page.address)
    wait_for(lambda: shown(browser) is not None and _is_settled(browser))
    at_first = _keys(browser)
    right = "\ue014"
    _press(browser, "1", right, right, "4")

    _press(browser, "t")
    form = browser.find_element("id", "new-target")
    form.find_element("name", "name").send_keys("lamp")
    offered = browser.execute_script("return [...document.querySelectorAll('#categories option')].map((o) => o.value)")
    assert {"cup", "person", "clock", "wall-brick"} <= set(offered)
    form.find_element("name", "category").send_keys("lamp\ue007")
    wait_for(lambda: "lamp" in _keys(browser))
    assert {name: look for name, look in _keys(browser).items() if name != "lamp"} == at_first
    _press(browser, right, "5", right)

    browser.find_element("css selector", '[aria-label^="change cup"]').click()
    form = browser.find_element("id", "target")
    form.find_element("name", "new_name").clear()
    form.find_element("name", "new_name").send_keys("mug\ue007")
    wait_for(lambda: "mug" in _keys(browser))
    assert _keys(browser)["mug"] == at_first["cup"]
    _press(browser, "1", right, "2", right, right)

    browser.find_element("css selector", '[aria-label^="change book"]').click()
    browser.find_element("id", "delete").click()
    wait_for(lambda: "is the target of" in browser.find_element("id", "notice").text)
    form.find_element("name", "to").send_keys("lamp")
    browser.find_element("id", "delete").click()
    wait_for(lambda: "book" not in _keys(browser))
    now = _keys(browser)
    assert {name: now[name] for name in ("ann", "ben", "none", "ignore")} == {
        name: at_first[name] for name in ("ann", "ben", "none", "ignore")
    }
    _press(browser, "2")  # nobody's key any more
    _press(browser, "1")
    assert _said(work) == "mmblmllm...."
