"""Speaking turns in the formats of times: an annotation with words is a turn of its subject."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields

from harness.labels.formats.exchange import Exchange, Imported
from harness.labels.labels import NOWHERE, SPEAKS, LabelRange, Labels


class SpeechExchange(Exchange):
    """Reads transcripts: an annotation with words is a turn; an empty one, and the time between, is silence."""

    def target(self, name: str, subject: str, where: str) -> str:
        """``speaks``, or ``none`` if there are no words."""
        return SPEAKS if name.strip() else NOWHERE

    def labels(self, rows: Iterable[LabelRange], path: object) -> Imported:
        """Return only the turns; raises as :meth:`Exchange.labels`."""
        turns = Labels(row for row in list(rows) if row.label.target == SPEAKS)
        self.names.check(path)
        return Imported(labels=turns, notes=())


def of_speech(exchange: Exchange) -> SpeechExchange:
    """Return the same exchange, for speaking turns."""
    return SpeechExchange(**{each.name: getattr(exchange, each.name) for each in fields(exchange)})
