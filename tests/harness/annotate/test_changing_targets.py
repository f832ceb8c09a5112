"""Targets that come, go and are renamed while a clip is being labelled: the keys of the others do not move."""

from __future__ import annotations

import errno
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from pathlib import Path

import pytest

from harness.annotate.actions import Action
from harness.annotate.drawing_store import Draw
from harness.annotate.session import Session
from harness.clips.manifest import ClipManifest, load_manifest
from harness.clips.naming import NameRule
from harness.labels.files import write_annotations
from harness.labels.labels import Label, Labels, Timeline
from tests.annotating import FRAMES, MANIFEST, LabellingPage, letters, write_labels
from tests.browser import wait_for
from tests.disk import write_text
from vfoa.errors import VfoaError

By = Callable[..., AbstractContextManager[Session]]
Opened = Callable[..., Session]
Change = Callable[[Session], None]
PEN = NameRule(category="pen")


@pytest.fixture
def by(work: Path) -> By:
    """Opens the clip as an annotator, until the block ends."""
    return lambda annotator=None: closing(Session(str(work / "datasets" / "noise.toml"), annotator=annotator))


def _manifest(work: Path) -> ClipManifest:
    return load_manifest(str(work / "datasets" / "noise.toml"))


def _labels(work: Path, annotator: str | None = None) -> Labels:
    manifest = _manifest(work)
    found = manifest.annotations.find(annotator)
    assert found is not None
    return manifest.read(found, Timeline(frames=FRAMES, times_ns=()))


def _said(work: Path, subject: str = "ann", annotator: str | None = None) -> str:
    return letters(_labels(work, annotator), subject)


def _both(work: Path) -> tuple[str, str]:
    """What is said of ann without a name of the annotator, and by ben."""
    return _said(work), _said(work, annotator="ben")


def _mark(session: Session, first: int, last: int, target: str, subject: str = "ann") -> None:
    session.make(Action(kind="range", subject=subject, at=first, last=last, target=target))


def _draw(session: Session, name: str, at: int) -> None:
    session.make(Action(kind="draw", draw=Draw(name=name, at=at, place=(1, 1, 9, 9))))


def _rename(session: Session) -> None:
    session.change_target("cup", new_name="mug", key="9", colour="olive plain")


def _delete(session: Session) -> None:
    session.delete_target("cup", "book")


def _add(session: Session) -> None:
    session.add_target("pen", PEN)


def test_a_new_name_is_in_the_labels_of_all_annotators(opened: Opened, work: Path) -> None:
    write_labels(work, "1,4,ann,cup,", annotator="@ben")
    session = opened()
    _mark(session, 0, 5, "cup")
    _mark(session, 2, 3, "book")
    _rename(session)
    assert _both(work) == ("mmbbmm......", "mmmm........")
    about = session.about()
    assert about["looks"]["mug"] == {"key": "9", "colour": "olive plain"}
    keys = {name: look["key"] for name, look in about["looks"].items()}
    assert keys == {"mug": "9", "book": "2", "ann": "3", "ben": "4"}


def test_a_target_in_use_is_deleted_only_with_another_for_its_labels(opened: Opened, work: Path) -> None:
    write_labels(work, "1,4,ben,cup,", annotator="@ben")
    session = opened()
    with pytest.raises(VfoaError, match=r"'cup' .* 4 labels"):
        session.delete_target("cup", None)
    with pytest.raises(VfoaError, match=r"'ben' .*'cup' .*'ben'"):
        session.delete_target("cup", "ben")
    assert (work / "datasets" / "noise.toml").read_text() == MANIFEST
    session.delete_target("cup", "book")
    assert _said(work, "ben", "ben") == "bbbb........"
    assert [*_manifest(work).targets] == ["book"]
    session.add_target("vase", _manifest(work).targets["book"].model_copy(update={"category": "vase", "key": None}))
    assert session.about()["looks"]["vase"]["key"] == "1"  # the one that is free
    assert session.about()["looks"]["book"]["key"] == "2"


