"""The page's data: one object of plain values, documented at :func:`page_data`, and packs of its large parts."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.files.parsing import flattened
from harness.record.appearance import Colours
from harness.report.formats import UNKNOWN, Table
from harness.report.page.packing import (
    BySubject,
    RunAttention,
    attended,
    frames_of,
    pack_attention,
    pack_json,
    runs,
    steps,
    target_colours,
)
from harness.report.thumbnails import Thumbnails
from harness.run.columns import NO_ID
from harness.run.columns import UNKNOWN as UNKNOWN_WORD
from harness.run.directory import Pair
from harness.run.manifest import ClipOfRun
from harness.score.judged_subjects import JudgedSubject
from harness.score.oracle_ablation import without_oracles
from harness.score.rows import ScoreRow
from harness.score.score import Scores
from harness.score.verdict_columns import SubjectVerdicts
from harness.score.verdicts import ERROR_TYPES
from vfoa.scoring import NO_HIT, NO_PREDICTION
from vfoa.types import Codes

STATES = ("correct", "unscored", *ERROR_TYPES)
"""States of a frame of a timeline; the data holds the place in this list, -1 if there is no frame."""

_STATE_CODES = {state: code for code, state in enumerate(STATES)}

LETTERS = {
    "correct": "",
    "unscored": "·",
    "no_subject": "S",
    "no_eyes_3d": "E",
    "face_turned_away": "A",
    "no_direction": "D",
    "no_answer": "X",
    "no_object": "P",
    "target_not_segmented": "T",
    "target_without_box": "B",
    "false_attention": "F",
    "wrong_subject": "W",
    "no_hit": "N",
    "missed": "M",
    "outscored": "O",
}
"""A letter for each state of a timeline's frame, so that outcomes can be told apart without colour."""

ERROR_COLOURS = {
    "no_subject": ("#312e81", "#9aa5ff"),
    "no_eyes_3d": ("#4338ca", "#818cf8"),
    "face_turned_away": ("#c026d3", "#e879f9"),
    "no_direction": ("#6d28d9", "#b79bff"),
    "no_answer": ("#334155", "#94a3b8"),
    "no_object": ("#4d7c0f", "#a3e635"),
    "target_not_segmented": ("#0e7490", "#4fc3d9"),
    "target_without_box": ("#0f766e", "#3fbfae"),
    "false_attention": ("#a16207", "#d6a72c"),
    "wrong_subject": ("#9d174d", "#f08abb"),
    "no_hit": ("#525b69", "#98a2b3"),
    "missed": ("#c2410c", "#f08c5a"),
    "outscored": ("#b3261e", "#f0726a"),
}
"""The colour of each error type in all figures of the page, on a light and on a dark screen."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Served:
    """Data of a page that a server delivers: its run's directory, and the name under which each recording opens."""

    run: str
    recordings: Mapping[Pair, str]


class NameCodes(dict[str, int]):
    """Numbers for names, in the order in which they are first used."""

    def code(self, name: str | None) -> int:
        """The number of a name; -1 for none."""
        return -1 if name is None else self.setdefault(name, len(self))


