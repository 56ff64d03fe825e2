"""A mapping in YAML that names one of several kinds."""

from __future__ import annotations

from typing import Any

from pydantic import model_validator

from butterfly.yaml_input import StrictModel


class OneOf(StrictModel):
    """Several optional keys of which exactly one must be given."""

    @model_validator(mode="after")
    def _one_of_them(self) -> OneOf:
        if len(self._given()) != 1:
            raise ValueError("exactly one of the keys " + ", ".join(type(self).model_fields))
        return self

    def _given(self) -> list[Any]:
        values = (getattr(self, name) for name in type(self).model_fields)
        return [value for value in values if value is not None]

    @property
    def chosen(self) -> Any:  # noqa: ANN401 - as different as the keys
        """The value of the one key that was given."""
        return self._given()[0]