@pytest.mark.parametrize("is_opened_again", [False, True])
def test_one_history_takes_back_labels_targets_and_drawing_whatever_the_clock_says(
    opened: Opened, work: Path, monkeypatch: pytest.MonkeyPatch, is_opened_again: bool
) -> None:
    """The clock is set back before every change, and the clip may be opened again for it."""
    write_labels(work, "1,4,ann,cup,", annotator="@ben")
    session = opened()

    def shown() -> tuple[object, ...]:
        drawn = [each["name"] for each in session.drawn()["tracks"]]
        looks = {name: (look["key"], look["colour"]) for name, look in session.about()["looks"].items()}
        return *_both(work), drawn, looks, [*session.manifest.targets]

    changes: list[Change] = [
        lambda session: _mark(session, 0, 5, "cup"),
        lambda session: _draw(session, "cup", 0),
        _rename,
        lambda session: _mark(session, 2, 3, "book"),
        lambda session: _draw(session, "book", 0),
        _add,
        lambda session: session.change_target("book", new_name="book", key="8", colour="pink plain"),
        lambda session: session.delete_target("mug", "book"),
    ]
    states = []
    for number, change in enumerate(changes):
        if is_opened_again:
            session.close()
            session = opened()
        with monkeypatch.context() as patch:
            patch.setattr("time.time", lambda number=number: 9000.0 - 1000 * number)
            change(session)
        states.append(shown())
    for expected in reversed(states[:-1]):
        session.step_back("undo")
        assert shown() == expected
    for expected in states[1:]:
        session.step_back("redo")
        assert shown() == expected
    session.close()
    session = opened()
    assert shown() == states[-1]
    session.step_back("undo")
    assert shown() == states[-2]


def test_a_target_that_another_annotator_uses_by_now_stays(opened: Opened, work: Path) -> None:
    session = opened()
    _add(session)
    write_labels(work, "1,4,ann,pen,", annotator="@ben")
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


@pytest.mark.parametrize(("change", "given"), [(_rename, "m"), (_delete, "b")])
@pytest.mark.parametrize(("annotator", "other"), [(None, "ben"), ("ben", None)])
def test_undo_leaves_labels_that_another_annotator_made_since(
    by: By, work: Path, change: Change, given: str, annotator: str | None, other: str | None
) -> None:
    for name in ("", "@ben"):
        write_labels(work, "1,8,ann,cup,", annotator=name)
    with by(annotator) as session:
        change(session)
    with by(other) as session:
        _mark(session, 0, 3, "none")
        session.make(Action(kind="note", subject="ann", at=6, note="glasses"))
    with by(annotator) as session:
        session.step_back("undo")
        assert (_said(work, annotator=annotator), _said(work, annotator=other)) == ("cccccccc....", "nnnncccc....")
        assert _labels(work, other).at(7, "ann") == Label(target="cup", note="glasses")
        session.step_back("redo")
    assert _said(work, annotator=annotator) == f"{given * 8}...."
    assert _said(work, annotator=other) == f"nnnn{given * 4}...."


def test_undo_is_refused_where_another_annotator_has_used_a_name_since(by: By, work: Path) -> None:
    write_labels(work, "1,4,ann,cup,", annotator="@ben")
    with by() as session:
        _mark(session, 0, 5, "cup")
        _rename(session)
    with by("ben") as session:
        _mark(session, 2, 7, "mug")
    files = {path: path.read_bytes() for path in (work / "annotations").glob("*.csv")}
    with by() as session:
        with pytest.raises(VfoaError, match=r"noise@ben\.csv .*'mug' .*4 frames"):
            session.step_back("undo")
        assert session.state()["can_undo"]
    assert {path: path.read_bytes() for path in (work / "annotations").glob("*.csv")} == files
    assert "mug" in _manifest(work).targets


@pytest.mark.parametrize("change", [_rename, _delete])
def test_undo_leaves_shapes_that_were_drawn_since(opened: Opened, work: Path, change: Change) -> None:
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
    by: By, work: Path, change: Change, kind: str
) -> None:
    with by("ben") as other:
        _mark(other, 0, 3, "book" if kind == "redo" else "cup")
        _mark(other, 0, 3, "cup" if kind == "redo" else "book")
        if kind == "redo":
            other.step_back("undo")
    with by() as session:
        change(session)
    with by("ben") as other:
        other.step_back(kind)
        assert _said(work, annotator="ben") == "bbbb........"
        _mark(other, 0, 3, "none")
        other.step_back("undo")
    assert _said(work, annotator="ben") == "bbbb........"


def test_a_new_target_leaves_the_steps_of_others(by: By, work: Path) -> None:
    with by("ben") as other:
        _mark(other, 0, 3, "cup")
        _mark(other, 0, 3, "book")
    with by() as session:
        _add(session)
    with by("ben") as other:
        other.step_back("undo")
    assert _said(work, annotator="ben") == "cccc........"


