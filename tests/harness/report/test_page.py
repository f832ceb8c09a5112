from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from html.parser import HTMLParser
from typing import Any

from harness.labels.files import Label, LabelRange, Labels
from harness.report.page import LETTERS, render_page
from harness.report.page_data import STATES, AttentionLog, confusions, differing_settings
from harness.report.thumbnails.reader import BUDGET_BYTES, Thumbnails
from harness.run.results import FrameRecord
from harness.score.reference import Reference
from harness.score.score import Scores, score
from harness.score.verdicts import NO_HIT
from tests.records import answers, frame_record, labels, subject_record, target_record

EVIL = "</script><script>alert(1)</script>"


def _scored(records: Iterable[FrameRecord], truth: Mapping[str, Labels]) -> tuple[Scores, AttentionLog]:
    attention = AttentionLog()
    return score(attention.watch(records), Reference(labels=truth)), attention


class _Page(HTMLParser):
    """The scripts of a page, and what it refers to."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.scripts: list[str] = []
        self.references: list[str | None] = []
        self._in_script = False
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.references += [value for name, value in attrs if name in ("src", "href")]
        if tag == "script":
            self._in_script = True
            self.scripts.append("")

    def handle_endtag(self, tag: str) -> None:
        self._in_script = self._in_script and tag != "script"

    def handle_data(self, data: str) -> None:
        if self._in_script:
            self.scripts[-1] += data

    @property
    def data(self) -> Any:
        return json.loads(self.scripts[0])


def test_strips_say_what_the_verdicts_say() -> None:
    given = ("cup", "none", "dragon", None, "cup")
    scores, attention = _scored(answers(given), {"clip": labels("cup", "cup", "cup", "cup")})
    (group,) = _Page(render_page(scores, attention)).data["groups"]
    (strip,) = group["strips"]
    assert (group["clip"], group["subject"], strip["config"]) == ("clip", "girl", "one")
    assert strip["frames"] == [1, 2, 3, 4, 5]
    assert [STATES[each] for each in strip["states"]] == ["correct", "no_hit", "missed", "no_subject", "unscored"]
    assert strip["truth"] == ["cup"] * 4 + [None]
    assert strip["predicted"] == ["cup", NO_HIT, "dragon", None, "cup"]
    gaze, head, total = strip["values"]["cup"]
    assert gaze == total == [500, None, None, None, 500]
    assert head == [None] * 5


def test_a_name_cannot_break_out_of_the_page() -> None:
    scores, attention = _scored(answers([EVIL, "none"], clip=EVIL, configuration=EVIL), {EVIL: labels(EVIL, EVIL)})
    text = render_page(scores, attention)
    assert "<script>alert" not in text
    page = _Page(text)
    assert len(page.scripts) == 2
    assert page.data["groups"][0]["clip"] == EVIL


def test_the_page_refers_to_nothing_outside() -> None:
    scores, attention = _scored(answers(["cup"]), {"clip": labels("cup")})
    assert _Page(render_page(scores, attention)).references == ["data:,"]


def test_a_run_without_labels_has_a_page_too() -> None:
    page = render_page(*_scored(answers(["cup", None]), {}))
    assert "not scored" in page
    assert "No annotated frames." in page


def test_every_outcome_has_a_letter_of_its_own() -> None:
    assert set(LETTERS) == set(STATES)
    assert len(set(LETTERS.values())) == len(LETTERS)


def test_a_run_as_large_as_the_demo_stays_under_three_megabytes() -> None:
    targets = [target_record(each, f"thing {each}") for each in range(1, 11)]
    records = [
        frame_record(
            targets,
            [
                subject_record(
                    "girl", totals={each: 0.1 + 0.001 * (each * frame % 89) for each in range(1, 11)}, focus=1
                )
            ],
            frame=frame,
            configuration=configuration,
        )
        for configuration in ("one", "two", "three", "four")
        for frame in range(1, 421)
    ]
    pictures = {("clip", frame): "p" * (BUDGET_BYTES // 100) for frame in range(1, 101)}
    page = render_page(
        *_scored(records, {"clip": labels(*["thing 2"] * 348)}), thumbnails=Thumbnails(pictures=pictures)
    )
    assert len(page.encode()) < 3_000_000


def test_confusions_count_every_scored_frame_once() -> None:
    scores, _ = _scored(
        answers(("cup", "none", "dragon", None, "cup", "book")),
        {"clip": labels("cup", "cup", "cup", "cup", "ignore", "dragon")},
    )
    (each,) = confusions(scores.verdicts)["clip"]
    assert each.answers == ("cup", "dragon", NO_HIT, "book", "no prediction")
    assert each.rows == (("cup", (1, 1, 1, 0, 1)), ("dragon", (0, 0, 0, 1, 0)))


def test_another_instance_of_the_true_name_is_no_agreement() -> None:
    cups = [target_record(1, "cup", box_px=(0, 0, 9, 9)), target_record(2, "cup", box_px=(50, 50, 60, 60))]
    record = frame_record(cups, [subject_record("girl", totals={1: 0.1, 2: 0.5}, focus=2)])
    label = Label(target="cup", point_px=(5.0, 5.0))
    truth = Labels([LabelRange(first_frame=1, last_frame=1, subject="girl", label=label)])
    scores, _ = _scored([record], {"clip": truth})
    (each,) = confusions(scores.verdicts)["clip"]
    assert each.rows[0][1][each.answers.index("cup")] == 0


def test_only_settings_that_differ_are_listed() -> None:
    one = {"stereo": {"matcher": "bm", "wls": False}, "attention": {"cones_cm": [10.0]}}
    two = {"stereo": {"matcher": "bm", "wls": False, "mode": "hh"}, "attention": {"cones_cm": [10.0, 25.0]}}
    table = differing_settings({"one": one, "two": two})
    assert table.columns == ("Setting", "one", "two")
    assert table.rows == (("attention.cones_cm", "10.0", "10.0, 25.0"), ("stereo.mode", "–", "hh"))


def test_it_says_under_which_terms_the_clips_are_and_what_is_to_be_cited() -> None:
    scores, attention = _scored(answers(["cup"]), {"clip": labels("cup")})
    clip = {"name": "clip", "licence": "CC-BY 4.0", "frames": [1], "rate_hz": None}
    manifest = {"experiment": "e", "clips": [{**clip, "citation": "Doe 2020"}], "configurations": {}, "versions": {}}
    text = render_page(scores, attention, manifest=manifest)
    assert all(word in text for word in ("CC-BY 4.0", "Doe 2020"))