def page_data(
    scores: Scores,
    attention: RunAttention,
    thumbnails: Thumbnails,
    served: Served | None,
    clips_of_run: Mapping[str, ClipOfRun],
    run_folder: str,
    names_of: Mapping[str, Sequence[str]],
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the data object, and packs by name.

    ``clips_of_run`` give the times of frames; ``names_of`` a clip are those of its manifest, in the order of their
    colours.

    The object, read by ``store.js``::

        states, letters, error_types   states of a frame; words for each
        names                          targets and answers; elsewhere numbers stand for them, -1 for none
        configurations                 {name, oracle: whether it is a step of the oracle ablation}
        clips                          {name, subjects, frames: their number}
        stride                         attention is here for every ``stride``-th frame
        is_recorded                    whether the run has recordings
        run, recordings                of a served page: the directory; recordings by clip and configuration; else null
        folder                         the run's directory, from the page: "." or an address that ends with a slash
        pictures                       of a page on the disk without room for all pictures: their folder; else null
        overall                        rows over all clips
        scored                         configurations that rows name: one for all seeds of a configuration

    A row is ``[clip or -1, scored configuration, n, looks, correct, low, high, best baseline's FRR, beats, [wrong
    frames by error type]]``; low and high are the ends of the 95 % interval, null if unknown.

    Packs: ``rows`` are the rows of the clips. ``clip-K`` is the output of :func:`_clip_data` for clip number K,
    ``attention-K`` its values: for each subject, configuration and target a byte per ``stride`` frames of total, then
    of gaze and head; 250 is 1, 255 unknown. ``pictures-K`` are its thumbnails: data URIs by frame, and the objects that
    each configuration saw.
    """
    names, numbers = NameCodes(), {name: i for i, name in enumerate(scores.configurations)}
    scored = {name: i for i, name in enumerate(scores.scored_configurations)}
    plain = set(without_oracles(scores.scored_configurations)) | set(without_oracles(scores.configurations))
    by_clip = _by_clip(scores.judged_subjects)
    clips, packs = [], {}
    stride, values = pack_attention(scores.clips, by_clip, attention)
    for number, clip in enumerate(scores.clips):
        subjects = by_clip.get(clip, {})
        colours = target_colours(attention, clip, names_of.get(clip, ()))
        track = _clip_data(clip, subjects, numbers, names, attention, colours, clips_of_run.get(clip))
        packs[f"clip-{number}"] = pack_json(track)
        if values[clip]:
            packs[f"attention-{number}"] = values[clip]
        if pictures := _pictures(clip, subjects, numbers, thumbnails):
            packs[f"pictures-{number}"] = pack_json(pictures)
        frames = {frame for judged in subjects.values() for frame in frames_of(judged).tolist()}
        clips.append({"name": clip, "subjects": list(subjects), "frames": len(frames)})
    rows = scores.rows.by_clip
    places = {clip: number for number, clip in enumerate(scores.clips)}
    packs["rows"] = pack_json([_row(row, places, scored) for row in rows if row.clip is not None])
    data = {
        "states": STATES,
        "letters": LETTERS,
        "error_types": ERROR_TYPES,
        "configurations": [{"name": name, "oracle": name not in plain} for name in numbers],
        "scored": [{"name": name, "oracle": name not in plain} for name in scored],
        "clips": clips,
        "stride": stride,
        "is_recorded": scores.is_recorded,
        "run": served and served.run,
        "folder": run_folder or ".",
        "pictures": f"{run_folder}thumbnails"
        if served is None and len(thumbnails.pictures) < thumbnails.wrong
        else None,
        "recordings": served and _recordings(served),
        "overall": [_row(row, {}, scored) for row in scores.rows.overall],
        "names": list(names),
    }
    return data, packs


def _by_clip(subjects: Iterable[JudgedSubject]) -> dict[str, dict[str, BySubject]]:
    by_clip: dict[str, dict[str, BySubject]] = {}
    for of_subject in subjects:
        judged = by_clip.setdefault(of_subject.clip, {}).setdefault(of_subject.subject, {})
        judged[of_subject.configuration] = of_subject.judged
    return by_clip


def _row(row: ScoreRow, places: Mapping[str, int], scored: Mapping[str, int]) -> list[Any]:
    ends = (row.interval.low, row.interval.high)
    return [
        places.get(row.clip or "", -1),
        scored[row.configuration],
        row.n,
        row.looks,
        row.correct,
        *(None if math.isnan(end) else end for end in ends),
        row.baselines[row.best_baseline],
        row.beats,
        list(row.error_types.values()),
    ]


def _clip_data(
    clip: str,
    subjects: Mapping[str, BySubject],
    numbers: Mapping[str, int],
    names: NameCodes,
    attention: RunAttention,
    colours: Colours,
    of_run: ClipOfRun | None,
) -> dict[str, Any]:
    """A clip's timelines, and the colours of its targets as CSS by number of the name.

    A track is a subject: ``frames`` are numbers as :func:`harness.report.page.packing.steps` codes them, ``hundredths``
    their times, in hundredths of a second since the clip's first frame (empty if the run has no times), ``truth`` and
    each configuration's ``states``, ``predicted`` and ``answers`` are run-length codes over them. ``predicted`` is the
    target that was predicted, ``answers`` the column of the confusion, ``confidence`` the probability of what was
    predicted in percent, -1 without one. ``attended`` are the targets with values.
    """
    tracks = []
    for subject, judged in subjects.items():
        frames = frames_of(judged)
        truth = np.full(len(frames), -1)
        configurations = []
        for configuration, verdicts in judged.items():
            states, predicted, answers, confidence = (np.full(len(frames), -1) for _ in range(4))
            i = np.searchsorted(frames, verdicts.frames)
            truth[i], predicted[i], answers[i] = _numbered(verdicts, names)
            known = ~np.isnan(verdicts.confidence)
            confidence[i[known]] = np.rint(100 * verdicts.confidence[known])
            states[i] = _states(verdicts)
            configurations.append(
                {
                    "configuration": numbers[configuration],
                    "states": runs(states),
                    "predicted": runs(predicted),
                    "answers": runs(answers),
                    "confidence": runs(confidence),
                    "attended": [names.code(name) for name in attended(attention, (clip, configuration), subject)],
                }
            )
        tracks.append(
            {
                "subject": subject,
                "frames": steps(frames),
                "hundredths": steps(_hundredths(frames, of_run)),
                "truth": runs(truth),
                "configurations": configurations,
            }
        )
    return {"tracks": tracks, "colours": _colours(colours, tracks, names)}


def _hundredths(frames: NDArray[np.int64], of_run: ClipOfRun | None) -> Codes:
    """The times of frames, hundredths of a second since the clip's first frame; none if the run has no times."""
    if of_run is None or not of_run.times_ns:
        return np.zeros(0, dtype=np.intp)
    times_ns = np.array(of_run.times_ns, dtype=np.int64)
    places = np.searchsorted(np.array(of_run.frames, dtype=np.int64), frames)
    return np.rint((times_ns[places] - times_ns[0]) / 1e7).astype(np.intp)


