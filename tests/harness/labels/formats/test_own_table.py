"""Labels in tables of one's own: every way to say where a row holds, and what is refused."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given

from harness.labels.files import write_annotations
from harness.labels.formats import FORMATS
from harness.labels.formats.exchange import Exchange
from harness.labels.formats.idiap_vfoa import IdiapGroundTruth
from harness.labels.formats.own_table import OwnTable
from harness.labels.formats.table_columns import COLUMNS, FURTHER_COLUMNS
from harness.labels.labels import LabelRange, Labels, timeline_of
from tests.disk import write_text
from tests.exchanges import PlainClip, exchange, labels_of, row
from tests.measured import open_measured
from vfoa.errors import VfoaError

FIVE = PlainClip(frames=range(1, 6), rate_hz=10.0)
"""Frame n is shown at (n - 1) / 10 s."""
EXPECTED = Labels([row(1, 2, "bird"), row(3, 5, "none"), row(2, 2, "girl", "boy")])


def _read(folder: Path, text: str, clip: PlainClip = FIVE, **more: object) -> tuple[Labels, tuple[str, ...]]:
    imported = OwnTable().read(write_text(folder / "mine.csv", text), exchange(clip, **more))
    return imported.labels, imported.notes


@pytest.mark.parametrize(
    "text",
    [
        "first_frame,last_frame,subject,target\n1,2,girl,bird\n3,5,girl,none\n2,2,boy,girl\n",
        "End frame;Start frame;Object;Person\n2;1;bird;girl\n5;3;none;girl\n2;2;girl;boy\n",
        "subject\ttarget\tframe\n" + "".join(f"girl\t{'bird' if n < 3 else 'None'}\t{n}\n" for n in (3, 1, 2, 5, 4))
        + "boy\tgirl\t2\n",
        "who,what,start,end\ngirl,bird,0,0.2\ngirl,none,0.2,0.5\nboy,girl,0.1,0.2\n",
        "who;what;Start (s);End (s)\ngirl;bird;0;0,2\ngirl;none;0,2;0,5\nboy;girl;0,1;0,2\n",
        "who,what,start_sec,end_sec\ngirl,bird,.0,.2\ngirl,none,.2,.5\nboy,girl,.1,.2\n",
        "who,what,start_ms,end_ms\ngirl,bird,0,200\ngirl,none,200,500\nboy,girl,100,200\n",
        "onset\tduration\ttrial_type\twho\n0\t0.2\tbird\tgirl\n0.2\t0.3\tnone\tgirl\n0.1\t0.1\tgirl\tboy\n",
        "# by anna\n# talk.mp4\nwho,what,start_ms,end_ms\ngirl,bird,0,200\ngirl,none,200,500\nboy,girl,100,200\n",
        "#who,what,start_ms,end_ms\ngirl,bird,0,200\ngirl,none,200,500\nboy,girl,100,200\n",
        "who,what,start_ms,duration_ms\ngirl,bird,0,200\ngirl,none,200,300\nboy,girl,100,100\n",
        "who,what,time,duration\ngirl,bird,0,0.2\ngirl,none,0.2,0.3\nboy,girl,0.1,0.1\n",
        "who,what,time_ms,duration_ms\ngirl,bird,0,200\ngirl,none,200,300\nboy,girl,100,100\n",
        "who,what,start,end,duration\ngirl,bird,0,0.2,9\ngirl,none,0.2,0.5,9\nboy,girl,0.1,0.2,9\n",
        "who;what;start;end\ngirl;bird;0:00:00,0;0:00,2\ngirl;none;00:00:00,2;0:00,5\nboy;girl;0:00,1;0:00,2\n",
        "frame,who,bird,cup,girl\n" + "".join(f"{n},girl,{int(n < 3)},0,0\n" for n in range(1, 6)) + "2,boy,0,0,1\n",
        "time_ms,who,bird,girl\n" + "".join(f"{100 * n},girl,{n < 2},0\n" for n in range(5)) + "100,boy,False,True\n",
        "who,what,start,end\ngirl,bird,0:00:00,0:00.2\ngirl,none,00:00:00.2,0:00.5\nboy,girl,0:00.1,0:00.2\n",
        "person,looks_at,time_s\n" + "".join(f"girl,{'bird' if n < 2 else 'none'},{n / 10 + 0.03}\n" for n in range(5))
        + "boy,girl,0.1\n",
        "person\tlooks_at\tTimestamp [\u03bcs]\n"
        + "".join(f"girl\t{'bird' if n < 2 else 'none'}\t{n * 100_000 + 30_001}\n" for n in range(5))
        + "boy\tgirl\t100000\n",
        "person,looks_at,time_ns\n"
        + "".join(f"girl,{'bird' if n < 3 else 'none'},{n * 10**8 - 4 * 10**7}\n" for n in range(1, 6))
        + "boy,girl,200000000\n",
    ],
)  # fmt: skip
def test_every_way_to_say_where_a_row_holds_gives_the_same_labels(tmp_path: Path, text: str) -> None:
    assert _read(tmp_path, text) == (EXPECTED, ())


def _row_of_each_frame(columns: str, cells: str, first: int = 1) -> str:
    """A table as pandas writes it; ``cells`` has fields for a row's frame and time."""
    lines = [cells.format(n=n + first, s=n / 10, epoch_ms=1_718_000_000_000 + 100 * n) for n in range(5)]
    looks = ["bird", "bird", "none", "none", "none"]
    rows = [f"{n},girl,{look},{line}" for n, (look, line) in enumerate(zip(looks, lines, strict=True))]
    return "\n".join([f",person_id,looking_at,{columns}", *rows, "5,boy,girl," + lines[1]]) + "\n"


