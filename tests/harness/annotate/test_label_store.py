"""The labels while they are made: nothing is lost by a kill, a restart, an undo or another tab."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.annotate import actions
from harness.annotate.journaled_store import StaleRevisionError
from harness.annotate.label_store import LabelStore
from harness.annotate.marks import Mark, Stretch
from harness.labels.files import read_annotations
from harness.labels.labels import Label, Labels, Timeline
from tests.annotating import letters
from tests.disk import labels_text, write_text
from vfoa.errors import VfoaError

FRAMES = (1, 2, 3, 4, 5, 8, 9, 10)  # two are missing
SUBJECTS = ("ann", "ben")
TARGETS = ("cup", "book")
LAST = len(FRAMES) - 1


_opened: list[LabelStore] = []


@pytest.fixture(autouse=True)
def _closed() -> Iterator[None]:
    yield
    while _opened:
        _opened.pop().close()


def _open(
    folder: Path, frames: tuple[int, ...] = FRAMES, subjects: tuple[str, ...] = SUBJECTS, **more: object
) -> LabelStore:
    path, journal = folder / "annotations" / "clip.csv", folder / "journal.jsonl"
    timeline = Timeline(frames=frames, times_ns=())
    store = LabelStore(path, journal, timeline=timeline, subjects=subjects, targets=TARGETS, **more)  # type: ignore[arg-type]
    _opened.append(store)
    return store


@pytest.fixture
def store(tmp_path: Path) -> LabelStore:
    """The store of a clip without labels."""
    return _open(tmp_path)


def _again(store: LabelStore, *, has_journal: bool = True) -> LabelStore:
    """The store after a restart; without its journal, only the CSV says what was labelled."""
    store.close()
    folder = store.path.parent.parent
    if not has_journal:
        (folder / "journal.jsonl").unlink()
    return _open(folder)


def _file(folder: Path) -> Labels:
    timeline = Timeline(frames=FRAMES, times_ns=())
    return read_annotations(folder / "annotations" / "clip.csv", timeline=timeline, subjects=SUBJECTS, targets=TARGETS)


def _look(store: LabelStore, at: int, target: str, subject: str = "ann") -> None:
    store.put(subject, actions.look(store.track(subject), at, target), seen=at)


def _range(store: LabelStore, first: int, last: int, target: str) -> None:
    store.put("ann", actions.mark_range(store.track("ann"), first, last, target))


def _suggest(store: LabelStore, suggested: list[str | None]) -> None:
    store.put("ann", actions.accept(store.track("ann"), suggested, store.seen("ann")))


def _note(store: LabelStore, at: int, note: str, *tags: tuple[str, ...]) -> None:
    store.put("ann", actions.annotate(store.track("ann"), at, note, *tags))


def _scored(folder: Path) -> str:
    """What the file says of ann, a letter a frame; ``-`` for ignore, ``.`` for a frame without a label."""
    return letters(_file(folder), frames=FRAMES)


def _marks(store: LabelStore) -> str:
    """The marks of ann, a letter a frame; a capital one for a suggestion."""
    marks = store.track("ann")
    found = ((mark.target[0], mark.is_suggested) if mark else (".", False) for mark in marks)
    return "".join(letter.upper() if is_suggested else letter for letter, is_suggested in found)


def test_a_label_holds_until_the_next_change_and_counts_where_it_was_seen(store: LabelStore, tmp_path: Path) -> None:
    _look(store, 0, "cup")
    assert _scored(tmp_path) == "c......."
    store.see("ann", 3)
    assert _scored(tmp_path) == "cccc...."
    _look(store, 2, "none")
    store.see("ann", LAST)
    assert _scored(tmp_path) == "ccnnnnnn"
    _look(store, 1, "book")
    assert _scored(tmp_path) == "cbnnnnnn"
    assert store.state()["labelled"] == 8
    assert store.state()["total"] == 16


def test_undoing_a_label_far_ahead_takes_back_that_the_frames_before_it_were_seen(
    store: LabelStore, tmp_path: Path
) -> None:
    _look(store, 0, "cup")
    store.see("ann", 2)
    _look(store, LAST, "none")
    assert _scored(tmp_path) == "cccccccn"
    store = _again(store)
    store.step_back("undo")
    assert _scored(tmp_path) == "ccc....."
    store.step_back("redo")
    assert _scored(tmp_path) == "cccccccn"
    store.step_back("undo")
    store.see("ann", 4)
    store.step_back("redo")
    store.step_back("undo")
    assert _scored(tmp_path) == "ccccc..."


def test_frames_between_labels_are_not_scored_and_unlabelled_when_opened_again(
    store: LabelStore, tmp_path: Path
) -> None:
    _range(store, 0, 1, "cup")
    _range(store, 5, 6, "book")
    assert _scored(tmp_path) == "cc---bb."
    assert _marks(_again(store, has_journal=False)) == "cc...bb."


def test_a_suggestion_is_not_scored_until_a_person_confirms_it(store: LabelStore, tmp_path: Path) -> None:
    _suggest(store, ["cup", "cup", "book", "book", None, None, None, "cup"])
    assert _file(tmp_path).at(1, "ann") == Label(target="cup", is_suggested=True)
    assert letters(_file(tmp_path).confirmed(), frames=FRAMES) == "--------"
    assert store.state()["labelled"] == 0
    store.put("ann", actions.confirm(store.track("ann"), 3))
    assert letters(_file(tmp_path).confirmed(), frames=FRAMES) == "--bb----"
    assert _marks(_again(store, has_journal=False)) == "CCbb...C"


@pytest.mark.parametrize(("attention", "accepted"), [(0.5, {1, 2}), (0.6, {2}), (0.8, set())])
def test_only_suggestions_with_enough_attention_are_accepted(attention: float, accepted: set[int]) -> None:
    suggested = [None, ("cup", 0.5), ("cup", 0.7)]
    action = actions.Action(kind="accept", subject="ann", attention=attention)
    new = actions.edited(action, [None] * 3, suggested, seen=0)
    assert {at for each in new for at in range(each.first, each.last + 1)} == accepted


def test_suggestions_fill_what_is_unlabelled_or_only_carried_ahead(store: LabelStore) -> None:
    _range(store, 1, 2, "none")
    _look(store, 4, "book")
    _suggest(store, ["cup"] * 8)
    assert _marks(store) == "CnnCbCCC"


def test_notes_and_tags_stay_with_their_label_in_the_file_and_after_a_restart(
    store: LabelStore, tmp_path: Path
) -> None:
    note = "à\u00a0gauche, \u200d 目"
    _range(store, 0, LAST, "cup")
    _range(store, 3, 4, "ignore")
    _note(store, 4, "", ("child", "far"))
    _note(store, 4, note)
    tagged = Label(target="ignore", note=note, tags=("child", "far"))
    assert [_file(tmp_path).at(frame, "ann") for frame in (3, 4, 5)] == [Label(target="cup"), tagged, tagged]
    assert _again(store).track("ann")[3] == Mark(target="ignore", note=note, tags=("child", "far"))


def test_a_note_whose_accents_are_signs_of_their_own_can_be_undone_after_a_restart(store: LabelStore) -> None:
    """As text from a file on macOS. The file has them in their letters, and is no other program's."""
    _range(store, 0, LAST, "cup")
    _note(store, 0, "le\u0301ger")
    again = _again(store)
    assert again.track("ann")[0] == Mark(target="cup", note="l\u00e9ger")
    again.step_back("undo")
    assert again.track("ann")[0] == Mark(target="cup")