def test_undo_brings_no_shape_of_a_target_back_whose_name_is_that_of_another_one(by: By, work: Path) -> None:
    with by() as session:
        _draw(session, "cup", 0)
        _draw(session, "cup", 5)
    with by("ben") as session:
        _rename(session)
    with by("cat") as session:
        session.change_target("book", new_name="cup", key="8", colour="pink plain")
    before = (work / "annotations" / "noise.drawn.csv").read_bytes()
    with by() as session:
        assert not session.state()["can_undo"]
        session.step_back("undo")
    assert (work / "annotations" / "noise.drawn.csv").read_bytes() == before


def test_a_target_whose_shapes_were_drawn_since_stays(by: By, work: Path) -> None:
    with by() as session:
        _add(session)
        _draw(session, "pen", 0)
    (work / "annotations" / ".journal" / "noise.drawn.jsonl").unlink()
    with by() as session, pytest.raises(VfoaError, match=r"noise\.drawn\.csv has shapes of 'pen'"):
        session.step_back("undo")
    assert "pen" in _manifest(work).targets


def test_names_are_not_changed_while_another_annotator_has_the_clip_open(opened: Opened, work: Path) -> None:
    """Also before that one has made a label."""
    session, other = opened(), opened(annotator="ben")

    def assert_refused() -> None:
        for change in (_rename, _delete, _add):
            with pytest.raises(VfoaError, match=r"noise@ben\.csv is being labelled"):
                change(session)
        assert (work / "datasets" / "noise.toml").read_text() == MANIFEST

    assert_refused()
    _mark(other, 0, 3, "cup")
    assert_refused()
    other.close()
    _rename(session)
    assert _said(work, annotator="ben") == "mmmm........"


def test_a_new_name_is_in_labels_among_the_files_of_the_clip(opened: Opened, work: Path) -> None:
    write_labels(work, "1,4,ann,cup,").rename(work / "pairs" / "labels.csv")
    path = work / "datasets" / "noise.toml"
    path.write_text(path.read_text().replace('root = "../pairs"', 'root = "../pairs"\nlabels_file = "labels.csv"'))
    session = opened(annotator="ben")
    _rename(session)
    assert _said(work) == "mmmm........"
    session.step_back("undo")
    assert _said(work) == "cccc........"


def test_two_names_with_one_key_are_refused(opened: Opened, work: Path) -> None:
    with pytest.raises(VfoaError, match="key: '2' is the key of "):
        opened().change_target("cup", new_name="cup", key="2", colour="blue plain")
    assert (work / "datasets" / "noise.toml").read_text() == MANIFEST