@pytest.mark.parametrize(
    ("columns", "cells"),
    [
        ("frame_idx", "{n}"),
        ("frame_idx", "{n}.0"),
        ("frame,timestamp", "{n},{s}"),
        ("frame,timestamp_ms", "{n},{epoch_ms}"),
        ("frame_id,time", "{n},2024-06-10 08:13:20"),
        ("timestamp_sec", "{s}"),
        ("time", "0 days 00:00:0{s}00000"),
    ],
)
def test_what_scripts_save_for_each_frame_is_read(tmp_path: Path, columns: str, cells: str) -> None:
    """Frames with times beside them, of the clip's clock or another, which say the same."""
    labels, notes = _read(tmp_path, _row_of_each_frame(columns, cells))
    assert labels == EXPECTED
    assert [note for note in notes if "not read" in note] == [
        f"{tmp_path / 'mine.csv'}: columns that are not read: {time}." for time in columns.split(",")[1:]
    ]


def test_spans_of_frames_and_of_times_say_the_same(tmp_path: Path) -> None:
    header = "person,label,start_frame,end_frame,start_time,end_time,duration\n"
    rows = "girl,bird,1,2,0,0.2,0.2\ngirl,none,3,5,0.2,0.5,0.3\nboy,girl,2,2,0.1,0.2,0.1\n"
    assert _read(tmp_path, header + rows)[0] == EXPECTED


@pytest.mark.parametrize(
    ("columns", "cells", "first", "options", "message"),
    [
        ("frame,time_s", "{n},{s}", 0, {}, r"csv:3: frame and time_s: rows are 0\.1 s later in time"),
        ("frame,time_s", "{n},1{s}", 1, {"offset": 9.9}, r"rows are 0\.1 s later in time"),
        ("frame,time_ms", "{n},{n}000", 1, {}, r"csv:6: frame and time_ms: frame 5 is 2\.25 s later in time"),
        ("frame,start,end", "{n},{s},{s}", 1, {}, r"found start_s and end_s and of frame"),
    ],
)
def test_frames_that_are_at_other_times_than_beside_them_are_refused(
    tmp_path: Path, columns: str, cells: str, first: int, options: dict[str, float], message: str
) -> None:
    with pytest.raises(VfoaError, match=message):
        _read(tmp_path, _row_of_each_frame(columns, cells, first), **options)


def test_times_beside_frames_do_not_count_if_the_clip_has_no_rate(tmp_path: Path) -> None:
    clip = PlainClip(frames=range(1, 6), rate_hz=None)
    assert _read(tmp_path, _row_of_each_frame("frame,time_s", "{n},{s}"), clip)[0] == EXPECTED


def test_frames_of_another_program_may_have_times_beside_them(tmp_path: Path) -> None:
    alone, beside = (
        _read(tmp_path, _row_of_each_frame(columns, cells, 0), fps=10.0)[0]
        for columns, cells in (("frame", "{n}"), ("frame,time_s", "{n},{s}"))
    )
    assert alone == beside


def test_a_duration_that_is_not_read_is_named(tmp_path: Path) -> None:
    for place in ("time_ms", "frame"):
        _, notes = _read(tmp_path, f"who,what,{place},duration\ngirl,bird,1,0.2\n")
        assert any("not read: duration" in note for note in notes)
    labels, notes = _read(tmp_path, "who,what,time,duration\ngirl,bird,0,0\ngirl,bird,0.1,\n")
    assert (labels, notes) == (Labels([row(1, 2, "bird")]), ())
    with pytest.raises(VfoaError, match="start_s and end_s and of time_s"):
        _read(tmp_path, "who,what,time,start,end,duration\ngirl,bird,0,0,1,1\n")
    with pytest.raises(VfoaError, match=r"csv:3 \(duration_s 0\.2\): 'girl' has two labels"):
        _read(tmp_path, "who,what,time,duration\ngirl,bird,0,0.2\ngirl,none,0.1,0.2\n")


@pytest.mark.parametrize(
    "text",
    [
        "who,what,time_s\ngirl,bird,0\nboy,girl,0.1\ngirl,none,0.2\nboy,end,0.2\n",
        "who,what,start\nboy,girl,0:00.1\nboy,end,0:00.2\ngirl,none,0:00.2\ngirl,bird,0:00\n",
        "who;what;onset;offset\ngirl;bird;-3,5;\nboy;girl;0,1;0\ngirl;bird;0,1;\ngirl;none;0,15;\nboy;;0,2;\n",
        "who,what,time_ms,duration\ngirl,bird,0,0\nboy,girl,100,0\ngirl,none,200,0\nboy,end,200,0\n",
        "who,what,time_us\ngirl,bird,0\nboy,girl,99000\ngirl,none,200000\nboy,end,200000\n",
        "who,what,start_ns\ngirl,bird,1\nboy,girl,150000000\ngirl,none,250000000\nboy,end,300000000\n",
        "who,what,frame\ngirl,bird,1\nboy,girl,2\ngirl,none,3\nboy,end,3\n",
        "who,what,first_frame\ngirl,none,3\nboy,girl,2\nboy,end,3\ngirl,bird,1\n",
    ],
)
def test_with_until_next_a_row_holds_until_the_next_one_of_its_person(tmp_path: Path, text: str) -> None:
    """Codings of onsets alone; a row that is left out (``end``), or has no target, ends the one before."""
    labels, _ = _read(tmp_path, text, until_next=True, renamed={"end": ""})
    assert labels == EXPECTED


