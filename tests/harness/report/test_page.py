from __future__ import annotations

import base64
import json
import re
import zlib
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
import pytest

from harness.labels.labels import Label, LabelRange, Labels
from harness.record.appearance import Colours
from harness.report.page.data import LETTERS, STATES, differing_settings
from harness.report.page.packing import RunAttention, runs, steps
from harness.report.page.render import RunTables, render_page
from harness.report.write import run_tables
from harness.run.manifest import AnswerTraits, ClipOfRun, RunManifest
from harness.run.records import FrameRecord
from harness.score.reference import Reference
from harness.score.score import Scores
from harness.score.verdicts import answered
from tests.records import answers, frame_record, labels, run_manifest, scored_records, subject_record, target_record
from vfoa.scoring import NO_HIT

EVIL = "</script><script>alert(1)</script>"


def _scored(
    records: Iterable[FrameRecord], truth: Mapping[str, Labels]
) -> tuple[Scores, RunTables, RunAttention, dict[str, Any]]:
    """What a page is made of."""
    scores, attention, _ = scored_records(records, Reference(labels=truth))
    return scores, run_tables(scores), attention, run_manifest(scores.clips)


class _Page(HTMLParser):
    """The scripts of a page by id, and what it refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: dict[str | None, str] = {}
        self.references: list[str | None] = []
        self._script: list[str | None] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value for name, value in attrs if name in ("src", "href") and value != "#frames"]
        if tag == "script":
            self._script = [dict(attrs).get("id")]
            self.scripts[self._script[0]] = ""

    def handle_endtag(self, tag: str) -> None:
        if tag == "script":
            self._script = []

    def handle_data(self, data: str) -> None:
        if self._script:
            self.scripts[self._script[0]] += data

    @property
    def data(self) -> Any:
        return json.loads(self.scripts["data"])

    def bytes_of(self, name: str) -> bytes:
        return zlib.decompress(base64.b64decode(self.scripts[f"pack-{name}"]))

    def pack(self, name: str) -> Any:
        return json.loads(self.bytes_of(name))


def _expanded(coded: list[int]) -> list[int]:
    return [value for value, count in zip(coded[::2], coded[1::2], strict=True) for _ in range(count)]


def test_runs_and_steps_say_what_was_coded() -> None:
    values, frames = np.array([3, 3, -1, 3, 7, 7, 7]), np.array([2, 4, 6, 7, 8, 20])
    assert _expanded(runs(values)) == values.tolist()
    first, *differences = steps(frames)
    assert [int(first) + sum(_expanded(differences)[:k]) for k in range(len(frames))] == frames.tolist()
    assert runs(values[:0]) == steps(frames[:0]) == []


@pytest.mark.parametrize(("first", "step"), [(1, 1), (0, 8), (10**18, 40_000_000)])
def test_a_page_has_the_times_of_frames_whatever_they_are_numbered_by(first: int, step: int) -> None:
    """A recording paused for 20 s, and its first frame has no label: times are those of the clip all the same."""
    frames = [first + step * at for at in range(5)]
    times_ns = [10**18 + int(1e9 * time_s) for time_s in (0, 0.04, 0.08, 20.12, 20.16)]
    records = [replace(record, frame=frame) for frame, record in zip(frames[1:], answers(["cup"] * 4), strict=True)]
    scores, tables, attention, _ = _scored(records, {})
    clip = ClipOfRun(name="clip", frames=frames, times_ns=times_ns, rate_hz=25.0)
    page = _Page(render_page(scores, tables, attention, RunManifest(experiment="test", clips=[clip])))
    (track,) = page.pack("clip-0")["tracks"]
    of_first, *differences = track["hundredths"]
    assert (of_first, _expanded(differences)) == ("4", [4, 2004, 4])


def test_a_target_has_the_colour_of_the_recordings() -> None:
    """They give the first colours to the names of the manifest, in its order; a renamed target keeps its colour."""
    given = ("lamp", "cup", "dragon")
    scores, tables, attention, _ = _scored(answers(given), {"clip": labels(*given)})
    names = {"subjects": {"girl": {}}, "targets": {"mug": {}, "lamp": {}}}
    manifest = RunManifest.model_validate({"clips": [{"name": "clip", "frames": [1, 2, 3], "names": names}]})
    page = _Page(render_page(scores, tables, attention, manifest, names_now={"clip": {"mug": "cup"}}))
    shown = {page.data["names"][int(code)]: colour for code, colour in page.pack("clip-0")["colours"].items()}
    expected = Colours(["cup", "lamp", "girl", "dragon"])
    assert shown == {name: "rgb({} {} {})".format(*expected.of(name)) for name in given}


def test_the_values_of_probabilities_include_that_of_looking_at_nothing() -> None:
    things = [target_record(1, "cup"), target_record(2, "book")]
    totals = ({1: 0.3, 2: 0.1}, {1: 0.0, 2: 0.9})
    records = [
        frame_record(things, [subject_record("girl", totals=each)], frame=frame)
        for frame, each in enumerate(totals, start=1)
    ]
    known = {"cup": [75, 0], "book": [25, 225]}
    for probabilistic, expected in ((True, {**known, "none": [150, 25]}), (False, known)):
        reference = Reference(
            labels={"clip": labels("cup", "cup")}, traits={"one": AnswerTraits(probabilistic=probabilistic)}
        )
        scores, attention, _ = scored_records(records, reference)
        page = _Page(render_page(scores, run_tables(scores), attention, run_manifest(scores.clips)))
        (track,) = page.pack("clip-0")["tracks"]
        names = [page.data["names"][code] for code in track["configurations"][0]["attended"]]
        values = np.frombuffer(page.bytes_of("attention-0"), dtype=np.uint8)[: 2 * len(names)].reshape(-1, 2)
        assert dict(zip(names, values.tolist(), strict=True)) == expected


def test_a_name_of_several_objects_has_the_probability_of_all_and_of_attention_the_greatest() -> None:
    things = [target_record(1, "cup"), target_record(2, "book"), target_record(3, "cup")]
    totals = ({1: 0.3, 2: 0.1, 3: 0.2}, {1: 0.1, 2: 0.2, 3: 0.4})
    records = [
        frame_record(things, [subject_record("girl", totals=each)], frame=frame)
        for frame, each in enumerate(totals, start=1)
    ]
    for probabilistic, expected in ((True, [125, 125]), (False, [75, 100])):
        traits = {"one": AnswerTraits(probabilistic=probabilistic)}
        _, attention, _ = scored_records(records, Reference(labels={"clip": labels("cup", "cup")}, traits=traits))
        found = attention["clip", "one"].by_subject["girl"]["cup"]
        assert (found.frames.tolist(), found.values[0].tolist()) == ([1, 2], expected)


def test_timelines_say_what_the_verdicts_say() -> None:
    given = ("cup", "none", "dragon", None, "cup")
    page = _Page(render_page(*_scored(answers(given), {"clip": labels("cup", "cup", "cup", "cup")})))
    names = [*page.data["names"], None]
    (track,) = page.pack("clip-0")["tracks"]
    (lane,) = track["configurations"]
    assert (page.data["clips"][0]["name"], track["subject"]) == ("clip", "girl")
    assert page.data["configurations"] == [{"name": "one", "oracle": False}]
    assert track["frames"] == ["1", 1, 4]
    assert [STATES[each] for each in _expanded(lane["states"])] == [
        *("correct", "no_hit", "missed", "no_subject", "unscored")
    ]
    assert [names[each] for each in _expanded(track["truth"])] == ["cup"] * 4 + [None]
    assert [names[each] for each in _expanded(lane["predicted"])] == ["cup", NO_HIT, "dragon", None, "cup"]
    assert [names[each] for each in lane["attended"]] == ["cup", "dragon"]
    (half, none, unknown) = (125, 255, 255)
    assert list(page.bytes_of("attention-0")) == [
        *(half, none, none, none, half),  # total of the cup, frame by frame
        *(none, none, half, none, none),  # total of the dragon
        *(half, none, none, none, half, *[unknown] * 5),  # gaze and head of the cup
        *(none, none, half, none, none, *[unknown] * 5),
    ]


def test_a_name_cannot_break_out_of_the_page() -> None:
    made = _scored(answers([EVIL, "none"], clip=EVIL, configuration=EVIL), {EVIL: labels(EVIL, EVIL)})
    text = render_page(*made)
    assert "<script>alert" not in text
    assert _Page(text).data["clips"][0]["name"] == EVIL


def test_the_page_refers_to_nothing_outside() -> None:
    assert _Page(render_page(*_scored(answers(["cup"]), {"clip": labels("cup")}))).references == ["data:,"]


def test_a_run_without_labels_has_a_page_too() -> None:
    page = render_page(*_scored(answers(["cup", None]), {}))
    assert "not scored" in page
    assert "Nothing is scored" in page
    assert re.findall(r'<h2 id="(\w+)">', page) == ["answers", "frames", "more", "settings"]


def test_answers_in_clips_without_labels_follow_the_rates_of_the_others() -> None:
    records = [*answers(["cup", None]), *answers(["cup"], clip="new")]
    page = render_page(*_scored(records, {"clip": labels("cup", "cup")}))
    assert re.findall(r'<h2 id="(\w+)">', page)[:4] == ["rates", "errors", "answers", "frames"]
    assert page.count("new: no frame is labelled") == 1


def test_every_outcome_has_a_letter_of_its_own() -> None:
    assert set(LETTERS) == set(STATES)
    assert len(set(LETTERS.values())) == len(LETTERS)


@pytest.mark.parametrize(("budget", "stride"), [(10**9, 1), (1_000, None)])
def test_attention_that_is_too_much_is_thinned_and_the_page_says_so(
    budget: int, stride: int | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("harness.report.page.packing.MOST_BYTES", budget)
    targets = [target_record(each, f"thing {each}") for each in range(1, 11)]
    noise = np.random.default_rng(0).uniform(0.01, 1, (300, 10)).tolist()
    records = [
        frame_record(targets, [subject_record("girl", totals=dict(enumerate(row, 1)), focus=1)], frame=frame)
        for frame, row in enumerate(noise, start=1)
    ]
    text = render_page(*_scored(records, {"clip": labels("thing 2")}))
    page = _Page(text)
    found = page.data["stride"]
    assert found == stride or (stride is None and found > 1)
    held = list(page.bytes_of("attention-0"))
    assert len(held) == 10 * len(range(0, 300, found)) * 3
    assert held[1] == round(250 * noise[found][0])
    assert (f"every {found}th frame" in text) == (found > 1)


def test_every_scored_frame_has_one_answer() -> None:
    scores, *_ = _scored(
        answers(("cup", "none", "dragon", None, "cup", "book")),
        {"clip": labels("cup", "cup", "cup", "cup", "ignore", "dragon")},
    )
    found = Counter((verdict.truth, answered(verdict)) for verdict in scores.verdicts if verdict.outcome != "unscored")
    wrong = {("cup", NO_HIT): 1, ("cup", "dragon"): 1, ("cup", "no prediction"): 1, ("dragon", "book"): 1}
    assert found == {("cup", "cup"): 1, **wrong}


def test_another_instance_of_the_true_name_is_no_agreement() -> None:
    cups = [target_record(1, "cup", box_px=(0, 0, 9, 9)), target_record(2, "cup", box_px=(50, 50, 60, 60))]
    record = frame_record(cups, [subject_record("girl", totals={1: 0.1, 2: 0.5}, focus=2)])
    label = Label(target="cup", point_px=(5.0, 5.0))
    truth = Labels([LabelRange(first_frame=1, last_frame=1, subject="girl", label=label)])
    scores, *_ = _scored([record], {"clip": truth})
    assert [(verdict.truth, answered(verdict)) for verdict in scores.verdicts] == [
        ("cup", "cup (another of this name)")
    ]


def test_only_settings_that_differ_are_listed() -> None:
    one = {"stereo": {"matcher": "bm", "wls": False}, "attention": {"cones_cm": [10.0]}}
    two = {"stereo": {"matcher": "bm", "wls": False, "mode": "hh"}, "attention": {"cones_cm": [10.0, 25.0]}}
    table = differing_settings({"one": one, "two": two})
    assert table.columns == ("Setting", "one", "two")
    assert table.rows == (("attention.cones_cm", "10.0", "10.0, 25.0"), ("stereo.mode", "–", "hh"))


def test_it_says_when_and_of_what_it_is_and_under_which_terms() -> None:
    scores, tables, attention, _ = _scored(answers(["cup"]), {"clip": labels("cup")})
    clip = ClipOfRun(name="clip", licence="CC-BY 4.0", frames=[1], citation="Doe 2020")
    manifest = RunManifest(clips=[clip], commit="0123456789abcdef", finished="2026-01-02T03:04:05+00:00")
    text = render_page(scores, tables, attention, manifest)
    (table,) = (each for each in _Page(text).pack("tables") if each["title"] == "Clips, licences")
    assert table["rows"] == [["clip", "CC-BY 4.0", "Doe 2020", "1", "–"]]
    facts = re.findall(r"<span>(.*?)</span>", text.split('<p class="meta">')[1].split("</p>")[0])
    assert facts == [
        "2026-01-02 03:04:05 UTC",
        "commit 0123456789",
        "1 clip, 1 frame",
        "n = 1 labelled frames of subjects",
    ]


def test_a_manifest_with_no_more_than_scores_need_has_a_page() -> None:
    scores, tables, attention, _ = _scored(answers(["cup"]), {"clip": labels("cup")})
    manifest = RunManifest(clips=[ClipOfRun(name="clip", frames=[1])], configurations={"one": {}})
    (table,) = (
        each
        for each in _Page(render_page(scores, tables, attention, manifest)).pack("tables")
        if each["title"] == "Clips, licences"
    )
    assert table["rows"] == [["clip", "–", "–", "1", "–"]]
