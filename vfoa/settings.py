"""The base class of every stage's settings: frozen, and an unknown key is an error."""

from __future__ import annotations

from typing import Any, get_args

from pydantic import BaseModel, ConfigDict, model_validator


class Settings(BaseModel):
    """Settings of one stage, as in a configuration file (angles in degrees, lengths in metres).

    The docstring below a field is its meaning in the settings reference.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=())

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
