"""The wrong frames of a run: step from one to the next by keys, or by links in a page."""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from harness.cli.serving import browse
from harness.cli.terminal import say, say_relabelled
from harness.run.grid import is_meant
from vfoa.errors import VfoaError, counted, did_you_mean

if TYPE_CHECKING:
    from harness.record.composed import RecordedClip
    from harness.score.judged_subjects import JudgedSubject
    from harness.score.score import Scores
    from harness.score.subset import Condition
    from harness.score.verdicts import Verdict


@dataclass(frozen=True, slots=True, kw_only=True)
class Chosen:
    """Which wrong frames to show; None: of every clip, configuration, subject and error type.

    ``where``: only of labelled frames that meet all these conditions.
    """

    clip: str | None = None
    configuration: str | None = None
    subject: str | None = None
    error_type: str | None = None
    where: tuple[Condition, ...] = ()


KEYS = "Enter or n: next, p: previous, l: next look, a number: that one, w: the label is wrong, q: quit"


def step_through(run: Path, chosen: Chosen) -> None:
    """Open the viewer at a run's first wrong frame, and step to others by keys."""
    if not sys.stdin.isatty():
        raise VfoaError(
            "view --failures: expected a terminal to read keys from, found none; --failures --web has links"
        )
    from harness.record import viewer
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    say_relabelled(run, chosen.clip)
    say(KEYS)
    place: int | None = 0
    while place is not None:
        recordings = _recorded(run, chosen)
        scores = read_scores(RunDirectory(run), chosen.where)
        wrong = _that_can_be_shown(wrong_verdicts(scores, chosen), recordings)
        if not wrong:
            say(_nothing_to_show(scores, chosen))
            return
        shown = {each.files.clip: each.compose() for each in recordings}
        looks = first_of_looks(wrong, scores)
        place, is_corrected = min(place, len(wrong) - 1), False
        with viewer.opened(instead="--failures --web has a link to each wrong frame, for any browser") as go_to:
            while place is not None and not is_corrected:
                at = wrong[place]
                go_to(shown[at.clip], at.frame, (at.configuration, at.subject))
                say(describe(wrong, place))
                key = _key()
                # the viewer would keep the old content of a corrected recording: it is opened again
                is_corrected = key == "w" and _correct(run, at)
                place = place if is_corrected else next_place(key, place, len(wrong), looks)


def _key() -> str:
    """The key that is pressed; ``q`` for Ctrl-C and Ctrl-D."""
    key = _entered("", default="n", suffix="> ")
    return "q" if key is None else key.lower()


def _entered(text: str, *, default: str, suffix: str) -> str | None:
    """What is entered; None for Ctrl-C and Ctrl-D."""
    try:
        return str(typer.prompt(text, default=default, show_default=False, prompt_suffix=suffix)).strip()
    except typer.Abort:
        say()  # what follows is not in the line of the prompt
        return None


def next_place(key: str, place: int, count: int, looks: Sequence[int] = ()) -> int | None:
    """The place, 0 to ``count`` - 1, that a key leads to; None ends. Both ends stay, and so does every other key.

    ``looks`` are the places in order that ``l`` goes to. A number counts places from 1.
    """
    match key:
        case "q":
            return None
        case "" | "n":
            return min(place + 1, count - 1)
        case "p":
            return max(place - 1, 0)
        case "l":
            return next((look for look in looks if look > place), place)
        case number if number.isdecimal():
            return min(max(int(number), 1), count) - 1
        case "w":
            return place
    say(f"{key}: no such key. {KEYS}")
    return place


def first_of_looks(wrong: Sequence[Verdict], scores: Scores) -> list[int]:
    """The places of those wrong frames that are the first ones of a look: of frames with one true target."""
    import numpy as np

    from harness.score.looks import find_events

    looks = {}
    for each in scores.judged_subjects:
        begins = [event.first for event in find_events(each.truth, each.positions)]
        numbers = np.searchsorted(begins, each.positions, side="right").tolist()
        looks[each.clip, each.configuration, each.subject] = dict(zip(each.frames.tolist(), numbers, strict=True))
    first = dict[tuple[object, ...], int]()
    for place, verdict in enumerate(wrong):
        key = verdict.clip, verdict.configuration, verdict.subject
        first.setdefault((*key, looks[key][verdict.frame]), place)
    return [*first.values()]


def describe(wrong: Sequence[Verdict], place: int) -> str:
    """One line: position among the wrong frames, clip, configuration, frame, subject, truth, prediction, error type."""
    from harness.score.verdicts import answered

    verdict = wrong[place]
    where = f"{verdict.clip}, {verdict.configuration}, frame {verdict.frame}"
    predicted = "no prediction" if verdict.predicted is None else f"predicted {answered(verdict)}"
    answer = f"{verdict.subject} looks at {verdict.truth}, {predicted} ({verdict.error_type})"
    return f"{place + 1}/{len(wrong)}  {where}: {answer}"