def test_with_until_next_and_a_rate_frames_are_those_of_another_program(tmp_path: Path) -> None:
    labels, _ = _read(
        tmp_path, "subject,target,frame\ngirl,bird,5\ngirl,none,7\n", until_next=True, fps=10.0, offset=0.5
    )
    assert labels == Labels([row(1, 2, "bird"), row(3, 5, "none")])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("who,what,start,end\ngirl,bird,0,0.2\ngirl,cup,0.2,0\n", r"mine\.csv:1: --until-next: found end_s"),
        ("who,what,onset,duration\ngirl,bird,0,0.2\n", r"mine\.csv:1: --until-next: found duration_s"),
        ("who,what,time_s\ngirl,bird,0\ngirl,cup,0.2\ngirl,bird,0.20\n", r"mine\.csv:4: 'girl' .*mine\.csv:3"),
        ("who,what,frame\ngirl,bird,1\ngirl,cup,9\n", r"mine\.csv:3: frame 9 is outside the clip"),
        ("who,what,time_s\ngirl,bird,0\ngirl,cup,soon\n", r"mine\.csv:3: time_s: found 'soon'"),
        ("who,what\ngirl,bird\n", r"mine\.csv:1: where a row holds: found none"),
        ("who,what,time\ngirl,bird,0\ngirl,cup,300\n", r"times reach 300 s"),
    ],
)
def test_what_contradicts_until_next_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        _read(tmp_path, text, until_next=True)


def test_a_table_of_onsets_names_the_option(tmp_path: Path) -> None:
    """It is never assumed: a misspelt column of ends would be read as onsets."""
    for rows in ("time_s\ngirl,bird,0\ngirl,cup,0.3\n", "frame\ngirl,bird,1\ngirl,cup,4\n"):
        _, notes = _read(tmp_path, f"who,what,{rows}")
        assert any("--until-next" in note for note in notes)
    _, notes = _read(tmp_path, "who,what,frame\ngirl,bird,1\ngirl,,2\ngirl,,3\ngirl,,4\ngirl,cup,5\n")
    assert not any("--until-next" in note for note in notes)  # a row for each frame, some without a target
    with pytest.raises(VfoaError, match="--until-next"):
        _read(tmp_path, "who,what,onset,ofset\ngirl,bird,0,1\n")


SMI = (
    "Stimulus\tParticipant\tEvent Start Trial Time [ms]\tEvent End Trial Time [ms]\tCategory\tAOI Name\n"
    "a.avi\tgirl\t0.0\t99.8\tFixation\tbird\na.avi\tgirl\t99.8\t200.1\tSaccade\t-\n"
    "a.avi\tgirl\t200.1\t500.0\tFixation\tWhite Space\n"
)


def test_fixations_of_smi_s_begaze_are_read(tmp_path: Path) -> None:
    labels, notes = _read(tmp_path, SMI, renamed={"White Space": "none"})
    assert [(row.first_frame, row.last_frame, row.label.target) for row in labels.ranges] == [
        (1, 1, "bird"), (2, 2, "ignore"), (3, 5, "none")
    ]  # fmt: skip
    assert any("1 row without a target" in note for note in notes)
    two = SMI + "b.avi\tgirl\t0.0\t99.8\tFixation\tbird\n"
    with pytest.raises(VfoaError, match=r"'a\.avi', 'b\.avi', several of one person"):
        _read(tmp_path, two, renamed={"White Space": "none"})
    chosen, _ = _read(tmp_path, two, renamed={"White Space": "none"}, observation="a.avi")
    assert chosen == labels


def test_with_a_rate_frames_are_those_of_another_program_from_0(tmp_path: Path) -> None:
    """There, the clip begins after half a second."""
    text = "first_frame,last_frame,subject,target\n5,6,girl,bird\n7,9,girl,none\n"
    labels, _ = _read(tmp_path, text, fps=10.0, offset=0.5)
    assert labels == Labels([row(1, 2, "bird"), row(3, 5, "none")])


@pytest.mark.parametrize("has_images", [True, False])
def test_a_film_of_another_rate(tmp_path: Path, has_images: bool) -> None:
    """Two frames of the film are one of the clip, if it has no images; else it may show these, at half their speed."""
    text = "first_frame,last_frame,subject,target\n10,13,girl,bird\n14,19,girl,none\n"
    labels, notes = _read(tmp_path, text, fps=20.0, offset=0.5, has_images=has_images)
    clip_frames = [(1, 4, "bird"), (5, 5, "none")] if has_images else [(1, 2, "bird"), (3, 5, "none")]
    assert labels == Labels([row(*each) for each in clip_frames])
    assert any("--fps 20" in note and "0.2 s" in note and "0.4 s" in note for note in notes) is has_images


@pytest.mark.parametrize(("fps", "is_noted"), [(30.0, True), (29.97, False)])
def test_a_rate_that_shifts_the_labels_of_a_long_film_is_noted(tmp_path: Path, fps: float, is_noted: bool) -> None:
    """After 500 s, 30 frames a second are 15 frames behind 29.97."""
    film = PlainClip(frames=range(15_000), rate_hz=30_000 / 1001)
    labels, notes = _read(tmp_path, "subject,target,start,end\ngirl,bird,480.48,490.49\n", film, fps=fps)
    assert labels == Labels([row(14_415, 14_714, "bird") if is_noted else row(14_400, 14_699, "bird")])
    assert ["500.0 s" in note and "500.5 s" in note for note in notes] == [True] * is_noted


def test_rows_without_a_0_or_1_have_no_label(tmp_path: Path) -> None:
    text = "frame,subject,bird,cup\n1,girl,1,0\n2,girl,,\n3,girl,0,0\n4,girl,0,\n"
    labels, notes = _read(tmp_path, text)
    assert [(row.first_frame, row.last_frame, row.label.target) for row in labels.ranges] == [
        (1, 1, "bird"), (2, 2, "ignore"), (3, 4, "none")
    ]  # fmt: skip
    assert any("1 row without a target" in note for note in notes)
    with pytest.raises(VfoaError, match=r"mine\.csv:3: found 1 for bird and cup"):
        _read(tmp_path, "frame,subject,bird,cup\n1,girl,1,0\n2,girl,1,1\n")


