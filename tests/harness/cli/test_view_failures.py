from __future__ import annotations

import contextlib
import io
import json
import sys
from dataclasses import replace
from types import SimpleNamespace

import pytest

from harness.cli import main
from harness.cli.failures import (
    KEYS,
    Chosen,
    browse_failures,
    describe,
    first_of_looks,
    next_place,
    wrong_verdicts,
)
from harness.labels.labels import Label, LabelRange, Labels
from harness.run.directory import RunDirectory
from harness.score.reference import Reference
from harness.score.score import Scores
from harness.score.verdicts import Verdict
from tests.records import answers, frame_record, labels, score, subject_record, target_record, write_manifest

WRONG = {("b", "two"): {(7, "ann"), (3, "bob")}, ("b", "one"): {(1, "ann")}, ("a", "two"): {(9, "ann")}}
PEOPLE = {"subjects": {"ann": {"category": "person"}, "bob": {"category": "person"}}}
LABELLED = {"b": [(1, "ann"), (3, "bob"), (4, "ann"), (7, "ann")], "a": [(9, "ann")]}


def _scores() -> Scores:
    """Scores of two clips, in which these people look at the book instead of the cup; frame 2 has no label."""
    things = [target_record(1, "cup"), target_record(2, "book")]
    records = []
    for clip, configuration in (("b", "two"), ("b", "one"), ("a", "two"), ("a", "one")):
        for frame, name in [*LABELLED[clip], (2, "ann")]:
            focus = 2 if (frame, name) in WRONG.get((clip, configuration), ()) else 1
            subject = subject_record(name, totals={1: 0.2, 2: 0.2, focus: 0.5}, focus=focus)
            records.append(frame_record(things, [subject], frame=frame, clip=clip, configuration=configuration))
    labels = {
        clip: Labels(
            LabelRange(first_frame=frame, last_frame=frame, subject=name, label=Label(target="cup"))
            for frame, name in rows
        )
        for clip, rows in LABELLED.items()
    }
    return score(records, Reference(labels=labels))


SCORES = _scores()


def _places(found: list[Verdict]) -> list[tuple[str, str, int]]:
    return [(each.clip, each.configuration, each.frame) for each in found]


def test_failures_are_the_wrong_frames_recording_by_recording_in_time():
    assert _places(wrong_verdicts(SCORES, Chosen())) == [
        ("b", "two", 3),
        ("b", "two", 7),
        ("b", "one", 1),
        ("a", "two", 9),
    ]
    assert _places(wrong_verdicts(SCORES, Chosen(clip="b"))) == [("b", "two", 3), ("b", "two", 7), ("b", "one", 1)]
    of_two = Chosen(configuration="two")
    assert _places(wrong_verdicts(SCORES, of_two)) == [("b", "two", 3), ("b", "two", 7), ("a", "two", 9)]
    of_ann = replace(of_two, subject="ann")
    assert _places(wrong_verdicts(SCORES, of_ann)) == [("b", "two", 7), ("a", "two", 9)]
    assert wrong_verdicts(SCORES, replace(of_ann, error_type="outscored")) == wrong_verdicts(SCORES, of_ann)
    assert wrong_verdicts(SCORES, replace(of_ann, error_type="missed")) == []
    assert wrong_verdicts(SCORES, Chosen(clip="a", configuration="one")) == []


def test_the_failures_of_a_configuration_are_those_of_all_its_seeds():
    said = {"a.seed1": ["cup", "book"], "a.seed2": ["cup", "cup"], "b.seed1": ["cup", "cup"]}
    records = [record for name, names in said.items() for record in answers(names, configuration=name)]
    scores = score(records, Reference(labels={"clip": labels("book", "book")}))
    assert _places(wrong_verdicts(scores, Chosen(configuration="a"))) == [
        ("clip", "a.seed1", 1),
        ("clip", "a.seed2", 1),
        ("clip", "a.seed2", 2),
    ]


@pytest.mark.parametrize(
    ("key", "place", "then"),
    [
        *[("", 0, 1), ("n", 1, 2), ("n", 2, 2), ("p", 2, 1), ("p", 0, 0), ("x", 1, 1), ("w", 1, 1), ("q", 1, None)],
        *[("l", 0, 2), ("l", 1, 2), ("l", 2, 2), ("2", 0, 1), ("0", 2, 0), ("99", 0, 2), ("-1", 1, 1)],
    ],
)
def test_keys_step_and_stop_at_both_ends(key: str, place: int, then: int | None) -> None:
    assert next_place(key, place, 3, looks=[0, 2]) == then


