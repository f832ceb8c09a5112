"""The other program's names in one import: known, unknown, and renamed ones."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from vfoa.errors import VfoaError, did_you_mean

_SHOWN = 8


@dataclass(slots=True, kw_only=True)
class NameLog:
    """Translates names by ``renamed`` (theirs -> ours) and records those that it could not translate.

    ``SUBJECT:NAME`` renames the targets called ``NAME`` of one subject, whose name is ours or theirs.
    """

    renamed: Mapping[str, str]
    _seen: set[str] = field(default_factory=set)
    _unknown: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)

    def translate(self, name: str, subject: str | None = None) -> str:
        """Our name for theirs, of a target of ``subject`` (ours) if one is given; unchanged without a rename."""
        self._seen.add(name)
        if subject is not None:
            theirs = (each for each, ours in self.renamed.items() if ours == subject)
            for key in (f"{each}:{name}" for each in (subject, *theirs)):
                if key in self.renamed:
                    self._seen.add(key)
                    return self.renamed[key]
        return self.renamed.get(name, name)

    def expect(self, name: str, known: Collection[str], kind: str, where: str, subject: str | None = None) -> str:
        """Our name for theirs. An unknown one is recorded; :meth:`check` reports all of them at once."""
        found = self.translate(name, subject)
        if found not in known:
            self._unknown.setdefault((kind, name), (where, f"{found!r}; {did_you_mean(found, known)}"))
        return found

    def check(self, path: object) -> tuple[str, ...]:
        """Reject unknown names; return a note for each rename of a name that the file does not have.

        Raises
        ------
        VfoaError
            One line that lists the unknown names.
        """
        if len(self._unknown) == 1:
            (((kind, name), (where, said)),) = self._unknown.items()
            raise VfoaError(f"{where}: unknown {kind} {said} (--rename {name!r}=OURS)")
        if self._unknown:
            listed = [f"{kind} {said}" for (kind, _), (_, said) in self._unknown.items()][:_SHOWN]
            more = f" and {len(self._unknown) - _SHOWN} more" if len(self._unknown) > _SHOWN else ""
            told = " | ".join(listed) + more
            raise VfoaError(f"{path}: {len(self._unknown)} unknown names: {told} (--rename THEIRS=OURS for each)")
        return tuple(
            f"{path}: --rename {name}: no such name in it; {did_you_mean(name, self._seen)}"
            for name in self.renamed
            if name not in self._seen
        )