@pytest.mark.parametrize(
    "header", ["frame,subject,screen,bird,says", "frame,subject,AOI hit [screen],AOI hit [S - bird],says"]
)
def test_a_column_of_a_target_may_be_left_out(tmp_path: Path, header: str) -> None:
    """Where it alone has a 1, there is no label; a bird on the screen is looked at."""
    text = f"{header}\n1,girl,1,0,hm\n2,girl,1,1,\n3,girl,0,0,\n4,girl,0,1,\n5,girl,1,0,\n"
    labels, notes = _read(tmp_path, text, renamed={"screen": "", "says": ""})
    assert labels == Labels([row(2, 2, "bird"), row(3, 3, "none"), row(4, 4, "bird")])
    assert any("2 labels of 'screen' (--rename)" in note for note in notes)
    one, _ = _read(tmp_path, text, renamed={"screen": "bird"})
    assert one == Labels([row(1, 2, "bird"), row(3, 3, "none"), row(4, 5, "bird")])


def test_of_rows_between_frames_each_frame_takes_the_nearest(tmp_path: Path) -> None:
    """Those of an eye tracker at 50 Hz, beside frames at 10 Hz: at 0.1 s is another label than about it."""
    rows = [f"girl,{'bird' if n % 5 == 0 else 'cup'},{0.02 * n:.2f}\n" for n in range(24)]
    labels, notes = _read(tmp_path, "subject,target,time_s\n" + "".join(rows) + "boy,girl,0.13\nboy,bird,0.07\n")
    assert labels == Labels([row(1, 5, "bird"), row(2, 2, "bird", "boy")])
    assert any("19 rows between frames" in note for note in notes)
    with pytest.raises(VfoaError, match=r"mine\.csv:3: 'girl' has two labels in frame 1"):
        _read(tmp_path, "subject,target,time_s\ngirl,bird,0\ngirl,cup,0\n")


TOBII = (
    "Recording timestamp [\u03bcs]\tSensor\tParticipant name\tEvent\tGaze point X\tAOI hit [Table - bird]\t"
    "AOI hit [Film 1 - take 2 - brown cup]\tAOI hit [Door - bird]\n"
)
"""The columns of Tobii Pro Lab's data export, of glasses whose gaze was mapped to two snapshots and a film."""


def test_the_areas_of_interest_of_an_eye_tracker_are_targets(tmp_path: Path) -> None:
    """Rows of other sensors and events have blank cells; a time is that of the recording, 2 s before the clip."""
    rows = [
        ("0", "", "RecordingStart", "", "", ""),
        *((f"{2_000_000 + 20_000 * n}", "Eye Tracker", "", *"001") for n in range(5)),
        ("2100500", "Gyroscope", "", "", "", ""),
        *((f"{2_100_000 + 20_000 * n}", "Eye Tracker", "", *"010") for n in range(5)),
        *((f"{2_200_000 + 20_000 * n}", "Eye Tracker", "", *"000") for n in range(15)),
    ]
    text = TOBII + "".join(
        f"{at}\t{sensor}\tP01\t{event}\t\t" + "\t".join(hits) + "\n" for at, sensor, event, *hits in rows
    )
    labels, notes = _read(tmp_path, text, offset=2.0, renamed={"P01": "girl", "brown cup": "cup"})
    assert labels == Labels([row(1, 1, "bird"), row(2, 2, "cup"), row(3, 5, "none")])
    assert any("2 rows without a target" in note for note in notes)
    with pytest.raises(VfoaError, match=r"mine\.csv:\d+: unknown subject 'P01'.*'brown cup'.*--rename"):
        _read(tmp_path, text, offset=2.0)


def test_eyes_in_no_area_look_at_nothing_only_in_a_fixation(tmp_path: Path) -> None:
    """The tracker writes 0 for each area, too, while it finds no eyes."""
    header = "Recording timestamp [ms]\tParticipant name\tEye movement type\tAOI hit [S - bird]\tAOI hit [S - cup]\n"
    types = (
        ("Fixation", "1\t0"),
        ("Saccade", "0\t0"),
        ("EyesNotFound", "0\t0"),
        ("Fixation", "0\t0"),
        ("Saccade", "0\t1"),
    )
    rows = (f"{100 * place}\tgirl\t{kind}\t{hits}\n" for place, (kind, hits) in enumerate(types))
    labels, notes = _read(tmp_path, header + "".join(rows))
    unknown = row(2, 3, "ignore", note="not labelled yet")
    assert labels == Labels([row(1, 1, "bird"), unknown, row(4, 4, "none"), row(5, 5, "cup")])
    assert any("2 rows without a target" in note for note in notes)
    assert not [note for note in notes if "not read" in note]


def test_eyes_on_a_snapshot_look_at_nothing_only_in_a_fixation_that_was_mapped_to_it(tmp_path: Path) -> None:
    """Of a fixation of the glasses that could not be mapped, it writes 0 for each area of the snapshot, too."""
    header = (
        "Recording timestamp [ms]\tParticipant name\tMapped eye movement type [S]\tMapped eye movement type index [S]\t"
        "Eye movement type\tAOI hit [S - bird]\tAOI hit [S - cup]\tAOI hit [Film - cup]\n"
    )
    types = (
        ("Fixation\t1\tFixation", "1\t0\t"),
        ("EyesNotFoundMovement\t1\tFixation", "0\t0\t"),
        ("\t\tFixation", "0\t0\t"),
        ("Fixation\t2\tSaccade", "0\t0\t"),
        ("\t\tFixation", "\t\t0"),
    )
    rows = (f"{100 * place}\tgirl\t{kind}\t{hits}\n" for place, (kind, hits) in enumerate(types))
    labels, notes = _read(tmp_path, header + "".join(rows))
    assert labels == Labels([row(1, 1, "bird"), row(2, 3, "ignore", note="not labelled yet"), row(4, 5, "none")])
    assert [note.partition("not read: ")[2] for note in notes if "not read" in note] == [
        "Mapped eye movement type index [S]."
    ]