def test_a_new_target_keeps_the_tags_of_the_frames_and_a_range_their_note(store: LabelStore) -> None:
    _range(store, 0, LAST, "cup")
    _range(store, 3, 4, "ignore")
    _note(store, 4, "blinks", ("far",))
    _range(store, 2, 3, "book")
    assert store.track("ann")[2:5] == [
        Mark(target="book"),
        Mark(target="book", note="blinks", tags=("far",)),
        Mark(target="ignore", note="blinks", tags=("far",)),
    ]
    store.put("ann", actions.look(store.track("ann"), 4, "cup"), seen=4)
    assert store.track("ann")[4] == Mark(target="cup", tags=("far",))


def test_a_note_leaves_those_of_its_neighbours(store: LabelStore) -> None:
    noted = [Stretch(first=at, last=at + 1, mark=Mark(target="cup", note=f"note {at}")) for at in (0, 2, 4, 6)]
    store.put("ann", noted)
    _note(store, 3, "glasses")
    notes = ["note 0", "glasses", "note 4", "note 6"]
    assert [mark and mark.note for mark in store.track("ann")] == [note for note in notes for _ in range(2)]


def test_a_note_is_on_all_frames_to_which_a_label_is_carried(store: LabelStore) -> None:
    _look(store, 2, "cup")
    _note(store, 2, "glasses")
    assert [mark and mark.note for mark in store.track("ann")] == [None] * 2 + ["glasses"] * 6