def test_after_a_change_that_did_not_get_into_all_files_nothing_is_labelled_until_it_is_completed(
    opened: Opened, work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_labels(work, "1,4,ann,cup,", annotator="@ben")
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
    changes: tuple[Change, ...] = (
        lambda session: _mark(session, 6, 9, "cup"),
        lambda session: _draw(session, "cup", 0),
        lambda session: session.step_back("undo"),
        _add,
    )
    for change in changes:
        with pytest.raises(VfoaError, match=r"noise\.change\.json: "):
            change(session)
    assert session.path.read_bytes() == before
    session.close()
    session = opened()
    assert _both(work) == ("mmmmmm......", "mmmm........")
    _mark(session, 6, 9, "mug")


class Killed(BaseException):
    """As SIGKILL: nobody catches it."""


@contextmanager
def _killed_after(files: int) -> Iterator[None]:
    """Kill whoever replaces one more file than these."""
    replace, left = Path.replace, iter(range(files))

    def until_killed(source: Path, target: Path) -> Path:
        if next(left, None) is None:
            raise Killed
        return replace(source, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "replace", until_killed)
        yield


@pytest.mark.parametrize(
    ("change", "done"),
    [
        (_rename, (["mug", "book"], ("mmmmmm......", "mmmm........"), 1)),
        (_delete, (["book"], ("bbbbbb......", "bbbb........"), 0)),
    ],
)
def test_a_kill_between_any_two_files_is_finished_when_the_clip_is_opened_next(
    by: By, work: Path, tmp_path_factory: pytest.TempPathFactory, change: Change, done: tuple[object, ...]
) -> None:
    """Either nothing has changed, or the manifest, the labels of both annotators and the drawing have."""
    write_labels(work, "1,4,ann,cup,", annotator="@ben")
    write_labels(work, "1,6,ann,cup,")
    head = "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n"
    write_text(work / "annotations" / "noise.drawn.csv", f"{head}1,cup,box,4,30,14,44,\n")
    at_first = tmp_path_factory.mktemp("as") / "it was"
    shutil.copytree(work, at_first)
    before = (["cup", "book"], ("cccccc......", "cccc........"), 1)

    def found(session: Session) -> tuple[object, ...]:
        return [*session.manifest.targets], _both(work), len(session.drawn()["tracks"])

    results: list[tuple[object, ...]] = []
    undone: list[tuple[object, ...]] = []
    was_killed = True
    while was_killed:
        shutil.rmtree(work)
        shutil.copytree(at_first, work)
        with by() as session, _killed_after(len(results)):
            try:
                change(session)
                was_killed = False
            except Killed:
                pass
        with by() as session:
            results.append(found(session))
            session.step_back("undo")
            undone.append(found(session)[:2])
        assert not [*(work / "annotations" / ".journal").glob("*.json")]
    assert results == [before, *[done] * (len(results) - 1)]
    assert len(results) >= 6  # what is to be done, the manifest, two files of labels, what is drawn, and unharmed
    steps = undone[1:].count(before[:2])
    assert undone[1:] == [done[:2]] * (len(undone) - 1 - steps) + [before[:2]] * steps
    assert steps >= 2  # of which the change was in the journal of these labels before the kill


@pytest.mark.parametrize(("kill_at", "letter"), [(1, "c"), (2, "m")], ids=["before the manifest", "after it"])
def test_a_manifest_that_is_edited_before_an_interrupted_change_is_finished_keeps_what_was_edited(
    by: By, work: Path, kill_at: int, letter: str
) -> None:
    write_labels(work, "1,6,ann,cup,")
    path = work / "datasets" / "noise.toml"
    with by() as session, _killed_after(kill_at), pytest.raises(Killed):
        _rename(session)
    edited = path.read_text() + "# edited\n"
    path.write_text(edited)
    with by() as session:
        assert path.read_text() == edited
        assert _said(work) == letter * 6 + "......"
        assert not [*(work / "annotations" / ".journal").glob("*.json")]
        _add(session)


def _looks(page: LabellingPage) -> dict[str, str]:
    """The key and the colours that each name's button shows."""
    found = page.js(
        "return [...document.querySelectorAll('#names [data-target]')].map((each) => "
        "[each.dataset.target, each.firstChild.textContent, each.className])"
    )
    return {name: f"{key} {look}" for name, key, look in found}


def test_keys_stay_while_targets_are_added_renamed_and_deleted(
    open_page: Callable[..., LabellingPage], work: Path
) -> None:
    page = open_page()
    at_first = _looks(page)
    enter, right = "\ue007", "\ue014"
    page.keys("1", right, right, "4", "t")

    form = page.find("#new-target")
    form.find_element("name", "name").send_keys("lamp")
    offered = page.js("return [...document.querySelectorAll('#categories option')].map((o) => o.value)")
    assert {"cup", "person", "clock", "wall-brick"} <= set(offered)
    form.find_element("name", "category").send_keys("lamp", enter)
    wait_for(lambda: "lamp" in _looks(page))
    assert {name: look for name, look in _looks(page).items() if name != "lamp"} == at_first
    page.keys(right, "5", right)

    page.click('[aria-label^="change cup"]')
    form = page.find("#target")
    form.find_element("name", "new_name").clear()
    form.find_element("name", "new_name").send_keys("mug", enter)
    wait_for(lambda: "mug" in _looks(page))
    assert _looks(page)["mug"] == at_first["cup"]
    page.keys("1", right, "2", right, right)

    page.click('[aria-label^="change book"]')
    page.click("#delete")
    wait_for(lambda: "is the target of" in page.text("#notice"))
    form.find_element("name", "to").send_keys("lamp")
    page.click("#delete")
    wait_for(lambda: "book" not in _looks(page))
    kept = {"ann", "ben", "none", "ignore"}
    assert {name: look for name, look in _looks(page).items() if name in kept} == {
        name: at_first[name] for name in kept
    }
    page.keys("2", "1")  # 2 is nobody's key any more
    assert _said(work) == "mmblmllm...."
