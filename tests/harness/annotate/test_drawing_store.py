"""The drawing of a clip: it is kept, undone and refused, and is the same after a kill."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from harness.annotate.actions import Action
from harness.annotate.drawing_store import Draw, DrawingStore
from harness.annotate.journaled_store import StaleRevisionError
from harness.annotate.session import Session
from harness.labels.drawn_shapes import COLUMNS, Drawn, KeyFrame, read_drawn, write_drawn
from harness.labels.labels import Timeline
from tests.disk import write_text
from vfoa.errors import VfoaError

FRAMES = range(10, 30)
NAMES = {"subjects": ["ann", "ben"], "targets": ["cup", "book"]}
BOX = (1.0, 2.0, 11.0, 12.0)


def _open(folder: Path) -> DrawingStore:
    timeline = Timeline(frames=FRAMES, times_ns=())
    return DrawingStore(
        folder / "noise.drawn.csv", folder / ".journal" / "noise.drawn.jsonl", timeline=timeline, **NAMES
    )


def _file(folder: Path) -> Drawn:
    return read_drawn(folder / "noise.drawn.csv", frames=FRAMES, **NAMES)


def _make(store: DrawingStore, do: str, **more: Any) -> None:
    if do in ("undo", "redo"):
        store.step_back(do)
    else:
        store.draw(Draw.model_validate({"do": do, **more}))


@pytest.fixture
def store(tmp_path: Path) -> DrawingStore:
    return _open(tmp_path)


def test_who_may_not_read_the_journal_of_the_labels_may_not_read_that_of_the_drawing(tmp_path: Path) -> None:
    write_text(tmp_path / ".journal" / "noise.jsonl", "").chmod(0o600)
    _open(tmp_path).close()
    assert (tmp_path / ".journal" / "noise.drawn.jsonl").stat().st_mode & 0o777 == 0o600


def test_a_box_is_drawn_moved_hidden_and_deleted(store: DrawingStore, tmp_path: Path) -> None:
    cup = {"name": "cup", "kind": "box"}
    _make(store, "key", **cup, at=0, place=BOX)
    _make(store, "key", **cup, at=10, place=(11.0, 2.0, 21.0, 12.004))
    (track,) = _file(tmp_path).tracks
    assert track.at(15) == (6, 2, 16, 12)
    _make(store, "outside", **cup, at=5)
    assert store.state()["tracks"] == [
        {
            "name": "cup",
            "kind": "box",
            "keys": [[0, BOX, False], [5, (6, 2, 16, 12), True], [10, (11, 2, 21, 12), False]],
        }
    ]
    assert [_file(tmp_path).tracks[0].at(frame) is not None for frame in (14, 15, 19, 20)] == [True, False, False, True]
    _make(store, "outside", **cup, at=5)
    assert _file(tmp_path).tracks[0].at(15) == (6, 2, 16, 12)
    _make(store, "delete", **cup, at=0)
    _make(store, "remove", **cup)
    assert _file(tmp_path) == Drawn()
    store.close()


def test_all_is_there_again_after_a_kill_and_can_be_undone(store: DrawingStore, tmp_path: Path) -> None:
    _make(store, "key", name="cup", kind="box", at=0, place=BOX)
    _make(store, "key", name="ann", kind="head", at=3, place=BOX)
    before = (tmp_path / "noise.drawn.csv").read_bytes()
    _make(store, "key", name="cup", kind="box", at=0, place=(0, 0, 5, 5))
    revision = store.revision
    store.close()
    (tmp_path / "noise.drawn.csv").write_bytes(before)
    os.utime(tmp_path / ".journal" / "noise.drawn.jsonl")  # changed last: a kill between the journal and the file
    again = _open(tmp_path)
    assert again.revision == revision
    ann, cup = _file(tmp_path).tracks
    assert (ann.name, cup.keys) == ("ann", (KeyFrame(frame=10, place=(0, 0, 5, 5)),))
    for _ in range(3):
        _make(again, "undo")
    assert _file(tmp_path) == Drawn()
    for _ in range(2):
        _make(again, "redo")
    assert (tmp_path / "noise.drawn.csv").read_bytes() == before
    again.close()


def test_what_was_drawn_elsewhere_wins(store: DrawingStore, tmp_path: Path) -> None:
    _make(store, "key", name="cup", kind="box", at=0, place=BOX)
    write_drawn(tmp_path / "noise.drawn.csv", Drawn())
    with pytest.raises(StaleRevisionError):
        store.draw(Draw(do="key", name="cup", at=1, place=BOX))
    assert store.state()["tracks"] == []
    assert store.last_step("undo") is None
    store.close()


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        ({"do": "key", "name": "cpu", "place": BOX}, r"'cpu'.*'cup'"),
        ({"do": "key", "name": "cup", "kind": "head", "place": BOX}, "'cup' is not a subject"),
        ({"do": "key", "name": "cup", "kind": "point", "place": (1, 2)}, "'cup' is already drawn as a box"),
        ({"do": "key", "name": "cup", "at": 20, "place": BOX}, r"position 20 .*0 to 19"),
        ({"do": "key", "name": "cup", "place": (5, 2, 1, 12)}, "expected u0 < u1"),
        ({"do": "key", "name": "cup", "place": (5, 2)}, "expected u0, v0, u1, v1"),
        ({"do": "outside", "name": "book"}, "'book' is not drawn"),
    ],
)
def test_what_cannot_be_drawn_is_one_line(store: DrawingStore, draw: dict[str, Any], message: str) -> None:
    _make(store, "key", name="cup", kind="box", at=0, place=BOX)
    with pytest.raises(VfoaError, match=message):
        _make(store, **draw)
    store.close()


def test_two_processes_do_not_draw_on_one_clip(store: DrawingStore, tmp_path: Path) -> None:
    _make(store, "key", name="cup", kind="box", at=0, place=BOX)
    other = _open(tmp_path)
    assert "is being labelled by another vfoa annotate" in (other.read_only or "")
    assert other.state()["tracks"] == store.state()["tracks"]
    with pytest.raises(VfoaError, match="another vfoa annotate"):
        _make(other, "remove", name="cup", kind="box")
    other.close()
    store.close()


def test_what_is_drawn_goes_with_a_target_that_is_renamed_or_deleted(work: Path) -> None:
    write_text(
        work / "annotations" / "noise.drawn.csv",
        f"# vfoa drawn 1\n{','.join(COLUMNS)}\n1,cup,box,1,2,11,12,\n1,ann,head,1,2,11,12,\n",
    )
    session = Session(str(work / "datasets" / "noise.toml"))
    try:
        colour = session.about()["looks"]["cup"]["colour"]
        session.change_target("cup", new_name="mug", key=None, colour=colour)
        assert [each["name"] for each in session.drawn()["tracks"]] == ["ann", "mug"]
        session.make(Action(kind="draw", draw=Draw(name="mug", at=2, place=BOX)))
        session.delete_target("mug", None)
        assert [each["name"] for each in session.drawn()["tracks"]] == ["ann"]
    finally:
        session.close()


class Machine(RuleBasedStateMachine):
    """Whatever is drawn, undone and redone: the file has it, and a new start has it."""

    folders: Any = None

    @initialize(seed=st.integers(0, 10**9))
    def start(self, seed: int) -> None:
        self.folder = self.folders.mktemp("drawn")
        self.store = _open(self.folder)

    @rule(
        do=st.sampled_from(["key", "key", "key", "outside", "delete", "remove"]),
        name=st.sampled_from(["cup", "book"]),
        at=st.integers(0, 19),
        u=st.integers(0, 50),
    )
    def draw(self, do: str, name: str, at: int, u: int) -> None:
        if do != "outside" or name in self.store.content().names:
            _make(self.store, do, name=name, kind="box", at=at, place=(u, 1, u + 5, 9) if do == "key" else ())

    @rule(do=st.sampled_from(["undo", "redo"]))
    def back(self, do: str) -> None:
        before = self.store.content()
        can = self.store.last_step(do) is not None
        _make(self.store, do)
        assert can or self.store.content() == before
        if can:
            _make(self.store, "redo" if do == "undo" else "undo")
            assert self.store.content() == before
            _make(self.store, do)

    @rule()
    def restart(self) -> None:
        before = self.store.state()
        self.store.close()
        self.store = _open(self.folder)
        assert self.store.state() == before

    @invariant()
    def the_file_has_it(self) -> None:
        if hasattr(self, "store") and (self.folder / "noise.drawn.csv").is_file():
            assert _file(self.folder) == self.store.content()

    def teardown(self) -> None:
        if hasattr(self, "store"):
            self.store.close()


@pytest.fixture(autouse=True)
def _folders(tmp_path_factory: pytest.TempPathFactory) -> None:
    Machine.folders = tmp_path_factory


TestMachine = Machine.TestCase
TestMachine.settings = settings(max_examples=8, stateful_step_count=20, deadline=None)
