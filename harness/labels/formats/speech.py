"""Speaking turns in the formats of times: whatever words an annotation has, its subject speaks."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields

from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import NOWHERE, SPEAKS, LabelRange, Labels


class SpeechExchange(Exchange):
    """Reads transcripts: an annotation with words is a turn; an empty one, and what lies between, is silence."""

    def target(self, name: str, subject: str, where: str) -> str:
        """``speaks``, or ``none`` where there are no words."""
        return SPEAKS if name.strip() else NOWHERE

    def labels(self, rows: Iterable[LabelRange], path: object) -> Imported:
        """The turns alone; raises as :meth:`Exchange.labels`."""
        turns = Labels(row for row in list(rows) if row.label.target == SPEAKS)
        self.names.check(path)
        return Imported(labels=turns, notes=())


def of_speech(exchange: Exchange) -> SpeechExchange:
    """The same exchange, of speaking turns."""
    return SpeechExchange(**{each.name: getattr(exchange, each.name) for each in fields(exchange)})