def test_the_first_wrong_frame_of_each_look_of_each_person_is_a_step_of_its_own():
    """The boy looks at the bird all the time; the girl at the cup, at the bird, and after a gap at the bird again."""
    rows = [("girl", 1, 3, "cup"), ("girl", 4, 5, "bird"), ("girl", 7, 8, "bird"), ("boy", 1, 8, "bird")]
    things, right = [target_record(1, "cup"), target_record(2, "bird")], {"girl": (1, 7), "boy": (2,)}
    given = Labels(LabelRange(first_frame=a, last_frame=b, subject=who, label=Label(target=t)) for who, a, b, t in rows)

    def said(who: str, frame: int):
        truth = next((t for name, a, b, t in rows if name == who and a <= frame <= b), "cup")
        focus = {"cup": 1, "bird": 2}[truth] if frame in right[who] else None
        return subject_record(who, totals={} if focus is None else {focus: 0.5}, focus=focus)

    records = [frame_record(things, [said("girl", frame), said("boy", frame)], frame=frame) for frame in range(1, 9)]
    scores = score(records, Reference(labels={"clip": given}))
    wrong = wrong_verdicts(scores, Chosen())
    found = [(wrong[place].subject, wrong[place].frame) for place in first_of_looks(wrong, scores)]
    assert sorted(found) == [("boy", 1), ("girl", 2), ("girl", 4), ("girl", 8)]


def test_a_look_that_is_labelled_in_every_second_frame_is_one_step():
    """As the looks of all tables are."""
    given = [("girl", "bird" if frame % 2 else "ignore", frame) for frame in range(1, 8)]
    truth = Labels(LabelRange(first_frame=n, last_frame=n, subject=who, label=Label(target=t)) for who, t, n in given)
    records = [
        frame_record([target_record(1, "bird")], [subject_record("girl", totals={}, focus=None)], frame=frame)
        for frame in range(1, 8)
    ]
    scores = score(records, Reference(labels={"clip": truth}))
    wrong = wrong_verdicts(scores, Chosen())
    assert [verdict.frame for verdict in wrong] == [1, 3, 5, 7]
    assert first_of_looks(wrong, scores) == [0]


def test_a_failure_is_one_line_that_says_what_was_wrong():
    line = describe(wrong_verdicts(SCORES, Chosen()), 1)
    assert line == "2/4  b, two, frame 7: ann looks at cup, predicted book (outscored)"


def test_a_failure_by_another_object_of_the_true_name_says_so():
    said = {"truth": "cup", "predicted": "cup", "outcome": "wrong", "error_type": "missed"}
    verdict = Verdict(clip="a", configuration="one", frame=7, subject="ann", **said)
    assert "ann looks at cup, predicted cup (another of this name) (missed)" in describe([verdict], 0)


@pytest.mark.parametrize(
    ("more", "said"),
    [((), "expected a terminal"), (("--frame", "3"), "leave out --frame, --compare and --screenshot")],
)
def test_without_a_terminal_or_with_a_frame_it_is_one_line(more, said, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["vfoa", "view", str(tmp_path), "--failures", *more])
    monkeypatch.setattr(sys, "stdin", io.StringIO())
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_the_page_of_failures_is_scored_anew_only_after_it_was_shown(tmp_path, monkeypatch):
    from harness.score import finished_run

    (tmp_path / "b__two.rrd").touch()
    clips = [{"name": "b", "frames": [1, 3, 7]}]
    write_manifest(RunDirectory(tmp_path), {"clips": clips, "configurations": {"two": {}}})
    scored, served = [], []
    monkeypatch.setattr(finished_run, "read_scores", lambda directory, where: scored.append(directory) or SCORES)
    monkeypatch.setattr(
        sys.modules["harness.cli.failures"], "browse", lambda recordings, paths, more: served.extend(more)
    )
    browse_failures(tmp_path, Chosen())
    (listed,) = (route.endpoint for route in served if route.path == "/failures.json")
    counts = []
    for _ in range(3):
        assert [row["frame"] for row in json.loads(listed(None).body)] == ["3", "7"]
        counts.append(len(scored))
    assert counts == [1, 2, 3]


@pytest.fixture
def step_through(tmp_path, monkeypatch):
    """Step through a run by keys, with a viewer that only takes notes; give the exit status, and what was shown."""
    from harness.record import viewer
    from harness.score import finished_run

    for name in ("b__two", "b__one", "a__two"):
        (tmp_path / f"{name}.rrd").touch()
    clips = [{"name": name, "frames": list(range(1, 10)), "names": PEOPLE} for name in ("a", "b")]
    write_manifest(RunDirectory(tmp_path), {"clips": clips, "configurations": {"one": {}, "two": {}}})
    went = []

    @contextlib.contextmanager
    def opened(*, instead):
        yield lambda recording, frame, tabs: went.append((recording.name, frame, *tabs))

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr(viewer, "opened", opened)
    monkeypatch.setattr(finished_run, "read_scores", lambda directory, where: SCORES)

    def step(keys, *options):
        monkeypatch.setattr(sys, "stdin", Terminal(keys))
        monkeypatch.setattr(sys, "argv", ["vfoa", "view", str(tmp_path), "--failures", *options])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, went

    return step


