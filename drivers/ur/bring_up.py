"""From a connection to an arm that obeys: checks identity, power and safety, and starts our program.

Every dialogue is a generator (see steps): `open` runs it to its end, a recovery runs one step per cycle.
"""

from __future__ import annotations

import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final, NamedTuple

from srl.drivers.ur.config import Address, UrConfig
from srl.drivers.ur.dashboard import Dashboard, understood, value, version
from srl.drivers.ur.dial import Dial
from srl.drivers.ur.models import same
from srl.drivers.ur.status import RobotMode
from srl.drivers.ur.steps import Clock, Steps, pause, until
from srl.runtime.contracts.errors import DeviceError

REMOTE: Final = (5, 6, 0)  # from this version on the dashboard tells remote from local control
POWERING: Final = 40.0  # s for the joints to power up, and again for the brakes
UPLOAD: Final = 5.0  # s until an uploaded program runs
PROTECTIVE: Final = 5.0  # s that a protective stop lasts at least
UNLOCK_TRIES: Final = 5


class Identity(NamedTuple):
    """The controller's identity."""

    polyscope: tuple[int, int, int]
    model: str
    serial: str

    def __str__(self) -> str:
        return f"{self.model or 'arm'} {self.serial}, PolyScope {'.'.join(map(str, self.polyscope))}"


class Controller:
    """A controller's dashboard and script ports; each dialogue opens its own connection."""

    def __init__(self, config: UrConfig, where: Address, host: str, place: str, clock: Clock) -> None:
        """`host`: the resolved address of `where.host`."""
        self._config, self._where, self._host, self._place, self._clock = config, where, host, place, clock

    def identify(self) -> Steps[Identity]:
        """Checks identity and control mode, and switches the arm on where allowed. An arm that is only read is just
        identified, as it may be in local control: there a person leads it.

        Raises:
            DeviceError: another series, model or arm, local control, or an arm that may not be switched on.
        """
        with self._dashboard() as dashboard:
            yield from dashboard.greet()
            software = version((yield from dashboard.ask("PolyscopeVersion")))
            if software[0] != 5:
                found = "unknown software" if not software[0] else "PolyScope " + ".".join(map(str, software))
                raise DeviceError(
                    self._place,
                    f"the controller runs {found}; this driver speaks to the e-Series (PolyScope 5), not to a CB3",
                    "Use an e-Series controller",
                )
            model, serial = yield from self._who(dashboard)
            if self._config.interface == "none":
                return Identity(software, model, serial)
            if software >= REMOTE and (yield from dashboard.ask("is in remote control")).lower() == "false":
                raise DeviceError(
                    self._place,
                    "the controller is in local control and obeys nobody else",
                    "Choose 'Remote Control' at the top right of the pendant (enable it under Settings > System)",
                )
            yield from self._switch_on(dashboard)
        return Identity(software, model, serial)

    def unlock(self) -> Steps[None]:
        """Ends a protective stop. Raises DeviceError if the controller refuses."""
        with self._dashboard() as dashboard:
            yield from dashboard.greet()
            yield from dashboard.ask("close safety popup")
            for _ in range(UNLOCK_TRIES):
                answer = yield from dashboard.ask("unlock protective stop")
                if answer.lower().startswith("protective stop releasing"):
                    return
                yield from pause(self._clock, 1.0)
        raise DeviceError(self._place, f"the protective stop doesn't end: {answer}", "Unlock it at the pendant")

    def power(self) -> Steps[None]:
        """Switches the arm on if the profile allows it. Raises DeviceError."""
        with self._dashboard() as dashboard:
            yield from dashboard.greet()
            yield from self._switch_on(dashboard)

    def upload(self, program: str, runs: Callable[[], bool]) -> Steps[None]:
        """Sends a program, which replaces any running one, and waits until `runs`. Raises DeviceError."""
        dial = Dial(self._host, self._where.script, self._place, "script port")
        try:
            if not (yield from until(dial.connected, self._clock, UPLOAD)):
                raise DeviceError(self._place, f"the {dial.door} doesn't answer", "Check the network and the address")
            rest = program.encode("ascii")
            deadline = self._clock() + round(UPLOAD * 1e9)
            while not runs():
                rest = dial.send(rest)
                # Whatever the controller sends here is discarded. Unread data would turn our closing into a reset.
                dial.read()
                if self._clock() > deadline:
                    raise DeviceError(
                        self._place,
                        f"the control program didn't start within {UPLOAD:g} s",
                        "See the pendant's log; choose remote control, end other programs",
                    )
                yield
        finally:
            dial.close()

    @contextmanager
    def _dashboard(self) -> Iterator[Dashboard]:
        dashboard = Dashboard(Dial(self._host, self._where.dashboard, self._place, "dashboard"), self._clock)
        try:
            yield dashboard
        finally:
            dashboard.close()

    def _who(self, dashboard: Dashboard) -> Steps[tuple[str, str]]:
        model = yield from dashboard.ask("get robot model")
        serial = yield from dashboard.ask("get serial number")
        model = model if understood(model) else ""
        serial = serial if understood(serial) else ""
        if model and not same(self._config.model, model):
            raise DeviceError(
                self._place,
                f"the arm is a {model}, the profile says {self._config.model}",
                "Correct 'model', or the address",
            )
        if self._config.serial is not None and serial != self._config.serial:
            raise DeviceError(
                self._place,
                f"the arm's serial number is {serial or 'unknown'}, the profile says {self._config.serial}",
                "Correct 'serial', or the address",
            )
        return model, serial

    def _switch_on(self, dashboard: Dashboard) -> Steps[None]:
        mode = value((yield from dashboard.ask("robotmode")))
        if mode == RobotMode.RUNNING.name:
            return
        if not self._config.power_on:
            raise DeviceError(
                self._place,
                f"the arm isn't ready to move (robot mode {mode})",
                "Switch it on and release its brakes at the pendant, or set 'power_on: true'",
            )
        if mode == RobotMode.POWER_OFF.name:
            yield from dashboard.ask("power on")
        mode = yield from self._await(dashboard, (RobotMode.IDLE.name, RobotMode.RUNNING.name))
        if mode == RobotMode.IDLE.name:
            yield from dashboard.ask("brake release")
            yield from self._await(dashboard, (RobotMode.RUNNING.name,))

    def _await(self, dashboard: Dashboard, modes: tuple[str, ...]) -> Steps[str]:
        deadline = self._clock() + round(POWERING * 1e9)
        while (mode := value((yield from dashboard.ask("robotmode")))) not in modes:
            if self._clock() > deadline:
                raise DeviceError(
                    self._place,
                    f"the arm didn't come to {' or '.join(modes)} within {POWERING:g} s (robot mode {mode})",
                    "See the pendant: an emergency stop, a safety question to confirm",
                )
            yield from pause(self._clock, 0.2)
        return mode


def resolve(host: str, place: str) -> str:
    """Returns the address of a host; the look-up may block. Raises DeviceError."""
    try:
        return str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)[0][4][0])
    except OSError:
        raise DeviceError(place, f"no host is called '{host}'", "Check the name, or use its address") from None
