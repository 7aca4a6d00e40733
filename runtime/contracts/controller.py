"""The contract of a control law: pure mathematics from input arrays to output arrays."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final

from srl.runtime.contracts.errors import RecordingError
from srl.runtime.contracts.options import Options
from srl.runtime.contracts.renamed import refuse_old_names
from srl.runtime.contracts.signals import Array, Arrays, Signal
from srl.runtime.contracts.transforms import Transform

OLD_NAMES: Final = {"weigh": "update_gravity", "doubts": "warnings", "figures": "metrics"}
"""What a law's methods were called before."""


class ControllerConfig(Options):
    """A controller's options in the profile. Unknown keys are errors."""


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A number that a client may change while the loop runs. Every row holds it, so a replay has it too."""

    name: str
    default: float
    lower: float
    upper: float
    unit: str
    text: str  # one line for people


class Controller(ABC):
    """One control law. No I/O, no clock, no randomness without a seed from its options.

    Attributes:
        inputs: the signals it reads. The profile's `in:` must bind every one.
        outputs: the signals it writes. An output that `out:` does not name goes to `<controller>.<output>`.
        parameters: live parameters; `self.param["name"][()]`, a 0-d view, holds the value.
        transforms: the transforms that it needs; `self.transform["name"]` (7,) is a pose: x y z (m), w x y z. Fixed
            ones are there from `bind` on; measured ones are computed before each `reset` and `update`. They stay as
            they were while a frame isn't seen, and are NaN before it was.
        lost: a law sets it in `reset` and `update`. True: what it follows hasn't been there for longer than it may
            hold its outputs. The limb then stops as it does for the loss of the device that the law follows.
        contact: a law sets it in `reset` and `update`. True: the limb pushes on something that it shouldn't. It stops.
        why: a law may set it with `lost`: what is probably wrong, and what to do about it; "" for nothing to say.
        simulated: the option whose file the simulation made, so that it says nothing about a person; "" for none.
        measured_by: the bodies, by name, by which the angles of its calibration were measured; empty for none.
            Where real devices feed the law, that gives a warning.
        fed_as: by input, options of the device that feeds it, which must be as they were at its calibration.
    """

    Config: type[ControllerConfig] = ControllerConfig
    summary: str = ""
    c_version: ClassVar[str] = ""  # `module:class` of its C version (runtime/contracts/compiled.py); not inherited
    passes: ClassVar[Mapping[str, str]] = {}  # inputs that it passes on as they are, and the outputs to which
    exports: ClassVar[tuple[str, ...]] = ()  # the forms of files that its own `export` writes: "bvh"

    def __init_subclass__(cls) -> None:
        """Refuses a law with a method's name of before."""
        super().__init_subclass__()
        refuse_old_names(cls, OLD_NAMES)

    def __init__(self, name: str, config: ControllerConfig) -> None:
        self.name = name
        self.config = config
        self.inputs: tuple[Signal, ...] = ()
        self.outputs: tuple[Signal, ...] = ()
        self.parameters: tuple[Parameter, ...] = ()
        self.transforms: tuple[Transform, ...] = ()
        self.transform: Mapping[str, Array] = {}
        self.input: Mapping[str, Array] = {}
        self.output: Mapping[str, Array] = {}
        self.applied: Mapping[str, Array] = {}
        self.param: Mapping[str, Array] = {}
        self.lost = self.contact = False
        self.why = ""
        self.simulated = ""
        self.measured_by: Mapping[str, Mapping[str, Any]] = {}
        self.fed_as: Mapping[str, Mapping[str, object]] = {}

    def bind(
        self,
        input: Mapping[str, Array],
        output: Mapping[str, Array],
        applied: Mapping[str, Array],
        param: Mapping[str, Array],
        transform: Mapping[str, Array] | None = None,
    ) -> None:
        """Takes the arrays, which the runtime allocates once.

        Args:
            input: arrays by input name.
            output: arrays by output name.
            applied: for each output wired to a device's command, the guarded command of the
                cycle before (at activation: the measured position, or home).
            param: 0-d arrays by parameter name.
            transform: (7,) poses by transform name.
        """
        self.input, self.output, self.applied, self.param = map(Arrays, (input, output, applied, param))
        self.transform = Arrays(transform or {})

    @abstractmethod
    def reset(self) -> None:
        """Restarts the control law from the present inputs and `applied`. The output must not jump."""

    @abstractmethod
    def update(self, dt: float) -> None:
        """Computes one step of `dt` seconds: reads inputs, fills outputs. Outputs are finite for finite inputs.

        A pose that nobody has measured yet is NaN.
        """

    def update_gravity(self, dt: float) -> None:
        """Renews, while the limb stops or is stopped, the gravity that a torque guard holds; nothing else.

        A law that gives `<device>.<command>.gravity` overrides it: joints sink, are led by hand, and the wearer moves,
        so the weight that was when the stop began becomes a force of its own. Inputs and transforms are of this cycle,
        `dt` seconds after the one before; what isn't known leaves the output as it is.
        """

    def warnings(self, dt: float) -> Iterable[tuple[str, str]]:
        """Warnings about its options in cycles of `dt` seconds: (option, text) each."""
        return ()

    def narrow(self, dt: float) -> None:
        """Narrows the bounds of its `parameters` to what keeps it stable in cycles of `dt` seconds. Called once,
        before `bind`; a client's value beyond the bounds is refused."""

    def metrics(self) -> dict[str, object]:
        """Returns the controller's own figures for the run's summary."""
        return {}

    def export(self, form: str, inputs: Mapping[str, Array], period: float, path: Path) -> int:
        """Writes what it was given in a recording as a file of another program's.

        Args:
            form: one of `exports`.
            inputs: `(k, *shape)` by input name.
            period: s from one sample to the next.
            path: the file; one that is there is replaced.

        Returns:
            The number of frames written.

        Raises:
            RecordingError: the inputs can't be written so, or the file can't be written; or the law has no `export`.
        """
        law = type(self).__name__
        problem = f"its law {law} was to write {form}, which is in `exports`, and has no method `export` of its own"
        raise RecordingError(
            f"controllers.{self.name}", problem, f"Give {law} one, or take {form} out of its `exports`"
        )
