"""What a profile such as `human-srl` says of a worn arm: its limits, its clearance, its suit; without the runtime."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from srl.control.skeleton.body_clearance import BodyClearance, BodyClearanceConfig
from srl.drivers.servo_bus.declare import PERIOD
from srl.runtime.contracts.per_element import in_order
from srl.runtime.contracts.signals import Array, Command, Kind
from srl.runtime.guard import GUARDS, CommandGuard
from srl.runtime.models.models import ArmsModel
from srl.runtime.profile import profile
from srl.runtime.profile.guard_entry import GuardEntry

PROFILE: Final = "human-srl"
_COMMAND: Final = "arm.position_command"


class Setting:
    """The arm of a profile.

    Attributes:
        arms: its model.
        labels: the joints.
        dt: s, the loop's period.
        frame, delay: s, of the suit: between two frames, and from a pose to its frame.
        lower, upper, velocity, acceleration: (n,) the guard's limits, rad and s (m and s where a joint slides).
        lag: s, the longest of the servos, as `clear:` declares it.
        tracking: (n,) rad or m, by which the joints may be beside their commands, as `clear:` declares it.
    """

    def __init__(
        self, text: str, *, base: Sequence[float] | None = None, lag: float | None = None, tracking: float | None = None
    ) -> None:
        """
        Args:
            text: the profile's.
            base, lag, tracking: in place of the profile's.
        """
        given, _ = profile.tree("profile", text)
        entry = GuardEntry.model_validate(given["guard"][_COMMAND])
        assert entry.clear is not None
        self._entry, self._clear = entry, entry.clear
        self.arms = ArmsModel.model_validate(given["models"]["srl-arms"] | ({} if base is None else {"base": base}))
        self.labels = self.arms.arms.labels
        self.dt = 1.0 / given["rate"]
        suit = given["sim"]["devices"]["suit"]
        self.frame, self.delay = 1.0 / suit["rate"], float(suit["delay"])
        self._command = Command(
            name=_COMMAND, shape=(len(self.labels),), unit="rad", kind=Kind.POSITION, labels=self.labels, period=PERIOD
        )
        self._limits = entry.to_limits(self._command.shape, _COMMAND, self.labels)
        limits = self._limits
        self.lower, self.upper, self.velocity, self.acceleration = (
            np.array(each) for each in (limits.lower, limits.upper, limits.velocity, limits.acceleration)
        )
        self.lag = entry.clear.lag if lag is None else lag
        self._least_lag = entry.clear.least_lag if lag is None else lag  # the trials' servos lag alike
        declared = entry.clear.tracking if tracking is None else tracking
        self.tracking = np.array(in_order(declared, self.labels, size=len(self.labels), ordered=True), np.float64)

    def clearance(self, **changed: Any) -> BodyClearance:
        """The profile's clearance, not bound; `changed`: its options."""
        config = BodyClearanceConfig.model_validate({**self._clear.options, "arms": self.arms, **changed})
        return BodyClearance("arm.clear", config, self._command)

    def guard(self, applied: Array, measured: Array, clearance: BodyClearance | None) -> CommandGuard:
        """The profile's guard, bound and reset to what is measured.

        Args:
            applied, measured: (n,) rad or m.
            clearance: bound; None: nothing keeps the arm clear.
        """
        guard = GUARDS[Kind.POSITION](_COMMAND, self._command, self._limits, self.dt)
        guard.bind(applied, measured)
        if clearance is not None:
            guard.keep_clear(clearance, self.lag, self.tracking, None, self._least_lag, self._clear.period)
        guard.reset(measured)
        return guard