def test_a_run_is_stepped_through_as_the_keys_say(step_through, capsys):
    code, went = step_through("\nn\np\nq\nn\n")
    assert code == 0
    assert went == [
        ("b", 3, "two", "bob"),
        ("b", 7, "two", "ann"),
        ("b", 1, "one", "ann"),
        ("b", 7, "two", "ann"),
    ]
    assert [line[:3] for line in capsys.readouterr().out.replace("> ", "").splitlines() if "/4" in line] == [
        "1/4",
        "2/4",
        "3/4",
        "2/4",
    ]


def test_a_key_that_does_nothing_names_the_keys(step_through, capsys):
    assert step_through("x\nq\n") == (0, [("b", 3, "two", "bob")] * 2)
    assert capsys.readouterr().out.count(KEYS) == 2


def test_an_interrupted_correction_goes_back_and_an_interrupted_key_quits(step_through, monkeypatch, capsys):
    """The end of the input is to a prompt what Ctrl-C and Ctrl-D are."""
    from harness.annotate import correction

    monkeypatch.setattr(correction, "look_around", lambda *of_frame: SimpleNamespace(first=1, last=4))
    monkeypatch.setattr(correction, "choices", lambda *of_subject: ["cup"])
    assert step_through("w\n")[0] == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.count("1/4") == 2
    assert printed.out.endswith("\n")


def test_only_the_failures_of_a_subject_are_stepped_through(step_through, capsys):
    code, went = step_through("n\nn\nq\n", "--config", "two", "--subject", "ann")
    assert (code, went) == (0, [("b__two", 7, "two", "ann"), ("a__two", 9, "two", "ann"), ("a__two", 9, "two", "ann")])
    assert step_through("q\n", "--subject", "anna")[0] == 2
    assert "no subject 'anna'; did you mean 'ann'?" in capsys.readouterr().err


def test_only_the_failures_of_an_error_type_are_stepped_through(step_through, capsys):
    assert step_through("q\n", "--error", "outscored")[1] == [("b", 3, "two", "bob")]
    assert step_through("q\n", "--error", "No hit")[0] == 0
    assert "no_hit; there are: outscored (4)" in capsys.readouterr().out
    assert step_through("q\n", "--error", "outscore")[0] == 2
    assert "did you mean 'outscored'?" in capsys.readouterr().err


def test_only_the_failures_of_frames_that_meet_a_condition_are_stepped_through(step_through, monkeypatch, capsys):
    from harness.score import finished_run

    asked = []
    monkeypatch.setattr(finished_run, "read_scores", lambda directory, where: asked.extend(where) or SCORES)
    assert step_through("q\n", "--where", "target=cup", "--where", "frame>2")[0] == 0
    assert [each.text for each in asked] == ["target=cup", "frame>2"]
    assert step_through("q\n", "--where", "targte=cup")[0] == 2
    assert "did you mean 'target'?" in capsys.readouterr().err


@pytest.mark.parametrize("option", [("--where", "target=cup"), ("--error", "missed")])
def test_conditions_on_failures_need_failures(option, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["vfoa", "view", str(tmp_path), *option])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert "add --failures" in capsys.readouterr().err


def test_a_run_without_labels_has_no_failures_because_nothing_is_scored(step_through, tmp_path, monkeypatch, capsys):
    from harness.score import finished_run

    (tmp_path / "a__one.rrd").touch()
    assert step_through("q\n", "--clip", "a", "--config", "one") == (0, [])
    assert "No wrong frame" in capsys.readouterr().out
    assert step_through("q\n", "--clip", "a", "--subject", "bob") == (0, [])
    assert "no frame has a label" in capsys.readouterr().out
    unlabelled = score(
        [frame_record([target_record(1, "cup")], [subject_record("ann")], clip="a")], Reference(labels={})
    )
    monkeypatch.setattr(finished_run, "read_scores", lambda directory, where: unlabelled)
    assert step_through("q\n") == (0, [])
    assert "no frame has a label" in capsys.readouterr().out


def test_failures_without_a_recording_are_counted_and_left_out(step_through, tmp_path, capsys):
    (tmp_path / "b__two.rrd").unlink()
    assert step_through("n\nq\n") == (0, [("b__one", 1, "one", "ann"), ("a__two", 9, "two", "ann")])
    assert capsys.readouterr().err.startswith("vfoa: left out: 2 wrong frames")