EYELINK = (
    "RECORDING_SESSION_LABEL\tTRIAL_INDEX\tCURRENT_FIX_START\tCURRENT_FIX_END\tCURRENT_FIX_INTEREST_AREA_LABEL\n"
    "girl\t1\t0\t200\tbird\ngirl\t1\t200\t399\t.\n"
)


def test_fixations_of_eyelinks_data_viewer_are_read(tmp_path: Path) -> None:
    """One in no area is a look at nothing; times count from the start of a trial."""
    labels, _ = _read(tmp_path, EYELINK)
    found = [(row.first_frame, row.last_frame, row.label.target) for row in labels.ranges]
    assert found == [(1, 2, "bird"), (3, 4, "none")]
    two = EYELINK + "girl\t2\t0\t200\tcup\n"
    with pytest.raises(VfoaError, match=r"'1', '2', several of one person; expected --observation"):
        _read(tmp_path, two)
    labels, _ = _read(tmp_path, two, observation="2")
    assert [(row.first_frame, row.last_frame, row.label.target) for row in labels.ranges] == [(1, 2, "cup")]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (EYELINK.replace("\tbird", "\t."), r"mine\.csv: no fixation is in an area"),
        (EYELINK.replace("\tCURRENT_FIX_INTEREST_AREA_LABEL", "\tX"), r":1: no column CURRENT_FIX_INTEREST"),
        ("RECORDING_SESSION_LABEL\tIA_LABEL\tIA_DWELL_TIME\ngirl\tbird\t400\n", r":1: IA_DWELL_TIME: .*Report"),
        ("Participant\tAOI\tTotal_duration_of_fixations\ngirl\tbird\t400\n", r":1: Total_.*data export"),
        ("** CONVERTED FROM a.edf\nMSG\t18 START\nEFIX R 1 2 1 9.0 9.0 1\n", r":1: .*of EyeLink .*Fixation Report"),
    ],
)  # fmt: skip
def test_exports_without_looks_say_which_to_make(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        _read(tmp_path, text)


@pytest.mark.parametrize("column", ["cup", "AOI hit [S - cup]"])
@pytest.mark.parametrize("cell", ["-1", "0.7", "x"])
def test_a_column_of_a_target_with_something_else_is_refused(column: str, cell: str, tmp_path: Path) -> None:
    """It was left out, and looks at its target were looks at nothing."""
    text = f"time_ms,subject,bird,{column}\n0,girl,1,0\n100,girl,0,{cell}\n"
    with pytest.raises(VfoaError, match=rf"mine\.csv:3: {re.escape(column)}: found '{cell}'"):
        _read(tmp_path, text)


def test_of_several_recordings_of_a_person_one_is_chosen(tmp_path: Path) -> None:
    """Each has times from 0; two people may have one each."""
    header = "Recording timestamp [ms]\tParticipant name\tRecording name\tAOI hit [S - bird]\tAOI hit [S - cup]\n"
    rows = [f"{at}\tgirl\t{name}\t{hits}\n" for name, hits in (("R1", "1\t0"), ("R2", "0\t1")) for at in (0, 110, 210)]
    with pytest.raises(VfoaError, match=r"mine\.csv:1: Recording name: found 'R1', 'R2'.*--observation"):
        _read(tmp_path, header + "".join(rows))
    assert _read(tmp_path, header + "".join(rows), observation="R2")[0] == Labels([row(1, 3, "cup")])
    with pytest.raises(VfoaError, match=r"--observation: no recording 'R3'"):
        _read(tmp_path, header + "".join(rows), observation="R3")
    two = header + "".join([*rows[:3], *(row.replace("girl", "boy") for row in rows[3:]), "0\tgirl\t\t\t\n"])
    assert _read(tmp_path, two)[0] == Labels([row(1, 3, "bird"), row(1, 3, "cup", "boy")])


@pytest.mark.parametrize("column", ["video", "Coder"])
def test_rows_of_other_videos_and_coders_are_not_the_clips(tmp_path: Path, column: str) -> None:
    text = f"{column},who,what,start,end\na.mp4,girl,bird,0,0.2\nb.mp4,girl,cup,0.3,0.5\n"
    with pytest.raises(VfoaError, match=rf"mine\.csv:1: {column}: found 'a\.mp4', 'b\.mp4', .*--observation"):
        _read(tmp_path, text)
    assert _read(tmp_path, text, observation="b.mp4")[0] == Labels([row(4, 5, "cup")])
    assert _read(tmp_path, text, films={"a.mp4": 0.0})[0] == Labels([row(1, 2, "bird")])
    several = text.replace("b.mp4,girl", "b.mp4,boy")
    assert len(_read(tmp_path, several)[0].ranges) == 2  # each person has one


MINUTE = PlainClip(frames=range(1, 1501))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("subject,target,start,end\ngirl,bird,0,4000\ngirl,cup,4000,59000\n", "start_ms and end_ms"),
        ("subject,target,start,end\ngirl,bird,1,100\ngirl,cup,101,1490\n", "first_frame and last_frame"),
        ("subject,target,time\ngirl,bird,40\ngirl,cup,50000\n", "time_ms"),
        ("subject,target,time\ngirl,bird,1\ngirl,cup,1500\n", "called frame"),
        ("subject;target;start_ms;end_ms\ngirl;bird;0;1.040\ngirl;cup;4.000;59.000\n", "thousands separator"),
        ("subject,target,start_ms,end_ms\ngirl,bird,0,4.5\ngirl,cup,4.5,59\n", "columns in seconds"),
    ],
)
def test_times_that_are_something_else_are_refused(tmp_path: Path, text: str, said: str) -> None:
    """They would be labels of nearly nothing, or of the whole clip."""
    with pytest.raises(VfoaError, match=said):
        _read(tmp_path, text, MINUTE)


