"""The measures of a run against the ground truth, collected from its records."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from harness.run.grid import base_of
from harness.run.records import FrameRecord
from harness.stages.frame_measures import FrameMeasures, TargetMeasure


class MeasureLog:
    """Collects measures from passing records: see :meth:`watch`. The seeds of a configuration are taken together."""

    def __init__(self) -> None:
        self._by_pair: dict[tuple[str, str], list[FrameMeasures]] = {}
        self._names: dict[tuple[str, int], str] = {}

    def watch(self, records: Iterable[FrameRecord]) -> Iterator[FrameRecord]:
        """Yield the records unchanged and keep their measures, and the run's name of each true object."""
        for record in records:
            if record.measures is not None:
                pair = record.clip, base_of(record.configuration)
                if pair not in self._by_pair:
                    self._by_pair[pair] = []
                self._by_pair[pair].append(record.measures)
                for each in record.measures.targets:
                    if each.instance_id is not None and (record.clip, each.truth_id) not in self._names:
                        self._note_name(record, each)
            yield record

    def _note_name(self, record: FrameRecord, measure: TargetMeasure) -> None:
        found = {target.instance_id: target.name for target in record.targets}
        if measure.instance_id in found:
            self._names[record.clip, measure.truth_id] = found[measure.instance_id]

    def part(self, clip: str, configuration: str) -> tuple[list[FrameMeasures], dict[int, str]]:
        """The measures of a configuration on a clip so far, and the names of true objects, for another log."""
        names = {number: name for (of, number), name in self._names.items() if of == clip}
        return self._by_pair.get((clip, base_of(configuration)), []), names

    def add(self, clip: str, configuration: str, measures: list[FrameMeasures], names: Mapping[int, str]) -> None:
        """Add a part of another log."""
        if measures:
            self._by_pair.setdefault((clip, base_of(configuration)), []).extend(measures)
        for number, name in names.items():
            self._names.setdefault((clip, number), name)

    def pooled(self) -> dict[tuple[str | None, str], list[FrameMeasures]]:
        """The measures of each (clip, configuration) and, of several clips, of all together under the clip None."""
        pooled: dict[tuple[str | None, str], list[FrameMeasures]] = dict(self._by_pair.items())
        if len({clip for clip, _ in self._by_pair}) > 1:
            for (_, configuration), each in self._by_pair.items():
                pooled[None, configuration] = [*pooled.get((None, configuration), []), *each]
        return pooled

    def by_thing(self) -> dict[tuple[str, str, str], list[TargetMeasure]]:
        """The measures of each (clip, true object, configuration), the object by the run's own name for it."""
        found: dict[tuple[str, str, str], list[TargetMeasure]] = {}
        for (clip, configuration), frames in self._by_pair.items():
            by_id: dict[int, list[TargetMeasure]] = {}
            for frame in frames:
                for each in frame.targets:
                    if each.truth_id in by_id:
                        by_id[each.truth_id].append(each)
                    else:
                        by_id[each.truth_id] = [each]
            for number, measures in by_id.items():
                name = self._names.get((clip, number), f"{measures[0].label}#{number}")
                found.setdefault((clip, name, configuration), []).extend(measures)
        return dict(sorted(found.items(), key=lambda item: item[0][:2]))
