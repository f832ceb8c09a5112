"""``vfoa labels`` as its user meets it, on a rendered clip."""

from __future__ import annotations

import errno
import json
import os
from collections import Counter
from contextlib import closing
from pathlib import Path

import pytest

from harness.annotate.history import History
from harness.clips.manifest import load_manifest
from harness.labels.labels import timeline_of
from tests.command import vfoa
from tests.disk import labels_text, write_text
from tests.exchanges import cvat_box, cvat_document, cvat_track
from tests.measured import MANIFEST, measured_tables, true_labels
from tests.repository import REPOSITORY, copy_clip

CLIP = "studio_talk"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with a clip, the labels of two annotators, and those of none."""
    copy_clip(CLIP, tmp_path)
    text = (tmp_path / "annotations" / f"{CLIP}.csv").read_text()
    write_text(tmp_path / "annotations" / f"{CLIP}@anna.csv", text)
    write_text(tmp_path / "annotations" / f"{CLIP}@ben.csv", text.replace("ben,bear", "ben,none"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VFOA_CACHE", str(tmp_path / "cache"))
    return tmp_path


@pytest.mark.parametrize(("name", "more"), [("elan", ("--offset", "3")), ("csv", ())])
def test_labels_go_out_and_come_back(
    name: str, more: tuple[str, ...], folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    where = ("--format", name, *more)
    assert vfoa(monkeypatch, capsys, "labels", "export", CLIP, "out", *where)[0] == 0
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "import", "out", "--clip", CLIP, "--annotator", "cat", *where)
    assert code == 0
    assert "16 ranges of anna, ben" in out
    labels = folder / "annotations"
    assert (labels / f"{CLIP}@cat.csv").read_bytes() == (labels / f"{CLIP}.csv").read_bytes()


def test_a_table_of_ones_own_in_the_place_of_the_labels_is_imported_from_elsewhere(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = folder / "annotations" / f"{CLIP}.csv"
    table = write_text(labels, "frame,subject,target\n1,anna,ben\n2,anna,ben\n")
    code, _, said = vfoa(monkeypatch, capsys, "labels", "check", CLIP)
    assert (code, said.count("\n")) == (2, 1)
    command = "labels import TABLE --clip CLIP --format table"
    assert said.endswith(f"move it elsewhere, then vfoa {command}\n")
    table.rename(folder / "own.csv")
    words = [{"TABLE": "own.csv", "CLIP": CLIP}.get(word, word) for word in command.split()]
    assert vfoa(monkeypatch, capsys, *words)[0] == 0
    assert f"{labels}: 1 range of anna\n" in vfoa(monkeypatch, capsys, "labels", "check", CLIP)[1]


def test_a_check_counts_the_ranges_of_each_subject(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = folder / "annotations" / f"{CLIP}@cat.csv"
    write_text(path, "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n1,2,anna,none,\n")
    said = vfoa(monkeypatch, capsys, "labels", "check", CLIP, "--annotator", "cat")
    assert said == (0, f"{path}: 1 range of anna\n", "")


def test_a_check_of_a_clip_without_labels_fails(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = folder / "annotations"
    for path in labels.iterdir():  # under a name that is not the clip's
        path.rename(labels / path.name.replace(CLIP, f"{CLIP}s"))
    missing = f"vfoa: {CLIP}: no annotations; expected {labels / f'{CLIP}.csv'}\n"
    assert vfoa(monkeypatch, capsys, "labels", "check", CLIP) == (2, "", missing)
    shapes = write_text(
        labels / f"{CLIP}.drawn.csv",
        "# vfoa drawn 1\nframe,name,kind,u0_px,v0_px,u1_px,v1_px,outside\n1,bear,point,9,9,,,\n",
    )
    code, said, _ = vfoa(monkeypatch, capsys, "labels", "check", CLIP)
    assert (code, said.count("\n")) == (0, 1)
    assert said.startswith(f"{shapes}: ")


def test_a_check_names_the_files_that_it_has_read(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, said, _ = vfoa(monkeypatch, capsys, "labels", "check", "demo_talk")  # came with the program
    files = [Path(line.rpartition(": ")[0]) for line in said.splitlines()]
    assert (code, [file.name for file in files]) == (0, ["demo_talk.csv"])
    assert files[0].is_file()


def test_an_existing_file_is_not_written_over(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mine = write_text(folder / "mine.csv", "mine")
    code, _, said = vfoa(monkeypatch, capsys, "labels", "export", CLIP, "mine.csv", "--format", "elan")
    assert (code, mine.read_text()) == (2, "mine")
    assert "exists already; expected --replace" in said


def test_an_input_is_not_replaced(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    labels = folder / "annotations"
    other, manifest = labels / f"{CLIP}@anna.csv", folder / "datasets" / f"{CLIP}.toml"
    write_text(folder / "experiment.toml", f'preset = "measured"\nclips = ["{CLIP}"]\n')
    for words in (
        ("labels", "export", CLIP, str(labels / f"{CLIP}.csv"), "--format", "csv"),
        ("labels", "export", CLIP, str(other), "--format", "elan"),
        ("labels", "import", str(other), "--clip", CLIP, "--annotator", "anna", "--format", "csv"),
        ("fit", "experiment.toml", "--out", str(manifest)),
        ("fit", "experiment.toml", "--out", "experiment.toml"),
    ):
        before = {path: path.read_bytes() for path in (*labels.glob("*.csv"), manifest)}
        code, _, said = vfoa(monkeypatch, capsys, *words, "--replace")
        assert (code, said.count("\n")) == (2, 1)
        assert "this command reads it" in said
        assert {path: path.read_bytes() for path in before} == before


def test_a_second_file_adds_the_labels_of_other_frames(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def imported(*rows: str, refused: str = "") -> list[str]:
        write_text(folder / "looks.csv", "\n".join(["frame,subject,target", *rows]) + "\n")
        words = ("labels", "import", "looks.csv", "--format", "table", "--clip", CLIP, "--annotator", "new")
        code, _, said = vfoa(monkeypatch, capsys, *words)
        assert (code, refused in said) == (2 if refused else 0, True)
        return (folder / "annotations" / f"{CLIP}@new.csv").read_text().splitlines()[2:]

    imported("1,anna,mug", "4,anna,bear", "1,ben,bowl")
    todo = "ignore,not labelled yet"
    expected = ["1,1,anna,mug,", "1,1,ben,bowl,", "2,2,anna,none,", f"3,3,anna,{todo}", "4,4,anna,bear,"]
    assert imported("2,anna,none", "6,anna,mug") == [*expected, f"5,5,anna,{todo}", "6,6,anna,mug,"]
    before = imported("3,anna,mug")
    assert imported("6,anna,bowl", "7,anna,bowl", refused="also of frame 6") == before
    assert "3,3,anna,mug," in before
    assert vfoa(monkeypatch, capsys, "labels", "undo", CLIP, "--annotator", "new")[0] == 0
    assert (folder / "annotations" / f"{CLIP}@new.csv").read_text().splitlines()[2:5] == expected[:3]


def test_an_import_replaces_only_subjects_of_the_file_and_can_be_undone(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own, anna = folder / "annotations" / f"{CLIP}.csv", folder / "annotations" / f"{CLIP}@new.csv"
    head, columns, *rows = own.read_text().splitlines()

    def of(subject: str, among: list[str]) -> list[str]:
        return [row for row in among if row.split(",")[2] == subject]

    write_text(anna, "\n".join([head, columns, *of("anna", rows)]) + "\n")
    words = ("labels", "export", CLIP, "anna.eaf", "--format", "elan", "--annotator", "new")
    assert vfoa(monkeypatch, capsys, *words)[0] == 0
    words = ("labels", "import", "anna.eaf", "--clip", CLIP)
    ignored = f"{rows[0].split(',')[0]},{rows[-1].split(',')[1]}"
    todo = [f"{ignored},{subject},ignore,not labelled yet" for subject in ("anna", "ben")]
    write_text(own, "\n".join([head, columns, *todo]) + "\n")
    assert vfoa(monkeypatch, capsys, *words)[0] == 0, "frames that nobody has labelled are no labels"
    write_text(own, "\n".join([head, columns, *of("ben", rows)]) + "\n")
    assert vfoa(monkeypatch, capsys, *words)[::2] == (0, ""), "the other subject's labels are not touched"
    assert own.read_text().splitlines() == [head, columns, *rows]
    theirs = [row.replace(",bear,", ",none,") for row in rows]
    write_text(own, "\n".join([head, columns, *theirs]) + "\n")
    code, _, said = vfoa(monkeypatch, capsys, *words)
    assert (code, said.count("\n")) == (2, 1)
    assert "has labels of anna (" in said
    assert own.read_text().splitlines()[2:] == theirs
    code, _, said = vfoa(monkeypatch, capsys, *words, "--replace")
    assert code == 0
    assert "replaced the labels of anna (" in said
    new = Counter(own.read_text().splitlines()[2:])
    assert new == Counter([*of("anna", rows), *of("ben", theirs)])
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "undo", CLIP)
    assert (code, out) == (0, f"{own}: labels of anna undone\n")
    assert own.read_text().splitlines()[2:] == theirs


def test_shapes_of_another_program_are_drawn_on_the_clip(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """CVAT's boxes become drawn shapes, and its attribute labels, beside those that are there."""
    drawn, own = folder / "annotations" / f"{CLIP}.drawn.csv", folder / "annotations" / f"{CLIP}@new.csv"
    frame = load_manifest(CLIP).open_images().frame(1)
    size = (frame.rig.width_px, frame.rig.height_px)

    def written(left: int, size: tuple[int, int], **looks: str) -> Path:
        boxes = [cvat_box(at, (left, 5, left + 20, 30), **looks) for at in range(3)]
        return write_text(folder / "annotations.xml", cvat_document(cvat_track("anna", *boxes), size=size))

    words = ("labels", "import", str(written(10, size, looks_at="bear")), "--clip", CLIP, "--format", "cvat")
    words = (*words, "--annotator", "new")
    code, out, _ = vfoa(monkeypatch, capsys, *words)
    assert (code, out) == (0, f"{own}: 1 range of anna\n{drawn}: anna (box) 3\n")
    first = drawn.read_text()
    assert first.splitlines()[2:] == [f"{at},anna,box,9.5,4.5,29.5,29.5," for at in (1, 2, 3)]
    assert own.read_text().splitlines()[2:] == ["1,3,anna,bear,"]
    written(40, size)
    code, _, said = vfoa(monkeypatch, capsys, *words)
    assert (code, said.count("\n"), drawn.read_text()) == (2, 1, first)
    assert said.startswith(f"vfoa: {drawn}: has box of anna already")
    assert "--annotator" not in said  # drawn shapes are those of all annotators
    assert vfoa(monkeypatch, capsys, *words, "--replace")[0] == 0
    assert "1,anna,box,39.5," in drawn.read_text()
    assert own.read_text().splitlines()[2:] == ["1,3,anna,bear,"]
    assert vfoa(monkeypatch, capsys, "labels", "undo", CLIP, "--annotator", "new")[0] == 0
    assert drawn.read_text() == first
    written(70, (size[0] // 2, size[1]))
    code, _, said = vfoa(monkeypatch, capsys, *words, "--replace")
    assert (code, said.count("\n"), drawn.read_text()) == (2, 1, first)
    assert f"{size[0] // 2} x {size[1]}" in said


@pytest.mark.parametrize(
    ("box", "said"),
    [((0.1, 0.2, 0.4, 0.5), "all within one pixel"), ((0.6, 0.5, 1.3, 1.2), "3 of 3 boxes reach far beyond")],
)
def test_boxes_that_are_not_left_top_width_and_height_in_pixels_are_refused(
    box: tuple[float, ...], said: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Fractions of the image's size, or the right lower corner in place of width and height."""
    frame = load_manifest(CLIP).open_images().frame(1)
    if box[2] > 1:
        box = tuple(side * size for side, size in zip(box, 2 * (frame.rig.width_px, frame.rig.height_px), strict=True))
    images = [{"id": number, "file_name": f"{number:05d}.png"} for number in (1, 2, 3)]
    boxes = [{"image_id": number, "category_id": 1, "bbox": box} for number in (1, 2, 3)]
    content = {"images": images, "categories": [{"id": 1, "name": "anna"}], "annotations": boxes}
    source = write_text(folder / "boxes.json", json.dumps(content))
    code, _, err = vfoa(monkeypatch, capsys, "labels", "import", str(source), "--clip", CLIP, "--format", "coco")
    assert (code, err.count("\n"), said in err) == (2, 1, True), err


@pytest.fixture
def measured(folder: Path) -> Path:
    """The labels of a clip without images, beside those of another annotator."""
    write_text(folder / "datasets" / "talk.toml", MANIFEST)
    measured_tables(folder / "data" / "talk")
    write_text(folder / "annotations" / "talk@eve.csv", labels_text("1,12,anna,cup,", "1,12,ben,none,"))
    return write_text(folder / "annotations" / "talk.csv", true_labels())


def test_labels_that_are_replaced_come_back_by_the_command_that_is_printed(
    measured: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def rows() -> list[str]:
        return sorted(measured.read_text().splitlines())

    before = rows()
    words = ("annotations/talk@eve.csv", "--clip", "datasets/talk.toml", "--format", "csv")
    code, _, said = vfoa(monkeypatch, capsys, "labels", "import", *words, "--replace")
    assert code == 0
    after = rows()
    assert after != before
    assert "vfoa labels undo talk brings them back" in said
    for options, expected in (((), before), (("--redo",), after), ((), before)):
        assert vfoa(monkeypatch, capsys, "labels", "undo", "talk", *options)[0] == 0
        assert rows() == expected
    code, _, said = vfoa(monkeypatch, capsys, "labels", "undo", "talk")
    assert (code, said.count("\n"), rows()) == (2, 1, before)


def test_frames_of_a_film_beside_motion_capture_have_the_film_s_rate(
    measured: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    film = write_text(Path("film.csv"), "person,target,first_frame,last_frame\nanna,robot,10,21\nanna,ben,22,33\n")
    words = ("labels", "import", str(film), "--clip", "talk", "--format", "table", "--annotator", "film")
    assert vfoa(monkeypatch, capsys, *words, "--fps", "50", "--offset", "0.2")[0] == 0
    assert measured.with_name("talk@film.csv").read_text().splitlines()[2:] == ["1,6,anna,robot,", "7,12,anna,ben,"]


def test_undo_takes_back_a_renamed_target_of_a_clip_without_images(
    measured: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    manifest = load_manifest("talk")
    files = {path: path.read_bytes() for path in (manifest.path, measured.with_name("talk@eve.csv"))}
    with closing(History(manifest, "eve", timeline_of(manifest.open()))) as history:
        history.change_target("cup", new_name="mug", key=None, colour="olive plain")
    assert "mug" in load_manifest("talk").targets
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "undo", "talk", "--annotator", "eve")
    assert (code, out) == (0, f"{manifest.path}: targets undone\n")
    assert {path: path.read_bytes() for path in files} == files


def test_an_import_names_the_labels_that_came_with_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert vfoa(monkeypatch, capsys, "labels", "export", CLIP, "a.csv", "--format", "csv")[0] == 0
    code, _, said = vfoa(monkeypatch, capsys, "labels", "import", "a.csv", "--format", "csv", "--clip", CLIP)
    assert code == 2
    assert said.startswith(f"vfoa: {REPOSITORY / 'annotations' / CLIP}.csv: has labels of anna (")
    assert not (tmp_path / "empty" / "annotations" / f"{CLIP}.csv").exists()


def test_tables_of_agreement_are_written_all_or_none(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ("labels", "agreement", CLIP, "anna", "ben", "--out", "tables")
    asked = iter(range(3))

    def full(file: int) -> None:
        if next(asked) == 2:
            raise OSError(errno.ENOSPC, "No space left on device", "tables")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        code, _, said = vfoa(monkeypatch, capsys, *words)
    assert (code, said) == (2, "vfoa: tables: No space left on device\n")
    assert list((folder / "tables").iterdir()) == []
    assert vfoa(monkeypatch, capsys, *words)[0] == 0


def test_a_device_is_not_replaced(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    code, _, said = vfoa(monkeypatch, capsys, "labels", "export", CLIP, "/dev/full", "--format", "elan", "--replace")
    assert (code, said) == (2, "vfoa: /dev/full: not a plain file; expected a file to write\n")
    assert Path("/dev/full").is_char_device()


def test_a_pipe_is_not_written_over(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(folder / "pipe")
    code, _, said = vfoa(monkeypatch, capsys, "labels", "export", CLIP, "pipe", "--format", "elan")
    assert (code, said) == (2, "vfoa: pipe: not a plain file; expected a file to write\n")
    assert (folder / "pipe").is_fifo()


def test_a_wrong_format_is_told_by_the_files_name(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_text(folder / "anna.TextGrid", 'File type = "ooTextFile"\nObject class = "TextGrid"\n')
    for chosen, is_told in (("elan", True), ("boris", True), ("praat", False)):
        words = ("labels", "import", "anna.TextGrid", "--clip", CLIP, "--format", chosen)
        code, _, said = vfoa(monkeypatch, capsys, *words)
        assert (code, said.count("\n")) == (2, 1)
        assert ("--format praat" in said) == is_told


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("export", CLIP, "out", "--format", "elen"), "annotation format: no 'elen'; did you mean 'elan'?"),
        (("export", CLIP, "out", "--format", "elan", "--annotator", "bea"), "no annotations by 'bea'"),
        (("import", "gone", "--format", "elan", "--clip", CLIP, "--annotator", "x"), "gone: no such file"),
        (
            ("import", "gone.eaf", "--clip", CLIP, "--until-next"),
            "--until-next: is of --format table; found --format elan",
        ),
        (("import", "gone.csv", "--clip", CLIP), "gone.csv: its name does not tell what wrote it; expected --format"),
        (("import", "gone.TextGrid", "--clip", CLIP), "gone.TextGrid: no such file"),
        (("import", "gone", "--format", "elan", "--clip", CLIP, "--rename", "x"), "--rename x: expected THEIRS=OURS"),
        (
            ("import", "gone", "--format", "elan", "--clip", CLIP, "--rename", "x=mug", "--rename", "x=book"),
            "--rename: 'x' is given twice",
        ),
        (("export", CLIP, "out", "--format", "elan", "--offset", "inf"), "--offset: found inf; expected a number"),
        (("export", CLIP, "out.csv", "--format", "csv", "--fps", "5"), "out.csv: --fps 5: no effect"),
        (
            ("import", f"annotations/{CLIP}@anna.csv", "--format", "csv", "--clip", CLIP, "--offset", "3"),
            f"{CLIP}@anna.csv: --offset 3: no effect",
        ),
        (
            ("agreement", CLIP, "anna"),
            "labels: found those of anna alone; expected two annotators: --annotator NAME of `vfoa annotate`",
        ),
        (("check", CLIP, "--annotator", "bea"), "no annotations by 'bea'"),
        (("undo", CLIP, "--annotator", "bea"), "no annotations by 'bea'"),
        (("undo", CLIP), f"{CLIP}.csv: its journal has no change to undo"),
    ],
)
def test_a_wrong_word_is_one_line_and_exit_code_2(
    arguments: tuple[str, ...], line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = vfoa(monkeypatch, capsys, "labels", *arguments)
    assert code == 2
    assert line in err
    assert err.count("\n") == 1


def test_annotators_are_compared(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, _ = vfoa(monkeypatch, capsys, "labels", "agreement", CLIP, "--out", "tables")
    assert code == 0
    assert "Kappa" in out
    assert "bear,none" in (folder / "tables" / "differences.csv").read_text()
    assert (folder / "tables" / "agreement.md").read_text().count("## ") == 4


def test_of_many_differences_the_first_are_on_the_terminal_and_all_in_the_file(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    place = folder / "annotations" / f"{CLIP}@ben.csv"
    write_text(place, place.read_text().replace("anna,mug", "anna,none"))
    words = ("labels", "agreement", CLIP, "--replace", "--out", "tables")
    whole = vfoa(monkeypatch, capsys, *words)[1]
    rows = (folder / "tables" / "differences.csv").read_text().splitlines()[1:]
    assert len(rows) > 1
    assert "--out DIR" not in whole
    monkeypatch.setattr("harness.cli.terminal.MOST_ROWS", 1)
    first = vfoa(monkeypatch, capsys, *words)[1]
    assert f"The first 1 of {len(rows)} rows; --out DIR writes all." in first
    assert (folder / "tables" / "differences.csv").read_text().splitlines()[1:] == rows