def test_a_confirmed_suggestion_keeps_its_note(store: LabelStore) -> None:
    _suggest(store, ["cup"] * 8)
    _note(store, 4, "glasses")
    store.put("ann", actions.confirm(store.track("ann"), 4))
    assert store.track("ann") == [Mark(target="cup", note="glasses")] * 8


def test_the_id_of_a_change_is_known_also_after_a_restart(store: LabelStore) -> None:
    with store.under("a"):
        _range(store, 0, 1, "cup")
    _range(store, 2, 3, "cup")
    assert store.requests == {"a"}
    assert _again(store).requests == {"a"}


def test_who_only_looks_at_labels_leaves_their_file_as_it_is(tmp_path: Path) -> None:
    """Equal rows beside each other, as a script writes them, are one range in the store."""
    text = labels_text("1,1,ann,cup,", "2,2,ann,cup,")
    path = write_text(tmp_path / "annotations" / "clip.csv", text)
    store = _open(tmp_path)
    store.see("ann", 3)
    _again(store).see("ann", 4)
    assert path.read_text() == text


def test_seeing_frames_makes_no_other_tab_stale(store: LabelStore) -> None:
    _look(store, 0, "cup")
    revision = store.revision
    store.see("ann", 4)
    assert store.revision == revision


@pytest.mark.parametrize("opened", [True, False], ids=["while open", "between"])
def test_a_csv_that_was_changed_elsewhere_wins_and_is_not_overwritten(
    store: LabelStore, tmp_path: Path, opened: bool
) -> None:
    _look(store, 0, "cup")
    revision = store.revision
    if not opened:
        store.close()
    text = labels_text("1,10,ben,book,by hand")
    write_text(store.path, text)
    if not opened:
        store = _open(tmp_path)
    else:
        with pytest.raises(StaleRevisionError):
            _range(store, 0, 0, "book")
    assert store.revision > revision
    assert [mark and mark.note for mark in store.track("ben")] == ["by hand"] * 8
    assert store.path.read_text() == text


def test_a_csv_that_is_put_back_to_the_version_before_the_last_change_stays(store: LabelStore, tmp_path: Path) -> None:
    _range(store, 0, 3, "cup")
    before = store.path.read_bytes()
    _range(store, 0, 3, "book")
    store.close()
    store.path.write_bytes(before)
    while store.path.stat().st_ctime_ns <= (tmp_path / "journal.jsonl").stat().st_ctime_ns:  # in one tick of its clock
        store.path.write_bytes(before)
    again = _open(tmp_path)
    assert again.path.read_bytes() == before
    assert again.track("ann")[0] == Mark(target="cup")


def test_who_may_not_read_the_csv_may_not_read_its_journal(tmp_path: Path) -> None:
    write_text(tmp_path / "annotations" / "clip.csv", labels_text("1,2,ann,cup,")).chmod(0o600)
    _look(_open(tmp_path), 3, "book")
    modes = {path.stat().st_mode & 0o777 for path in tmp_path.rglob("*") if path.is_file()}
    assert modes == {0o600}