def _numbered(verdicts: SubjectVerdicts, names: NameCodes) -> Codes:
    """The numbers (3, n) of truths, predictions and answers; they are given in the order in which words are shown."""
    words = verdicts.words
    no_hit = words.code(NO_HIT)
    answers = np.where(verdicts.is_wrong & (verdicts.predicted == no_hit), no_hit, verdicts.answers())
    answers[answers == UNKNOWN_WORD] = words.code(NO_PREDICTION)
    shown = np.stack([verdicts.truth, verdicts.predicted, np.where(verdicts.is_scored, answers, UNKNOWN_WORD)], axis=1)
    codes, first, places = np.unique(shown, return_index=True, return_inverse=True)
    numbers = np.zeros(len(codes), dtype=np.intp)
    for place in np.argsort(first).tolist():
        numbers[place] = names.code(words.word(int(codes[place])))
    return numbers[places.reshape(shown.shape)].T


def _states(verdicts: SubjectVerdicts) -> Codes:
    """The places of the frames' states in :data:`STATES`."""
    codes, places = np.unique(verdicts.error_type, return_inverse=True)
    states = np.array([_STATE_CODES[verdicts.words.word(code) or "correct"] for code in codes.tolist()], dtype=np.intp)
    return np.where(verdicts.is_scored, states[places], _STATE_CODES["unscored"])


def _colours(colours: Colours, tracks: list[dict[str, Any]], names: NameCodes) -> dict[int, str]:
    shown = {code for track in tracks for code in track["truth"][::2] if code >= 0}
    shown |= {code for track in tracks for made in track["configurations"] for code in made["attended"]}
    words = list(names)
    return {code: "rgb({} {} {})".format(*colours.of(words[code])) for code in sorted(shown)}


def _pictures(
    clip: str, subjects: Mapping[str, BySubject], numbers: Mapping[str, int], thumbnails: Thumbnails
) -> dict[str, Any] | None:
    """``pictures`` by frame; ``seen`` by subject, configuration and frame, for the frames judged wrong."""
    pictures = {frame: uri for (name, frame), uri in thumbnails.pictures.items() if name == clip}
    if not pictures:
        return None
    seen = {
        subject: {numbers[configuration]: _seen(verdicts, thumbnails) for configuration, verdicts in judged.items()}
        for subject, judged in subjects.items()
    }
    return {"pictures": pictures, "seen": seen}


def _seen(verdicts: SubjectVerdicts, thumbnails: Thumbnails) -> dict[int, dict[str, Any]]:
    """By frame, the marks drawn over the picture of a subject who was judged wrong.

    ``truth`` is the id of the object that the label means; None where any of the true name may be meant.
    """
    drawn = {}
    wrong = verdicts.where(verdicts.is_wrong)
    for frame, true_id in zip(wrong.frames.tolist(), wrong.true_ids.tolist(), strict=True):
        thumbnail = thumbnails.seen.get((verdicts.clip, verdicts.configuration, frame))
        if thumbnail is not None:
            subject = next((person for person in thumbnail.subjects if person.name == verdicts.subject), None)
            drawn[frame] = {
                "size": thumbnail.size,
                "boxes": thumbnail.boxes,
                "head": subject and subject.head,
                "focus": subject and subject.focus,
                "truth": None if true_id == NO_ID else true_id,
                "lines": subject.lines if subject else [],
            }
    return drawn


def _recordings(served: Served) -> dict[str, dict[str, str]]:
    by_clip: defaultdict[str, dict[str, str]] = defaultdict(dict)
    for (clip, configuration), name in served.recordings.items():
        by_clip[clip][configuration] = name
    return by_clip


def differing_settings(configurations: Mapping[str, Mapping[str, Any]]) -> Table:
    """The settings in which a run's configurations differ, one row per setting and one column per configuration."""
    flat = {name: dict(flattened(settings)) for name, settings in configurations.items()}
    keys = dict.fromkeys(key for settings in flat.values() for key in settings)
    rows = [(key, *(_setting(settings.get(key, UNKNOWN)) for settings in flat.values())) for key in keys]
    return Table(
        title="Where the configurations differ",
        columns=("Setting", *flat),
        words=1,
        rows=tuple(row for row in rows if len(set(row[1:])) > 1),
    )


def _setting(value: object) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
