"""What every control law must do: one rule a function. Each raises AssertionError, which says what is wrong.

Each takes a bound law, values for its inputs, and where the commanded outputs are at the reset.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from srl.runtime.contracts.controller import Controller
from srl.runtime.contracts.signals import Array

Values = Mapping[str, Array]
STEPS = 100
PERIOD = 0.01  # s
UNKNOWN = 20  # cycles for which an input is NaN
JUMP = 1e-6  # the largest difference from where the limb is, in the output's unit


def names_its_elements(law: Controller) -> None:
    """Wiring goes by names, so each element of each port has one."""
    for signal in (*law.inputs, *law.outputs):
        assert not (fault := signal.naming_fault()), f"{_name(law)}.{signal.name}: {fault}"


def starts_where_the_limb_is(law: Controller, inputs: Values, start: Values) -> None:
    """The first output after a reset is what was applied: nothing jumps."""
    _begin(law, inputs, start)
    law.update(1e-9)
    for key, value in start.items():
        jump = float(np.max(np.abs(law.output[key] - value), initial=0.0))
        assert jump < JUMP, f"{_name(law)}.{key} jumps by {jump:g} at its reset"


def stays_finite(law: Controller, inputs: Values, start: Values) -> None:
    """Finite inputs give finite outputs, in every cycle."""
    for made in _run(law, inputs, start):
        for key, values in made.items():
            assert np.isfinite(values).all(), f"{_name(law)}.{key} isn't finite for finite inputs"


def recovers_from_nan(law: Controller, inputs: Values, start: Values) -> None:
    """An input that is NaN for a while leaves nothing behind: once it is finite again, so are the outputs."""
    for unknown in inputs:
        _begin(law, inputs, start)
        for cycle in range(3 * STEPS):
            law.input[unknown][...] = np.nan if STEPS <= cycle < STEPS + UNKNOWN else inputs[unknown]
            _step(law)
        for key, output in law.output.items():
            assert np.isfinite(output).all(), (
                f"{_name(law)}.{key} stays NaN after its input '{unknown}' was NaN for {UNKNOWN} cycles: a NaN is kept"
            )


def repeats_exactly(law: Controller, inputs: Values, start: Values, other: Controller | None = None) -> None:
    """The same inputs give the same bits after a reset, and in `other`, which is as new: so a replay repeats a run."""
    one = _bits(law, inputs, start)
    assert one == _bits(law, inputs, start), (
        f"{_name(law)} isn't pure: the same inputs gave other outputs after a reset"
    )
    if other is not None:
        again = _bits(other, inputs, start)
        assert one == again, f"{_name(law)} isn't pure: a second one, with the same inputs, gave other outputs"


def writes_only_its_outputs(law: Controller, inputs: Values, start: Values) -> None:
    """Inputs, what was applied, parameters and transforms are the row's: other parts read them, too."""
    bound = law.output
    _begin(law, inputs, start)
    given = {"input": law.input, "applied": law.applied, "param": law.param, "transform": law.transform}
    before = {(what, key): array.tobytes() for what, arrays in given.items() for key, array in arrays.items()}
    law.update(PERIOD)
    for what, arrays in (given | {"output": bound}).items():
        assert getattr(law, what) is arrays, f"{_name(law)} has put something else in the place of self.{what}"
    for (what, key), content in before.items():
        assert given[what][key].tobytes() == content, (
            f"{_name(law)} has changed its {what} '{key}', which it may only read"
        )


def check_controller(controller: Controller, inputs: Values, start: Values) -> None:
    """Puts all rules to a law; `ControllerConformance` has them as single tests.

    Args:
        controller: a bound controller, see `bound`.
        inputs: values for its inputs, by name.
        start: values of the commanded outputs at the reset, by output name.
    Raises:
        AssertionError: its text says what is wrong.
    """
    names_its_elements(controller)
    for rule in (starts_where_the_limb_is, stays_finite, recovers_from_nan, repeats_exactly, writes_only_its_outputs):
        rule(controller, inputs, start)


def _begin(law: Controller, inputs: Values, start: Values) -> None:
    for key, value in inputs.items():
        law.input[key][...] = value
    for key, value in start.items():
        law.applied[key][...] = value
    law.reset()


def _run(law: Controller, inputs: Values, start: Values) -> list[dict[str, Array]]:
    """The outputs of each cycle. What was commanded is what is applied in the next one."""
    _begin(law, inputs, start)
    law.update(1e-9)
    made = []
    for _ in range(STEPS):
        _step(law)
        made.append({key: np.array(output) for key, output in law.output.items()})
    return made


def _step(law: Controller) -> None:
    """One cycle. As from a guard, what isn't finite isn't applied."""
    law.update(PERIOD)
    for key, output in law.output.items():
        if key in law.applied and np.isfinite(output).all():
            law.applied[key][...] = output


def _bits(law: Controller, inputs: Values, start: Values) -> list[bytes]:
    return [values.tobytes() for made in _run(law, inputs, start) for values in made.values()]


def _name(law: Controller) -> str:
    return type(law).__name__