@pytest.mark.parametrize(
    "text",
    [
        "subject,target,start_s,end_s\ngirl,bird,0,4000\n",
        "subject,target,start,end\ngirl,bird,0,70\n",
        "subject,target,start,end\ngirl,bird,0,4\ngirl,cup,5400,7200\n",
        "subject,target,start,end\ngirl,bird,0,0:59.5\n",
    ],
)
def test_labels_of_a_longer_film_stay_seconds(tmp_path: Path, text: str) -> None:
    labels, _ = _read(tmp_path, text, MINUTE)
    assert [row.label.target for row in labels.ranges] == ["bird"]


@pytest.mark.parametrize(
    ("columns", "more"), [("frame", {}), ("frame", {"until_next": True}), ("first_frame,last_frame", {})]
)
def test_an_offset_of_the_clip_s_own_frame_numbers_is_refused(
    tmp_path: Path, columns: str, more: dict[str, object]
) -> None:
    text = f"who,what,{columns}\ngirl,bird,{','.join('2' for _ in columns.split(','))}\n"
    with pytest.raises(VfoaError, match=r"mine\.csv: --offset 0\.1: no effect .*--fps"):
        _read(tmp_path, text, offset=0.1, **more)
    assert _read(tmp_path, text, offset=0.1, fps=10.0, **more)[0].ranges[0].first_frame == 2


@pytest.mark.parametrize("fps", [None, 10.0])
def test_ranges_that_end_before_their_last_frame_are_told(tmp_path: Path, fps: float | None) -> None:
    """As those of Python: each ends with the number with which the next one begins, the last one after the clip."""
    columns, rows = "who,what,start_frame,end_frame\n", ["girl,bird,1,3", "boy,girl,1,6", "girl,cup,3,6"]
    with pytest.raises(VfoaError, match=r"mine\.csv:4: 'girl' .* frame 3: .*mine\.csv:2.*last_frame is included"):
        _read(tmp_path, columns + "\n".join(rows), fps=fps)
    for other in ("girl,cup,2,5", "girl,cup,4,6", "girl,cup,3,3"):
        with pytest.raises(VfoaError) as refused:
            _read(tmp_path, columns + "\n".join(["girl,bird,1,3", other, "girl,cup,4,4"]), fps=fps)
        assert "is included" not in str(refused.value)


def test_a_duration_beside_a_frame_is_not_left_out(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match=r"mine\.csv: frame and Duration: .*expected last_frame"):
        _read(tmp_path, "who,what,frame,Duration\ngirl,bird,1,2\ngirl,cup,5,1\n")
    of_frames = "".join(f"girl,bird,{frame},0.1\n" for frame in range(1, 6))
    assert _read(tmp_path, "who,what,frame,Duration\n" + of_frames)[0] == Labels([row(1, 5, "bird")])


@pytest.mark.parametrize("ends", ["start_s,end_s", "start,end"])
def test_minutes_that_a_spreadsheet_took_for_hours_are_refused(tmp_path: Path, ends: str) -> None:
    text = f"subject,target,{ends}\ngirl,bird,0:00:00,0:12:00\ngirl,cup,0:12:00,0:58:00\n"  # typed as 0:12 and 0:58
    with pytest.raises(VfoaError, match=r"times reach 0:58:00, .* 59.96 s; expected h:mm:ss"):
        _read(tmp_path, text, MINUTE)
    labels, _ = _read(tmp_path, f"subject,target,{ends}\ngirl,bird,0:00:00,0:12:30\n", MINUTE)
    assert [row.label.target for row in labels.ranges] == ["bird"]


def test_milliseconds_may_have_a_fraction(tmp_path: Path) -> None:
    text = "subject,target,start_ms,end_ms\ngirl,bird,0,1050.5\ngirl,cup,4000.25,59000\n"
    labels, _ = _read(tmp_path, text, MINUTE, gaps="none")
    assert labels == Labels([row(1, 27, "bird"), row(28, 100, "none"), row(101, 1475, "cup")])


def test_a_label_in_nanoseconds_begins_with_its_frame_and_ends_before_that_of_its_end(tmp_path: Path) -> None:
    clip = PlainClip(frames=range(1, 7), rate_hz=3.0, start_ns=1_700_000_000_000_000_000)
    stamps = [clip.time_ns(number) for number in clip.frames]  # two of three lie in the second half of a millisecond
    ranges = [(1, 2, "bird"), (2, 5, "none"), (5, 6, "cup")]
    text = "".join(f"girl,{target},{stamps[first - 1]},{stamps[end - 1]}\n" for first, end, target in ranges)
    labels, _ = _read(tmp_path, f"subject,target,start_ns,end_ns\n{text}", clip)
    assert labels == Labels([row(first, end - 1, target) for first, end, target in ranges])


