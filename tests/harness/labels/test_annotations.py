from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from harness.clips.manifest import load_manifest
from harness.labels.files import read_annotations, write_annotations
from harness.labels.labels import Label, LabelRange, Labels, Timeline, ranges_of
from tests.disk import write_bytes, write_text
from tests.repository import REPOSITORY
from vfoa.errors import VfoaError

HEAD = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note\n"
POINT_HEAD = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note,u_px,v_px\n"
STATE_HEAD = "# vfoa annotations 1\nfirst_frame,last_frame,subject,target,note,state\n"
TIME_HEAD = "# vfoa annotations 1\nstart_s,end_s,subject,target,note\n"


SUBJECTS, TARGETS = ["girl", "boy"], ["bird", "cup"]


def _timeline(frames: Sequence[int] = range(1, 51)) -> Timeline:
    """Frames at 10 Hz, frame n at n / 10 s."""
    return Timeline(frames=frames, times_ns=[number * 100_000_000 for number in frames])


def _read(path: Path, frames: Sequence[int] = range(1, 51), *, allow_gaps: bool = False) -> Labels:
    return read_annotations(path, timeline=_timeline(frames), subjects=SUBJECTS, targets=TARGETS, allow_gaps=allow_gaps)


def test_a_range_holds_for_each_of_its_frames_and_no_other(tmp_path: Path) -> None:
    labels = _read(write_text(tmp_path / "a.csv", HEAD + "3,4,girl,bird,\n5,5,girl,none,eyes shut\n"))
    assert [labels.at(frame, "girl") for frame in range(2, 7)] == [
        None,
        Label(target="bird"),
        Label(target="bird"),
        Label(target="none", note="eyes shut"),
        None,
    ]
    assert labels.at(3, "boy") is None


def test_people_are_targets_and_rows_come_in_any_order(tmp_path: Path) -> None:
    labels = _read(write_text(tmp_path / "a.csv", HEAD + "5,9,girl,boy,\n1,4,girl,ignore,\n1,1,boy,girl,\n"))
    assert [(frame, who, label.target) for frame, who, label in labels.labelled([1, 5])] == [
        (1, "boy", "girl"),
        (1, "girl", "ignore"),
        (5, "girl", "boy"),
    ]


def test_subjects_are_sorted_whoever_has_the_first_label(tmp_path: Path) -> None:
    labels = _read(write_text(tmp_path / "a.csv", HEAD + "1,9,girl,cup,\n5,9,boy,cup,\n"))
    assert labels.subjects == ("boy", "girl")
    assert [(frame, who) for frame, who, _ in labels.labelled([9, 4, 5])] == [
        (9, "boy"),
        (9, "girl"),
        (4, "girl"),
        (5, "boy"),
        (5, "girl"),
    ]


def test_a_point_tells_two_targets_of_one_name_apart(tmp_path: Path) -> None:
    labels = _read(write_text(tmp_path / "a.csv", POINT_HEAD + "1,1,girl,cup,,12.5,40\n2,2,girl,cup,,,\n"))
    assert labels.at(1, "girl") == Label(target="cup", point_px=(12.5, 40.0))
    assert labels.at(2, "girl") == Label(target="cup")


def test_a_mark_crlf_and_blank_lines_change_nothing(tmp_path: Path) -> None:
    text = HEAD + '1,2,girl,bird,"a, b"\n'
    plain = _read(write_text(tmp_path / "a.csv", text))
    windows = _read(write_bytes(tmp_path / "b.csv", b"\xef\xbb\xbf" + (text + "\n\n").replace("\n", "\r\n").encode()))
    assert windows == plain
    assert plain.at(1, "girl") == Label(target="bird", note="a, b")


def test_a_range_of_time_holds_for_the_frames_whose_time_lies_in_it(tmp_path: Path) -> None:
    labels = _read(write_text(tmp_path / "a.csv", TIME_HEAD + "0.15,0.5,girl,bird,\n0.5,0.75,girl,cup,\n"))
    assert [(each.first_frame, each.last_frame, each.label.target) for each in labels.of("girl")] == [
        (2, 4, "bird"),  # frame 5, at 0.5 s, belongs to the range that begins there
        (5, 7, "cup"),
    ]


