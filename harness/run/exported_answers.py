"""Answers of a run as tables that another run, or another program, can read.

The format is that of :mod:`harness.pipeline.stage_files.answer_tables`, so that ``attention.method = "answers"`` reads
them back.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from harness.clips.manifest import manifest_of_run
from harness.files.io import check_new
from harness.files.tables import write_rows
from harness.labels.labels import NOWHERE
from harness.pipeline.stage_files.answer_tables import CHANCE, NO_HIT
from harness.run.directory import RunDirectory
from harness.run.records import FrameRecord, SubjectRecord
from harness.run.results import ClipRecords, choose, read_clip_records


def export_answers(run: Path, configuration: str | None, *, folder: Path | None, replace: bool) -> Iterator[Path]:
    """Write the answers of one configuration of a run, a table for each clip: ``folder/CLIP.csv``.

    Parameters
    ----------
    configuration
        None: the only one.
    folder
        None: ``exported/CONFIGURATION`` in the run's directory.

    Raises
    ------
    VfoaError
        If the run has several configurations and none was chosen, or a file is there and is not to be replaced.
    """
    directory = RunDirectory(run)
    manifest = directory.read_manifest()
    configurations = [*manifest.configurations]
    chosen = choose(configurations, configuration, run)
    target = folder or run / "exported" / chosen
    for clip in manifest.clips:
        check_new(target / f"{clip.name}.csv", replace=replace, inputs=directory.inputs)
    for clip in manifest.clips:
        of_clip = manifest_of_run(clip.manifest, clip.name, manifest.scored_annotator)
        header, rows = answer_table(read_clip_records(run, of_clip, chosen))
        target.mkdir(parents=True, exist_ok=True)
        write_rows(path := target / f"{clip.name}.csv", header, rows)
        yield path


def answer_table(records: ClipRecords) -> tuple[tuple[str, ...], list[tuple[object, ...]]]:
    """The header and the rows of a clip's answers: one row for each named person in each frame.

    A person without an answer has a blank target, and one for whom nothing was hit no probabilities. Where several
    targets share a name, ``instance_id`` says which one has the focus, and the probability of the name is that of all
    of them.
    """
    frames = [record for _, record in sorted(records.by_frame.items())]
    names = dict.fromkeys(target.name for record in frames for target in record.targets)
    with_chances = tuple(names) if records.has_probabilities else ()
    header = ("frame", "subject", "target", "instance_id", *(CHANCE + name for name in with_chances))
    rows: list[tuple[object, ...]] = []
    for record in frames:
        people = dict[str, SubjectRecord]()
        for person in record.subjects:
            if person.name is not None:
                people.setdefault(person.name, person)  # of two tracks with one name the first counts, as in the score
        for name, person in people.items():
            target, instance_id = _focus(record, person, nothing=NOWHERE if records.says_nowhere else NO_HIT)
            chances = dict[str, float]()
            if target not in (None, NO_HIT):
                # zeros where nothing else is there: a blank row would say that no probability is known
                chances = record.sums_by_name(person) or dict.fromkeys(with_chances, 0.0)
            rows.append((record.frame, name, target, instance_id, *(chances.get(other) for other in with_chances)))
    return header, rows


def _focus(record: FrameRecord, person: SubjectRecord, nothing: str) -> tuple[str | None, int | None]:
    """The name of a person's focus, None for no answer; and which instance, if the name is that of several.

    ``nothing`` is the word for no focus: the answer "nowhere", or no answer of a method that cannot say it.
    """
    if person.missing is not None:
        return (NO_HIT if person.missing == NO_HIT else None), None
    if person.focus is None:
        return nothing, None
    name = record.target(person.focus).name
    is_shared = sum(target.name == name for target in record.targets) > 1
    return name, person.focus if is_shared else None