def test_a_deleted_csv_is_a_fresh_start(store: LabelStore, tmp_path: Path) -> None:
    _look(store, 0, "cup")
    _look(store, 1, "book")
    store.close()
    store.path.unlink()
    assert _open(tmp_path).track("ann") == [None] * 8


def test_a_csv_that_is_deleted_while_open_is_written_again_with_all_that_can_be_undone(
    store: LabelStore, tmp_path: Path
) -> None:
    _look(store, 0, "cup")
    _look(store, 1, "book")
    kept = store.path.read_bytes()
    store.path.unlink()
    store.refresh()
    assert store.path.read_bytes() == kept
    store.path.unlink()
    store.step_back("undo")
    assert _scored(tmp_path) == "c......."
    assert store.last_step("undo") is not None


@pytest.mark.parametrize(
    ("refused", "file"),
    [("harness.annotate.label_store.write_annotations", r"clip\.csv"), ("os.fsync", r"journal\.jsonl")],
)
def test_a_change_that_the_disk_does_not_take_is_not_made_and_not_made_by_a_restart(
    store: LabelStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: str, file: str
) -> None:
    _range(store, 0, 1, "cup")
    files = [tmp_path / "journal.jsonl", store.path]
    before, shown = [path.read_bytes() for path in files], store.state()
    with monkeypatch.context() as patch:
        patch.setattr(refused, _refuse)
        for change in (
            lambda: _range(store, 4, 5, "book"),
            lambda: store.step_back("undo"),
            lambda: store.set_changes(store.reassigned("cup", "book")),
        ):
            with pytest.raises(VfoaError, match=rf"{file}.*No space left"):
                change()
            assert [path.read_bytes() for path in files] == before
            assert store.state() == shown
    assert store.names() == (*TARGETS, *SUBJECTS, "none", "ignore")
    _range(store, 6, 6, "book")
    assert _marks(_again(store)) == "cc....b."


def _refuse(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("{", "not JSON"),
        ("5", "not an entry"),
        ('{"redo":true}', "IndexError"),
        ('{"seen":["bob",1]}', r"KeyError\('bob'\)"),
        ('{"seen":["ann",1000000000000]}', "ValueError"),
        ('{"change":7}', "TypeError"),
        ('{"change":{"subject":"ann"}}', r"KeyError\('after'\)"),
        ('{"change":{"subject":"ann","before":[],"after":[[-3,-1]]}}', "ValueError"),
        (
            '{"change":{"subject":"ann","before":[],"after":[[5,1000000000000,"cup","",null,false,false]]}}',
            "ValueError",
        ),
    ],
)
def test_a_journal_that_was_changed_by_hand_is_one_line(
    store: LabelStore, tmp_path: Path, line: str, found: str
) -> None:
    _range(store, 0, 1, "cup")
    store.close()
    with (tmp_path / "journal.jsonl").open("a") as file:
        file.write(f"{line}\n")
    with pytest.raises(VfoaError, match=rf"journal\.jsonl:3: .*{found}"):
        _open(tmp_path)


def test_a_step_that_cannot_be_undone_leaves_the_journal_as_it_was(store: LabelStore, tmp_path: Path) -> None:
    _range(store, 0, 1, "cup")
    store.close()
    journal = tmp_path / "journal.jsonl"
    journal.write_text(journal.read_text().replace('"before"', '"earlier"'))
    again, before = _open(tmp_path), journal.read_bytes()
    with pytest.raises(VfoaError, match=r"journal\.jsonl: .*KeyError\('before'\)"):
        again.step_back("undo")
    assert journal.read_bytes() == before
    assert again.track("ann")[0] == Mark(target="cup")


def test_two_servers_on_one_clip_are_refused(store: LabelStore, tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"clip\.csv is being labelled"):
        _open(tmp_path)
    store.close()
    _open(tmp_path)