def test_stamps_of_today_are_exact_to_the_nanosecond(tmp_path: Path) -> None:
    times = [1_763_680_000_123_456_788 + n for n in (0, 1, 2)]
    path = write_text(tmp_path / "a.csv", TIME_HEAD + "1763680000.123456789,1763680000.12345679,girl,bird,\n")
    timeline = Timeline(frames=[1, 2, 3], times_ns=times)
    labels = read_annotations(path, timeline=timeline, subjects=SUBJECTS, targets=TARGETS)
    assert [(each.first_frame, each.last_frame) for each in labels.ranges] == [(2, 2)]


@pytest.mark.parametrize("timeline", [None, Timeline(frames=[1, 2], times_ns=[])])
def test_ranges_of_time_need_a_clip_that_can_be_opened(tmp_path: Path, timeline: Timeline | None) -> None:
    path = write_text(tmp_path / "a.csv", TIME_HEAD + "0,1,girl,bird,\n")
    with pytest.raises(VfoaError, match=r"a\.csv:2: .*frame times"):
        read_annotations(path, timeline=timeline, subjects=SUBJECTS, targets=TARGETS)


def test_without_a_clip_every_number_between_two_ranges_is_a_frame(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", HEAD + "1,5,girl,bird,\n6,6,girl,cup,\n9,9,girl,cup,\n")
    with pytest.raises(VfoaError, match=r"a\.csv:5: 'girl' .* 7 to 8, .*:4"):
        read_annotations(path, timeline=None, subjects=SUBJECTS, targets=TARGETS)


def test_ranges_are_written_by_time_only_where_all_have_one(tmp_path: Path) -> None:
    bird = Label(target="bird")
    timed = LabelRange(first_frame=1, last_frame=2, subject="girl", label=bird, span_ns=(0, 2 * 10**9))
    untimed = LabelRange(first_frame=3, last_frame=3, subject="girl", label=bird)
    for ranges, rows in (
        ([], [HEAD]),
        ([timed], [TIME_HEAD, "0,2,girl,bird,\n"]),
        ([timed, untimed], [HEAD, "1,2,girl,bird,\n", "3,3,girl,bird,\n"]),
    ):
        write_annotations(tmp_path / "a.csv", Labels(ranges))
        assert (tmp_path / "a.csv").read_text() == "".join(rows)


def test_of_a_clip_known_in_part_only_that_part_is_checked(tmp_path: Path) -> None:
    part = Timeline(frames=[1, 2], times_ns=[0, 100_000_000], is_whole=False)
    in_time = write_text(tmp_path / "a.csv", TIME_HEAD + "0,0.1,girl,bird,\n0.1,9,girl,cup,\n9,10,girl,bird,\n")
    in_frames = write_text(tmp_path / "b.csv", HEAD + "1,1,girl,bird,\n2,90,girl,cup,\n91,99,girl,bird,\n")
    for path in (in_time, in_frames):
        labels = read_annotations(path, timeline=part, subjects=SUBJECTS, targets=TARGETS)
        assert [label.target for _, _, label in labels.labelled(part.frames)] == ["bird", "cup"]


def test_a_gap_is_taken_from_work_that_is_not_finished(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", HEAD + "1,5,girl,bird,\n8,9,girl,cup,\n")
    assert _read(path, allow_gaps=True).at(6, "girl") is None
    with pytest.raises(VfoaError, match="no label for frames 6 to 7"):
        _read(path)


def test_stamps_that_a_spreadsheet_program_rounded_name_the_columns_in_seconds(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", HEAD + "1.76432E+18,1.76432E+18,girl,bird,\n")
    with pytest.raises(VfoaError, match=r"a\.csv:3: first_frame: .*start_s and end_s"):
        _read(path)


def test_a_suggestion_never_counts(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", STATE_HEAD + "1,2,girl,bird,,suggested\n3,4,girl,bird,,\n")
    labels = _read(path)
    assert [label.is_suggested for _, _, label in labels.labelled(range(1, 5))] == [True, True, False, False]
    confirmed = [label for _, _, label in labels.confirmed().labelled(range(1, 5))]
    unsaid, said = Label(target="ignore", note="suggested: bird"), Label(target="bird")
    assert confirmed == [unsaid, unsaid, said, said]
    assert labels.confirmed() != labels


def test_tags_are_words_in_any_order(tmp_path: Path) -> None:
    head = HEAD.replace("note\n", "note,tag,state\n")
    path = write_text(tmp_path / "a.csv", head + "1,2,girl,bird,,far  child far,suggested\n3,4,girl,bird,,,\n")
    assert [label.tags for _, _, label in _read(path).labelled((1, 3))] == [("child", "far"), ()]
    wrong = write_text(tmp_path / "b.csv", head + '1,2,girl,bird,,"far,child",\n')
    with pytest.raises(VfoaError, match=r"b\.csv:3: tag: found 'far,child'"):
        _read(wrong)


@pytest.mark.parametrize("ends", [[(1, 5), (5, 6)], [(3, 2)]])
def test_labels_that_contradict_themselves_cannot_be_built(ends: list[tuple[int, int]]) -> None:
    label = Label(target="bird")
    with pytest.raises(ValueError, match="overlaps"):
        Labels(LabelRange(first_frame=first, last_frame=last, subject="girl", label=label) for first, last in ends)


def test_a_run_of_equal_labels_is_a_range() -> None:
    bird, cup = Label(target="bird"), Label(target="cup")
    found = ranges_of("girl", [(1, None), (2, bird), (4, bird), (5, cup), (6, None), (7, cup)])
    assert [(each.first_frame, each.last_frame, each.label) for each in found] == [
        (2, 4, bird),
        (5, 5, cup),
        (7, 7, cup),
    ]


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_a_file_that_a_spreadsheet_program_saved_has_the_same_labels(tmp_path: Path, separator: str, end: str) -> None:
    rows = [
        ["# vfoa annotations 1", "", "", "", "", ""],
        ["first_frame", "last_frame", "subject", "target", "note", ""],
        ["3", "4", "girl", "bird", '"far, small; here"', ""],
        ["", "", "", "", "", ""],
        ["5", "5", "girl", "none", "", ""],
    ]
    text = "".join(separator.join(row) + end for row in rows)
    labels = _read(write_bytes(tmp_path / "a.csv", text.encode("utf-8-sig")))
    assert [(each.first_frame, each.last_frame, each.label) for each in labels.ranges] == [
        (3, 4, Label(target="bird", note="far, small; here")),
        (5, 5, Label(target="none")),
    ]
    with pytest.raises(VfoaError, match=r"a\.csv:6: unknown target 'brid'"):
        _read(write_text(tmp_path / "a.csv", text + separator.join(["6", "7", "girl", "brid", "", ""])))


def test_the_earlier_name_of_a_renamed_target_is_answered_with_its_name_now(tmp_path: Path) -> None:
    manifest = write_text(
        tmp_path / "datasets" / "clip.toml",
        'name = "clip"\nadapter = "stereo_folder"\n[subjects.girl]\ncategory = "person"\n'
        '[targets.eagle]\ncategory = "bird"\nformerly = ["bird"]\n',
    )
    path = write_text(tmp_path / "a.csv", HEAD + "1,5,girl,bird,\n")
    with pytest.raises(VfoaError, match=r"a\.csv:3: unknown target 'bird'; .*'eagle' now"):
        load_manifest(str(manifest)).read(path, _timeline(range(1, 51)))


@pytest.mark.parametrize(("separator", "quote"), [(";", ""), ("\t", ""), (",", '"')])
def test_decimal_commas_are_numbers_and_none_in_a_note(tmp_path: Path, separator: str, quote: str) -> None:
    head = ["start_s", "end_s", "subject", "target", "note", "u_px", "v_px"]
    row = ["0,25", "1", "girl", "cup", "1,5", "12,5", "40"]
    text = "\n".join(separator.join(f"{quote}{cell}{quote}" for cell in cells) for cells in (head, row))
    (found,) = _read(write_text(tmp_path / "a.csv", f"# vfoa annotations 1\n{text}\n")).ranges
    assert found.span_ns == (250_000_000, 1_000_000_000)
    assert found.label == Label(target="cup", note="1,5", point_px=(12.5, 40.0))


@pytest.mark.parametrize(
    ("start_ns", "rate_hz", "written"),
    [
        (0, 30.0, "{:.3f}"),
        (0, 30_000 / 1001, "{:.3f}"),
        (1_700_000_000_033_366_789, 29.97, "{!r}"),  # a float has 7 decimals of seconds since 1970
        (1_700_000_000_033_366_789, 29.97, "{:.15g}"),  # a spreadsheet program has 5
        (0, 3000.0, "{:.6f}"),
    ],
)
def test_rounded_times_are_those_of_the_frames(start_ns: int, rate_hz: float, written: str, tmp_path: Path) -> None:
    times_ns = [start_ns + round(place * 1e9 / rate_hz) for place in range(30)]
    ends = [written.format(time_ns / 1e9) for time_ns in times_ns]
    rows = "".join(f"{start},{end},girl,{TARGETS[n % 2]},\n" for n, (start, end) in enumerate(pairwise(ends)))
    path = write_text(tmp_path / "a.csv", TIME_HEAD + rows)
    timeline = Timeline(frames=range(30), times_ns=times_ns)
    labels = read_annotations(path, timeline=timeline, subjects=SUBJECTS, targets=TARGETS)
    assert [(each.first_frame, each.last_frame) for each in labels.ranges] == [(n, n) for n in range(29)]


@pytest.mark.parametrize(
    ("rows", "line", "message"),
    [
        ("1,5,girl,bird,\n5,9,girl,cup,\n", 4, r"frame 5: overlaps .*:3"),
        ("5,9,girl,cup,\n1,5,girl,bird,\n", 4, "overlaps with .*:3"),
        ("1,5,girl,bird,\n8,9,girl,cup,\n", 4, "no label for frames 6 to 7, after .*:3"),
        ("1,5,gril,bird,\n", 3, r"subject 'gril'.*'girl'"),
        ("1,5,girl,brid,\n", 3, r"target 'brid'.*'bird'"),
        ("1,5,girl,girl,\n", 3, "looks at 'girl'"),
        ("1,51,girl,bird,\n", 3, r"frame 51 .*1 to 50"),
        ("0,5,girl,bird,\n", 3, "frame 0 is outside"),
        ("5,1,girl,bird,\n", 3, "first_frame 5 comes after last_frame 1"),
        ("1.0,5,girl,bird,\n", 3, "first_frame: found '1.0'"),
        ("1,,girl,bird,\n", 3, "last_frame: found ''"),
        ("1,5,girl,bird\n", 3, "found 4 cells; expected 5"),
        ('1,5,girl,bird,"open\n', 3, "not CSV"),
        ('1,5,girl,bird,"two\nlines"\n', 4, "control character"),
        ("1,5,girl,bird,blinks\ufffe\n", 3, "control character"),
        ("\n1,5,girl,brid,\n", 4, "unknown target"),
    ],
)
def test_a_mistake_is_named_with_its_line(tmp_path: Path, rows: str, line: int, message: str) -> None:
    path = write_text(tmp_path / "a.csv", HEAD + rows)
    with pytest.raises(VfoaError, match=message) as error:
        _read(path)
    assert str(error.value).startswith(f"{path}:{line}: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", r"a\.csv:1: found ''.*'# vfoa annotations"),
        (b"# vfoa annotations 2\n", r"a\.csv:1: found '# vfoa annotations 2'"),
        (b"frame,subject,target\n", r"a\.csv:1: found 'frame,subject,target'.*'# vfoa annotations 1'.*--format table"),
        (b"# vfoa annotations 1\n", r"a\.csv:2: no header"),
        (b"# vfoa annotations 1\nfirst_frame;last_frame\n", r"a\.csv:2: header 'first_frame,last_frame'"),
        (b"# vfoa annotations 10,,\n", r"a\.csv:1: found '# vfoa annotations 10,,'"),
        (b"# vfoa annotations 1;x\n", r"a\.csv:1: found '# vfoa annotations 1;x'"),
        (HEAD.encode() + b"1,2,girl,bird,caf\xe9\n", r"a\.csv:3: not UTF-8 .*0xe9"),
        (POINT_HEAD.replace(",v_px", "").encode() + b"1,2,girl,bird,,5\n", r"a\.csv:2: header .*u_px'"),
        (POINT_HEAD.encode() + b"1,2,girl,bird,,5,\n", r"a\.csv:3: u_px,v_px: found '5,'"),
        (POINT_HEAD.encode() + b"1,2,girl,bird,,5,nan\n", r"a\.csv:3: u_px,v_px"),
        (STATE_HEAD.encode() + b"1,2,girl,bird,,maybe\n", r"a\.csv:3: state: found 'maybe'"),
        (TIME_HEAD.encode() + b"1,1,girl,bird,\n", r"a\.csv:3: start_s 1 .*end_s 1"),
        (TIME_HEAD.encode() + b"1,x,girl,bird,\n", r"a\.csv:3: end_s: found 'x'"),
        (TIME_HEAD.encode() + b"0.11,0.19,girl,bird,\n", r"a\.csv:3: .*0\.11 to 0\.19 s"),
        (TIME_HEAD.encode() + b"6,7,girl,bird,\n", r"a\.csv:3: no frame .* 0\.1 to 5 s"),
        (TIME_HEAD.encode() + b"0,1,girl,bird,\n0.9,2,girl,cup,\n", r"a\.csv:4: 'girl' .*frame 9"),
        (TIME_HEAD.encode() + b"0,1,girl,bird,\n1.1,2,girl,cup,\n", r"a\.csv:4: .*frames 10 to 10"),
        (b"# vfoa annotations 1\nstart_s,last_frame,subject,target,note\n", r"a\.csv:2: header 'start_s,last_frame"),
    ],
)
def test_another_format_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        _read(write_bytes(tmp_path / "a.csv", content))


def test_frames_that_the_clip_does_not_have_need_no_label(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", HEAD + "1,2,girl,bird,\n6,7,girl,bird,\n")
    assert len(list(_read(path, [1, 2, 6, 7]).labelled([1, 2, 6, 7]))) == 4
    with pytest.raises(VfoaError, match="no label for frames 4 to 4"):
        _read(path, [1, 2, 4, 6, 7])


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"gone\.csv: no such file"):
        _read(tmp_path / "gone.csv")


NOTES = st.text(" a\u0301,;'\"#é漢\x85\u2028\ufeff", max_size=12)
POINTS = st.none() | st.tuples(*[st.floats(-1e6, 1e6, allow_nan=False)] * 2)
LABELS = st.builds(
    Label,
    target=st.sampled_from(["bird", "cup", "none", "ignore"]),
    note=NOTES,
    point_px=POINTS,
    is_suggested=st.booleans(),
    tags=st.sets(st.sampled_from(["child", "far", "x-1.5"])).map(sorted).map(tuple),
)


@st.composite
def labels_of_a_clip(draw: st.DrawFn) -> Labels:
    in_time, timeline, ranges = draw(st.booleans()), _timeline(), []
    for subject in draw(st.lists(st.sampled_from(SUBJECTS), unique=True)):
        first = draw(st.integers(1, 10))
        for length in draw(st.lists(st.integers(1, 6), max_size=6)):
            last, label = first + length - 1, draw(LABELS)
            span_ns = timeline.span_ns(first, last) if in_time else None
            ranges.append(LabelRange(first_frame=first, last_frame=last, subject=subject, label=label, span_ns=span_ns))
            first += length
    return Labels(ranges)


@given(labels=labels_of_a_clip())
def test_what_is_written_is_read_again_byte_for_byte(tmp_path: Path, labels: Labels) -> None:
    path = tmp_path / "a.csv"
    write_annotations(path, labels)
    first = path.read_bytes()
    again = _read(path)
    assert again == labels
    write_annotations(path, again)
    assert path.read_bytes() == first


def test_a_note_of_two_lines_is_refused_and_the_old_file_stays(tmp_path: Path) -> None:
    path = write_text(tmp_path / "a.csv", HEAD)
    label = Label(target="bird", note="two\nlines")
    with pytest.raises(VfoaError, match="control character"):
        write_annotations(path, Labels([LabelRange(first_frame=1, last_frame=1, subject="girl", label=label)]))
    assert path.read_text() == HEAD
    assert list(tmp_path.iterdir()) == [path]


def test_the_labels_of_bandage_2_are_canonical(tmp_path: Path) -> None:
    source = REPOSITORY / "annotations" / "sintel_bandage_2.csv"
    labels = _read(source)
    assert [label.target for _, _, label in labels.labelled(range(1, 51))] == ["bird"] * 50
    assert [frame for frame, _, label in labels.labelled(range(1, 51)) if label.note == "eyes shut"] == [7, 8]
    write_annotations(tmp_path / "a.csv", labels)
    assert (tmp_path / "a.csv").read_bytes() == source.read_bytes()


def test_tens_of_thousands_of_rows_are_read(tmp_path: Path) -> None:
    rows = "".join(f"{n},{n},girl,{TARGETS[n % 2]},\n" for n in range(1, 30_001))
    labels = _read(write_text(tmp_path / "a.csv", HEAD + rows), range(1, 30_001))
    assert len(labels.ranges) == 30_000
    with pytest.raises(VfoaError, match=r"a\.csv:30003: .*frame 7: .*:9"):
        _read(write_text(tmp_path / "a.csv", HEAD + rows + "7,7,girl,bird,\n"), range(1, 30_001))
