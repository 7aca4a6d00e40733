"""The contract of a control law: pure mathematics from input arrays to output arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass

from pydantic import BaseModel, ConfigDict

from runtime.contracts.signals import Array, Signal


class ControllerConfig(BaseModel):
    """A controller's options in the profile. Unknown keys are errors."""

    model_config = ConfigDict(extra="forbid", frozen=True)


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number a client may change while the loop runs; kept in every row, so a replay has it too."""

    name: str
    default: float
    lower: float
    upper: float
    unit: str
    text: str  # one line for people


class Controller(ABC):
    """One control law. No I/O, no clock, no randomness without a seed from its options.

    Attributes:
        inputs: what it reads; every one must be bound by the profile's `in:`.
        outputs: what it writes; one that `out:` does not name goes to `<controller>.<output>`.
        parameters: live parameters; `self.param["name"][()]`, a 0-d view, holds the value.
    """

    Config: type[ControllerConfig] = ControllerConfig
    summary: str = ""

    def __init__(self, name: str, config: ControllerConfig) -> None:
        self.name = name
        self.config = config
        self.inputs: tuple[Signal, ...] = ()
        self.outputs: tuple[Signal, ...] = ()
        self.parameters: tuple[Parameter, ...] = ()
        self.input: Mapping[str, Array] = {}
        self.output: Mapping[str, Array] = {}
        self.applied: Mapping[str, Array] = {}
        self.param: Mapping[str, Array] = {}

    def bind(
        self,
        input: Mapping[str, Array],
        output: Mapping[str, Array],
        applied: Mapping[str, Array],
        param: Mapping[str, Array],
    ) -> None:
        """Takes the arrays, made once by the runtime.

        Args:
            input: by input name.
            output: by output name.
            applied: for each output wired to a device's command, what the guard let through in the
                cycle before (at activation: the measured position, or home).
            param: 0-d arrays by parameter name.
        """
        self.input, self.output, self.applied, self.param = input, output, applied, param

    @abstractmethod
    def reset(self) -> None:
        """Starts afresh from the present inputs and `applied`, without a jump of the output."""

    @abstractmethod
    def update(self, dt: float) -> None:
        """One step of dt seconds: reads inputs, fills outputs. Outputs are finite for finite inputs."""

    def figures(self) -> dict[str, object]:
        """Figures of its own for the run's summary."""
        return {}
