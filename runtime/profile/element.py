"""One element of a signal, named in a profile: an e-stop, a button that resets."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Self

from pydantic import ConfigDict, Field, ModelWrapValidatorHandler, PrivateAttr, model_validator

from srl.runtime.contracts.entry import BaseModel
from srl.runtime.contracts.errors import WiringError, nearest
from srl.runtime.contracts.signals import Signal


class Element(BaseModel):
    """A signal and the name of one of its elements."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    signal: str
    element: str | None = Field(
        None, coerce_numbers_to_str=True, description="its name; not needed where the signal has only one"
    )
    _index: object = PrivateAttr(None)

    @model_validator(mode="wrap")
    @classmethod
    def _once_an_index(cls, given: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        """Keeps the old key `index`, so that `find` can refuse it with the names that there are."""
        if not isinstance(given, dict) or "index" not in given:
            return handler(given)
        made = handler({key: value for key, value in given.items() if key != "index"})
        made._index = given["index"]
        return made

    def find(self, signals: Mapping[str, Signal], place: str) -> str:
        """Returns the element's name. Raises WiringError: no such signal or element, or it isn't said which."""
        signal = signals.get(self.signal)
        if signal is None:
            raise WiringError(place, f"no signal is called '{self.signal}'", nearest(self.signal, signals))
        names = signal.names if len(signal.shape) == 1 else ()
        if not names:
            problem = f"'{self.signal}' has no elements that are one number each and have names"
            raise WiringError(place, problem, "Name a signal of buttons or joints")
        listed = ", ".join(names)
        if self._index is not None:
            problem = f"`index: {self._index}` is a place, and the elements of '{self.signal}' have names"
            raise WiringError(place, problem, f"Write `element:` with one of: {listed}")
        if self.element is None and len(names) > 1:
            problem = f"'{self.signal}' has {len(names)} elements"
            raise WiringError(place, problem, f"Say which with `element:`: {listed}")
        if self.element is not None and self.element not in names:
            problem = f"'{self.signal}' has no element '{self.element}'"
            raise WiringError(place, problem, nearest(self.element, names))
        return self.element or names[0]
