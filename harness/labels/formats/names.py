"""The other program's names in one import: known, unknown, and renamed ones."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from vfoa.errors import VfoaError, did_you_mean

_SHOWN = 8


@dataclass(slots=True, kw_only=True)
class NameLog:
    """Translates names by ``renamed`` (theirs -> ours) and records those that it could not translate."""

    renamed: Mapping[str, str]
    _seen: set[str] = field(default_factory=set)
    _unknown: dict[tuple[str, str], tuple[str, str]] = field(default_factory=dict)

    def translate(self, name: str) -> str:
        """Our name for theirs; unchanged if no rename is given."""
        self._seen.add(name)
        return self.renamed.get(name, name)

    def expect(self, name: str, known: Collection[str], kind: str, where: str) -> str:
        """Our name for theirs. An unknown one is recorded; :meth:`check` reports all of them at once."""
        found = self.translate(name)
        if found not in known:
            self._unknown.setdefault((kind, name), (where, f"{found!r}; {did_you_mean(found, known)}"))
        return found

    def check(self, path: object) -> None:
        """Reject unknown names, and renames of names that the file does not have.

        Raises
        ------
        VfoaError
            One line that lists them.
        """
        if len(self._unknown) == 1:
            (((kind, name), (where, said)),) = self._unknown.items()
            raise VfoaError(f"{where}: unknown {kind} {said} (--rename {name!r}=OURS)")
        if self._unknown:
            listed = [f"{kind} {said}" for (kind, _), (_, said) in self._unknown.items()][:_SHOWN]
            more = f" and {len(self._unknown) - _SHOWN} more" if len(self._unknown) > _SHOWN else ""
            told = " | ".join(listed) + more
            raise VfoaError(f"{path}: {len(self._unknown)} unknown names: {told} (--rename THEIRS=OURS for each)")
        if unused := [name for name in self.renamed if name not in self._seen]:
            raise VfoaError(f"{path}: --rename {unused[0]}: no such name in it; {did_you_mean(unused[0], self._seen)}")