@pytest.mark.parametrize("rate_hz", [30.0, 30_000 / 1001, 24_000 / 1001])
@pytest.mark.parametrize("begin_s", [0.0, 1_700_000_000.25])
@pytest.mark.parametrize("columns", ["start,end", "onset,duration", "start_ms,end_ms"])
def test_labels_of_whole_frames_are_read_as_these(columns: str, begin_s: float, rate_hz: float, tmp_path: Path) -> None:
    """Whatever fraction of a millisecond their times have, also in seconds since 1970."""
    clip = PlainClip(frames=range(61), rate_hz=rate_hz)
    unit = 1000 if columns.endswith("ms") else 1
    text = f"subject,target,{columns}\n"
    for first in range(0, 60, 2):
        start, end = (unit * (begin_s + clip.time_ns(number) / 1e9) for number in (first, first + 2))
        length = (clip.time_ns(first + 2) - clip.time_ns(first)) / 1e9
        text += f"girl,{'cup' if first % 4 else 'bird'},{start!r},{length if 'duration' in columns else end!r}\n"
    labels, _ = _read(tmp_path, text, clip, offset=begin_s)
    assert [(row.first_frame, row.last_frame) for row in labels.ranges] == [(n, n + 1) for n in range(0, 60, 2)]


@pytest.mark.parametrize(("column", "per_s"), [("time_ms", 10**3), ("time_us", 10**6)])
def test_moments_since_1970_need_an_offset_alone(column: str, per_s: int, tmp_path: Path) -> None:
    begin_s = 1_700_000_000
    rows = (f"girl,bird,{begin_s * per_s + place * per_s // 10}\n" for place in range(3))
    labels, _ = _read(tmp_path, f"subject,target,{column}\n{''.join(rows)}", offset=begin_s)
    assert labels == Labels([row(1, 3, "bird")])


def test_labels_that_are_cut_are_counted(tmp_path: Path) -> None:
    text = "subject,target,start_s,end_s\nboy,cup,-3,0.2\ngirl,bird,0,0.3\ngirl,cup,0.3,9.5\n"
    _, notes = _read(tmp_path, text)
    (note,) = [note for note in notes if "beyond the clip" in note]
    assert re.search(r"2 labels beyond the clip by up to 9\.0 s, .*mine\.csv:2\.$", note)


def test_what_is_left_out_is_said(tmp_path: Path) -> None:
    text = "time,subject,target,rater\n0,girl,bird,A\n0.1,girl,,A\n0.2,girl,cup,A\n0.9,girl,cup,A\n"
    labels, notes = _read(tmp_path, text, gaps="none")
    assert labels == Labels([row(1, 1, "bird"), row(2, 2, "none"), row(3, 3, "cup")])
    columns, blank, filled, outside = notes
    assert "rater" in columns
    assert "1 row without" in blank
    assert "girl: 1 frame " in filled
    assert outside.endswith(f"the first at {tmp_path / 'mine.csv'}:5.")


@pytest.mark.parametrize(
    ("text", "found", "said"),
    [
        ("frame,target\n" + "".join(f"{n},bird\n" for n in range(12)), [0, 4, 8], "9 labels .*:3"),  # counted through
        ("frame,target\n0,bird\n4,bird\n8,bird\n", [0, 4, 8], ""),
        ("first_frame,last_frame,target\n0,3,bird\n4,9,bird\n", [0, 4, 8], ""),
        ("first_frame,last_frame,target\n0,3,bird\n5,7,cup\n8,9,bird\n", [0, 8], "1 label .*:3"),
    ],
)
def test_rows_of_frames_that_the_clip_does_not_have_are_counted(
    tmp_path: Path, text: str, found: list[int], said: str
) -> None:
    """Of every fourth frame of a film, 0, 4, 8 and so on, rows that count them through are of others."""
    clip = replace(exchange(PlainClip(frames=range(0, 40, 4), rate_hz=10.0)), subjects=("girl",))
    imported = OwnTable().read(write_text(tmp_path / "mine.csv", text), clip)
    labels = {frame: imported.labels.at(frame, "girl") for frame in clip.frames}
    assert [frame for frame, label in labels.items() if label and label.target == "bird"] == found
    notes = [note for note in imported.notes if "without a frame of the clip" in note]
    assert len(notes) == bool(said)
    assert all(re.search(said, note) for note in notes)


def test_rows_of_the_own_format_without_a_frame_of_the_clip_are_counted(tmp_path: Path) -> None:
    clip = exchange(PlainClip(frames=range(0, 40, 4), rate_hz=10.0))
    ranges = [row(0, 3, "bird"), row(5, 7, "cup"), row(8, 9, "bird"), row(9, 11, "cup", "boy")]
    path = tmp_path / "mine.csv"
    write_annotations(path, Labels(ranges))
    imported = FORMATS.load("csv")().read(path, clip)
    assert {frame: imported.labels.at(frame, "girl") for frame in (0, 8)} == dict.fromkeys((0, 8), ranges[0].label)
    assert imported.labels.subjects == ("girl",)
    (note,) = (note for note in imported.notes if "left out" in note)
    assert note.endswith("2 labels without a frame of the clip, the first at girl in frames 5 to 7.")


def test_names_are_translated_and_a_note_is_kept(tmp_path: Path) -> None:
    text = "frame,participant,label,Comment\n1,P01,Vogel,a smile\n2,P01,NA,\n"
    labels, _ = _read(tmp_path, text, renamed={"P01": "girl", "Vogel": "bird"})
    assert labels == Labels([row(1, 1, "bird", note="a smile")])


@pytest.mark.parametrize(
    ("text", "blanks"),
    [
        ("frame,girl,rater,Ben\n1,bird,A,\n2,bird,A,girl\n3,none,A,\n4,none,A,\n5,None,A,\n", 4),
        ("start;end;girl;rater;Ben\n0;0,2;bird;A;\n0,1;0,2;;A;girl\n0,2;0,5;none;A;\n", 3),
    ],
)
def test_each_person_may_have_a_column(tmp_path: Path, text: str, blanks: int) -> None:
    labels, (columns, blank) = _read(tmp_path, text, renamed={"Ben": "boy"})
    assert labels == EXPECTED
    assert "rater" in columns
    assert f"{blanks} rows" in blank
    with pytest.raises(VfoaError, match=r"mine\.csv:3: unknown target 'brid'"):
        _read(tmp_path, "frame,girl\n1,bird\n2,brid\n")


