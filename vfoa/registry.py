"""Named plug-ins, imported when they are used: a line in a registry here, or an entry point of another distribution."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, EntryPoints, entry_points
from typing import Any

from vfoa.errors import VfoaError, did_you_mean

AUTO = "auto"
"""The name that a registry with a choice of its own replaces by what this machine has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Registry:
    """The names of one kind of plug-in, and the modules that hold them.

    Parameters
    ----------
    kind
        The word for error messages and configuration, such as ``"stereo"``.
    builtin
        Name to ``"module:Class"``. :meth:`load` imports the module.
    group
        The entry-point group in which other distributions add names, such as ``"vfoa.stereo"``.
    choose
        Gives the name that ``"auto"`` stands for on this machine; its docstring says how. None: there is no ``"auto"``.
    """

    kind: str
    builtin: Mapping[str, str]
    group: str
    choose: Callable[[], str] | None = None

    def resolve(self, name: str) -> str:
        """Return the name to :meth:`load`: the name itself, or what ``"auto"`` stands for on this machine."""
        return self.choose() if self.choose and name == AUTO else name

    def names(self) -> list[str]:
        """Every name that :meth:`load` takes, sorted."""
        return sorted({*self.builtin, *self._others()})

    def builtin_first(self) -> list[str]:
        """Every name: those of this project in their order, then those of other distributions, sorted."""
        return [*self.builtin, *sorted(self._others().keys() - self.builtin.keys())]

    def __contains__(self, name: object) -> bool:
        """Whether :meth:`load` takes this name. Other distributions are asked last, because listing them is slow."""
        return name in self.builtin or name in self._others()

    def choices_with(self, dotted: str, setting: str) -> list[str]:
        """The built-in choices of a key, such as ``attention.method = "cones"``, that have a setting."""
        return [f'{dotted} = "{name}"' for name in self.builtin if setting in self.load(name).Settings.model_fields]

    def load(self, name: str) -> Any:
        """Import and return the class called ``name``.

        Raises
        ------
        VfoaError
            If there is no such name; the message suggests the nearest one.
        """
        if name in self.builtin:
            module, _, attribute = self.builtin[name].partition(":")
            return getattr(import_module(module), attribute)
        others = self._others()
        if name not in others:
            raise VfoaError(f"{self.kind}: no {name!r}; {did_you_mean(name, self.names())}")
        return others[name].load()

    def _others(self) -> dict[str, EntryPoint]:
        return {point.name: point for point in _entry_points(self.group, tuple(sys.path))}


@cache
def _entry_points(group: str, path: tuple[str, ...]) -> EntryPoints:
    """The entry points of a group on this import path, read once: they are in a file of each distribution."""
    return entry_points(group=group)