def test_wrong_names_and_positions_are_refused_in_one_line(store: LabelStore, tmp_path: Path) -> None:
    for subject, first, last, target, found in (
        ("anna", 0, 0, "cup", "'anna'; did you mean 'ann'"),
        ("ann", 0, 0, "cupp", "'cupp'; did you mean 'cup'"),
        ("ann", 0, 0, "ann", "'ann' looks at 'ann'"),
        ("ann", -1, 0, "cup", "position -1 "),
        ("ann", 0, 8, "cup", "position 8 .*expected 0 to 7"),
        ("ann", 3, 2, "cup", "position 3 .*position 2"),
    ):
        with pytest.raises(VfoaError, match=found):
            store.put(subject, actions.mark_range(store.track("ann"), first, last, target))
    assert not (tmp_path / "annotations").exists()


def test_a_journal_of_a_clip_with_other_frames_or_people_is_not_believed(store: LabelStore, tmp_path: Path) -> None:
    _range(store, 0, 1, "cup")
    store.close()
    assert _marks(_open(tmp_path, (*FRAMES, 11), ("ann",))) == "cc......."


_STEP = st.one_of(
    st.tuples(st.just("look"), st.sampled_from(SUBJECTS), st.integers(0, LAST), st.sampled_from(TARGETS)),
    st.tuples(st.just("see"), st.sampled_from(SUBJECTS), st.integers(0, LAST)),
    st.tuples(
        st.just("accept"), st.sampled_from(SUBJECTS), st.lists(st.sampled_from(["cup", None]), min_size=8, max_size=8)
    ),
    st.tuples(st.just("undo")),
    st.tuples(st.just("redo")),
)


def _take(store: LabelStore, step: tuple[object, ...]) -> None:
    match step:
        case ("look", str(subject), int(at), str(target)):
            _look(store, at, target, subject)
        case ("see", str(subject), int(at)):
            store.see(subject, at)
        case ("accept", str(subject), list(suggested)):
            if new := actions.accept(store.track(subject), suggested, store.seen(subject)):
                store.put(subject, new)
        case ("undo",):
            store.step_back("undo")
        case ("redo",):
            store.step_back("redo")


def _known(store: LabelStore) -> dict[str, object]:
    return store.state() | {"undo": store.last_step("undo"), "redo": store.last_step("redo")}


@given(steps=st.lists(_STEP, max_size=12))
def test_a_restart_finds_everything_again_and_can_go_on_undoing(
    tmp_path_factory: pytest.TempPathFactory, steps: list[tuple[object, ...]]
) -> None:
    folder = tmp_path_factory.mktemp("clip")
    store = _open(folder)
    for step in steps:
        _take(store, step)
    before = _known(store)
    store.close()
    again = _open(folder)
    assert _known(again) == before
    for _ in steps:
        again.step_back("undo")
    assert {tuple(again.track(name)) for name in SUBJECTS} == {(None,) * 8}
    again.close()


def test_a_kill_at_any_byte_of_a_change_leaves_the_state_before_or_after_it(store: LabelStore, tmp_path: Path) -> None:
    _look(store, 0, "cup")
    csv, journal = store.path.read_bytes(), (tmp_path / "journal.jsonl").read_bytes()
    before = _known(store)
    _look(store, 0, "book")
    after = _known(store)
    grown = (tmp_path / "journal.jsonl").read_bytes()
    store.close()
    for length in range(len(journal), len(grown) + 1):
        folder = tmp_path / str(length)
        (folder / "annotations").mkdir(parents=True)
        (folder / "annotations" / "clip.csv").write_bytes(csv)
        (folder / "journal.jsonl").write_bytes(grown[:length])
        opened = _open(folder)
        assert _known(opened) == (after if length == len(grown) else before)
        assert _scored(folder)[0] == ("b" if length == len(grown) else "c")
        opened.close()


def test_a_label_over_labels_that_a_person_gave_counts_at_once(store: LabelStore, tmp_path: Path) -> None:
    _range(store, 0, 5, "book")
    _look(store, 2, "cup")
    assert _scored(tmp_path) == "bbcccc.."