def test_the_earlier_name_of_a_renamed_target_is_answered_with_its_name_now(tmp_path: Path) -> None:
    text = "frame,girl\n1,bird\n2,eagle\n"
    with pytest.raises(VfoaError, match=r"mine\.csv:3: unknown target 'eagle'; .*'bird' now.*--rename"):
        _read(tmp_path, text, former={"eagle": "bird"})


def test_the_only_person_of_a_clip_needs_no_column(tmp_path: Path) -> None:
    path = write_text(tmp_path / "mine.csv", "frame,target\n1,bird\n")
    alone = Exchange(timeline=timeline_of(FIVE), rate_hz=10.0, subjects=("girl",), targets=("bird",))
    assert OwnTable().read(path, alone).labels == Labels([row(1, 1, "bird")])
    with pytest.raises(VfoaError, match=r"mine\.csv:1: no column of subjects.*girl, boy"):
        _read(tmp_path, "frame,target\n1,bird\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"mine\.csv:1: .*target"),
        ("frame,subject,target\n1,girl.bird\n", r"mine\.csv:2: found 2 cells; expected 3"),
        ("frame,subject\n1,girl\n", r"mine\.csv:1: .*target"),
        ("from,to,subject,target\n0,1,girl,bird\n", r"mine\.csv:1: .*none of them"),
        ("frame,start,end,subject,target\n1,0,1,girl,bird\n", r"mine\.csv:1: .*start_s and end_s and of frame"),
        ("frame,who,person,target\n1,girl,girl,bird\n", r"mine\.csv:1: who and person both are subject"),
        ("frame,subject,target\n0,girl,bird\n", r"mine\.csv:2: frame 0 is outside .*1 to 5.*--fps"),
        ("frame,subject,target\n1.5,girl,bird\n", r"mine\.csv:2: frame: found '1\.5'"),
        ("frame,subject,target\n1,girl,bird\n1,girl,cup\n", r"mine\.csv:3: 'girl' has two labels in frame 1"),
        ("first_frame,last_frame,subject,target\n2,1,girl,bird\n", r"mine\.csv:2: first_frame 2 comes after"),
        ("start,end,subject,target\n0,soon,girl,bird\n", r"mine\.csv:2: end_s: found 'soon'"),
        ("start,end,subject,target\n0.4,0.1,girl,bird\n", r"mine\.csv:2: ends at 0\.1 s"),
        ("start,end,subject,target\n0,0.2,girl,bird\n0.1,0.3,girl,cup\n", r"mine\.csv:3: 'girl' has two labels"),
        ("Recording timestamp,subject,target\n1,girl,bird\n", r"none of them \(not known: Recording timestamp\)"),
        ("time_ns,subject,target\n1e9,girl,bird\n", r"mine\.csv:2: time_ns: found '1e9'.*cut off"),
        ("frame,subject,target\n1,Girl,brid\n", r"mine\.csv:2: unknown subject 'Girl'.*'brid'.*--rename"),
        ("frame,subject,target\n1,girl,girl\n", r"mine\.csv:2: 'girl' looks at 'girl'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named_with_its_row(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(VfoaError, match=message):
        _read(tmp_path, text)


def test_times_need_a_rate(tmp_path: Path) -> None:
    with pytest.raises(VfoaError, match="--fps"):
        _read(tmp_path, "time,subject,target\n0,girl,bird\n", PlainClip(rate_hz=None))


def test_it_cannot_be_written_and_the_own_format_names_it(tmp_path: Path) -> None:
    path = write_text(tmp_path / "mine.csv", "frame,subject,target\n1,girl,bird\n")
    with pytest.raises(VfoaError, match=r"mine\.csv:1: .*--format table"):
        FORMATS.load("csv")().read(path, exchange(FIVE))
    with pytest.raises(VfoaError, match="cannot be written"):
        OwnTable().write(path, EXPECTED, exchange(FIVE))


def test_no_name_stands_for_two_columns() -> None:
    names = [name for columns in (COLUMNS, FURTHER_COLUMNS) for column in columns.values() for name in column]
    assert len(names) == len({*names})


@given(labels_of(range(1, 51), notes=False, points=False, tags=False, suggested=False))
def test_rows_of_frames_give_the_ranges_back(tmp_path_factory: pytest.TempPathFactory, labels: Labels) -> None:
    def rows(each: LabelRange) -> str:
        frames = range(each.first_frame, each.last_frame + 1)
        return "".join(f"{frame},{each.subject},{each.label.target}\n" for frame in frames)

    text = "frame,subject,target\n" + "".join(map(rows, labels.ranges))
    read, _ = _read(tmp_path_factory.mktemp("rows"), text, PlainClip())
    for frame, subject, label in labels.labelled(range(1, 51)):
        assert read.at(frame, subject) == label


def test_a_genuine_table_says_what_the_arrays_say(shared_data: Path) -> None:
    """Idiap's conversation: a row for each person and time stamp."""
    folder = shared_data / "idiap_vfoa"
    clip = open_measured("idiap_vfoa", folder, file="heads.csv")
    renamed = {"unfocused": "none", "1:person": "2", "2:person": "1", "1:other person": "2", "2:other person": "1"}
    theirs = Exchange(
        timeline=timeline_of(clip), rate_hz=clip.rate_hz, subjects=("1", "2"), targets=("robot",), renamed=renamed
    )
    arrays = IdiapGroundTruth().read(folder / "gt_first_half.npz", theirs).labels
    assert OwnTable().read(folder / "labels.csv", theirs).labels == arrays
