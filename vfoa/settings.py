"""The base class of every stage's settings: frozen, and an unknown key is an error."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, ClassVar, get_args

from pydantic import BaseModel, ConfigDict, model_validator

CountsWith = Mapping[str, tuple[str, tuple[Any, ...]]]
"""By settings that have an effect only beside some values of another one: the other one, and these values."""


class Settings(BaseModel):
    """Settings of one stage, as in a configuration file (angles in degrees, lengths in metres).

    The docstring below a field is its meaning in the settings reference.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=())

    counts_with: ClassVar[CountsWith] = {}

    @property
    def idle(self) -> dict[str, str]:
        """The settings that have no effect beside the others, and what each counts with: ``smoothing = "both"``."""
        return {
            name: f"{other} = {' or '.join(map(json.dumps, values))}"
            for name, (other, values) in self.counts_with.items()
            if getattr(self, other) not in values
        }

    @model_validator(mode="before")
    @classmethod
    def _no_number_is_true(cls, data: Any) -> Any:
        """Reject ``true`` and ``false`` for numbers, which pydantic reads as 1 and 0."""
        for name, field in cls.model_fields.items():
            value = data.get(name) if isinstance(data, dict) else None
            kinds = {field.annotation, *get_args(field.annotation)}
            if isinstance(value, bool) and bool not in kinds and kinds & {int, float}:
                raise ValueError(f"{name}: expected a number, found {str(value).lower()}")
        return data