def _correct(run: Path, wrong: Verdict) -> bool:
    """Ask for the right target of a frame, and write it; return False if nothing was written."""
    from harness.annotate.correction import Correction, choices, correct, look_around
    from harness.run.directory import RunDirectory

    directory = RunDirectory(run)
    try:
        look = look_around(directory, wrong.clip, wrong.subject, wrong.frame)
        names = ", ".join(choices(directory, wrong.clip, wrong.subject))
        say(f"Targets: {names}. Frames: {look.first}-{look.last}, the whole look; add FIRST-LAST for others.")
        answer = _entered("right target [FIRST-LAST], or Enter to go back", default="", suffix=": ")
        if not answer:
            return False
        target, first, last = _target_and_frames(answer, look.first, look.last)
        correction = Correction(clip=wrong.clip, subject=wrong.subject, target=target, first=first, last=last)
        say(f"{correct(directory, correction)}: {correction}. Tables, page and recordings are updated.")
    except VfoaError as error:
        say(f"vfoa: {error}", err=True)
        return False
    return True


def _target_and_frames(answer: str, first: int, last: int) -> tuple[str, int, int]:
    """Parse a target and the frames: ``red cup`` for the look, which has these ends, ``red cup 12-20`` for others."""
    if match := re.fullmatch(r"(.+)\s+(\d+)-(\d+)", answer):
        return match[1], int(match[2]), int(match[3])
    return answer, first, last


def browse_failures(run: Path, chosen: Chosen) -> None:
    """Serve the recordings of a run, and a page that steps through its wrong frames beside the web viewer."""
    from harness.annotate.correction import correction_routes
    from harness.record.composed import by_name, served_recordings
    from harness.record.web_app import failures_routes
    from harness.run.directory import RunDirectory
    from harness.score.finished_run import read_scores

    directory = RunDirectory(run)
    recorded = _recorded(run, chosen)
    say_relabelled(run, chosen.clip)

    def wrong() -> list[Verdict]:
        return wrong_verdicts(read_scores(directory, chosen.where), chosen)

    scores = read_scores(directory, chosen.where)
    found = wrong_verdicts(scores, chosen)
    if not (shown := _that_can_be_shown(found, recorded)):
        say(_nothing_to_show(scores, chosen))
        return
    recordings, known = served_recordings(run), iter([found])  # the page that opens now shows what was counted
    say(counted(len(shown), "wrong frame"))
    failures = failures_routes(lambda: next(known, None) or wrong(), recordings)
    browse(by_name(recordings.values()), ["/"], more=(*failures, *correction_routes(directory)))


def _recorded(run: Path, chosen: Chosen) -> list[RecordedClip]:
    """The recordings of each clip of a run; an unknown name is an error."""
    from harness.record.composed import find_clips

    clips = find_clips(run, chosen.clip, chosen.configuration)
    subjects = list(dict.fromkeys(name for recorded_clip in clips for name in recorded_clip.subjects))
    if chosen.subject is not None and chosen.subject not in subjects:
        raise VfoaError(f"{run}: no subject {chosen.subject!r}; {did_you_mean(chosen.subject, subjects)}")
    return clips


def _that_can_be_shown(wrong: Sequence[Verdict], recordings: Sequence[RecordedClip]) -> list[Verdict]:
    """The wrong frames with a recording; how many have none is printed."""
    recorded = {(each.files.clip, layer.configuration) for each in recordings for layer in each.layers}
    shown = [verdict for verdict in wrong if (verdict.clip, verdict.configuration) in recorded]
    if left_out := len(wrong) - len(shown):
        say(f"vfoa: left out: {counted(left_out, 'wrong frame')} without a recording", err=True)
    return shown


def wrong_verdicts(scores: Scores, chosen: Chosen) -> list[Verdict]:
    """The wrong verdicts, grouped by recording and sorted by frame."""
    judged = (of_subject.judged for of_subject in _judged(scores, chosen))
    wrong = (verdict for each in judged for verdict in each.where(each.is_wrong).verdicts())
    clips, configurations = (
        {name: place for place, name in enumerate(names)} for names in (scores.clips, scores.configurations)
    )
    return sorted(
        (verdict for verdict in wrong if chosen.error_type in (None, verdict.error_type)),
        key=lambda verdict: (clips[verdict.clip], configurations[verdict.configuration], verdict.frame),
    )


def _nothing_to_show(scores: Scores, chosen: Chosen) -> str:
    """Why there is no failure: also because nothing is labelled."""
    from harness.report.verdict import NOTHING_SCORED

    if not any(len(of_subject.frames) for of_subject in _judged(scores, chosen)):
        return NOTHING_SCORED
    others = Counter(verdict.error_type for verdict in wrong_verdicts(scores, replace(chosen, error_type=None)))
    if not others:
        return "No wrong frame."
    counts = ", ".join(f"{name} ({count})" for name, count in others.most_common())
    return f"No wrong frame is {chosen.error_type}; there are: {counts}."


def _judged(scores: Scores, chosen: Chosen) -> Iterator[JudgedSubject]:
    """What was judged of the chosen clip, configuration and subject."""
    for each in scores.judged_subjects:
        asked = (chosen.clip, each.clip), (chosen.subject, each.subject)
        if all(wanted in (None, name) for wanted, name in asked) and is_meant(each.configuration, chosen.configuration):
            yield each
