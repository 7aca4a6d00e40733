"""Opening a SoftHand: its identity, its range, its watchdog. Blocks; not for the loop."""

from __future__ import annotations

from typing import Final

from srl.drivers.softhand import protocol
from srl.drivers.softhand.config import USUAL, SoftHandConfig
from srl.drivers.softhand.protocol import Cmd, Frame, Limits, Parser
from srl.drivers.timeout import remaining
from srl.drivers.transport import Transport
from srl.runtime.contracts.errors import DeviceError

TRIES: Final = 3
ANSWER: Final = 0.2  # s, the timeout of the public API itself
QUIET: Final = 0.05  # s without a byte after which a long answer has ended
REMEDY: Final = "Check its 24 V supply, the port, 'id' and 'baudrate', and the RS485 cable"


class Opening:
    """Requests to one hand, answered one by one; see the module's docstring."""

    def __init__(self, link: Transport, parser: Parser, config: SoftHandConfig, place: str) -> None:
        self._link, self._parser, self._config, self._place = link, parser, config, place

    def identify(self) -> str:
        """Returns the serial number; "" if the hand doesn't tell.

        The hand is known by a query's answer: a ping's answer may look like an adapter's echo of the ping.

        Raises:
            DeviceError: no hand with this id answers.
        """
        self._parser.reset()
        self._link.flush_input()
        self._request(Cmd.GET_BOTH, 10, "position and current")
        found = self._exchange(protocol.frame(self._config.id, Cmd.PING), Cmd.PING, 4)
        return str(int.from_bytes(found.data, "big")) if found is not None else ""

    def find_range(self) -> tuple[Limits, str]:
        """Returns the range (ticks of the open and the closed hand), and where it comes from, as a text.

        Raises:
            DeviceError: the hand doesn't control its position, or the profile's range isn't within its own.
        """
        config = self._config
        settings = self._settings()
        if settings is not None and settings.control:
            mode = (
                protocol.CONTROL[settings.control]
                if settings.control < len(protocol.CONTROL)
                else str(settings.control)
            )
            raise DeviceError(
                self._place,
                f"the hand is set to control its {mode}, so a reference is no position",
                "Set its control mode to position with the maker's program",
            )
        own = settings.limits if settings is not None else None
        if config.limits is None:
            limits = own or USUAL
            source = "by the hand itself" if own else "assumed: the hand doesn't tell; give 'limits' to be sure"
        else:
            limits, source = Limits(*config.limits), "by the profile"
            if own is not None and not own.open <= limits.open < limits.closed <= own.closed:
                raise DeviceError(
                    self._place,
                    f"the hand keeps itself within {own.open} and {own.closed} ticks; the profile's limits are "
                    f"{limits.open} and {limits.closed}",
                    "Correct 'limits', or leave them out",
                )
        return limits, f"range {limits.open} to {limits.closed} ticks, {source}"

    def _settings(self) -> protocol.Settings | None:
        """Returns what the hand tells of its parameters; None if it doesn't (older firmware)."""
        link = self._link
        for _ in range(TRIES):
            link.flush_input()
            link.write_all(protocol.frame(self._config.id, Cmd.PARAMETERS, b"\0\0"), ANSWER)
            raw = link.read_wait(ANSWER)
            while len(raw) < 1 << 16 and (more := link.read_wait(QUIET)):
                raw += more
            if (found := protocol.parse_settings(raw, self._config.id)) is not None:
                return found
        return None

    def arm(self, watchdog: bytes) -> tuple[bool, bool]:
        """Arms the watchdog, unless the motor is on: a hand whose host died would release the object it holds.

        Args:
            watchdog: the frame that arms it.
        Returns:
            Whether the motor is on, and whether the watchdog is armed or not wanted. The first command arms the
            watchdog of a hand whose motor is on.
        Raises:
            DeviceError: the hand doesn't accept it.
        """
        on = self._request(Cmd.GET_ACTIVATE, 1, "its motor's state").data[0] != 0
        wanted = bool(self._config.watchdog)
        if on and wanted:
            return on, False
        found = self._exchange(watchdog, Cmd.SET_WATCHDOG, 1)
        if wanted and not (found is not None and any(found.data)):
            what = "refuses" if found is not None else "doesn't acknowledge"
            raise DeviceError(
                self._place,
                f"the hand {what} its watchdog, so it would go on when this program dies",
                "Update its firmware, or accept that with 'watchdog: 0'",
            )
        return on, True

    def _request(self, command: Cmd, size: int, what: str) -> Frame:
        found = self._exchange(protocol.frame(self._config.id, command), command, size)
        if found is None:
            problem = f"no SoftHand with id {self._config.id} answered when asked for {what}"
            raise DeviceError(self._place, problem, REMEDY)
        return found

    def _exchange(self, request: bytes, command: int, least: int) -> Frame | None:
        """Returns the answer with at least `least` bytes of data: an adapter's echo of a query has none."""
        for _ in range(TRIES):
            self._link.write_all(request, ANSWER)
            for left in remaining(ANSWER):
                for found in self._parser.feed(self._link.read_wait(left)):
                    mine = found.id == self._config.id and found.command == command
                    if mine and len(found.data) >= least and not is_echo(found, request):
                        return found
        return None


def is_echo(found: Frame, request: bytes) -> bool:
    """Whether a frame is the host's own request, returned by the adapter."""
    return protocol.frame(found.id, found.command, found.data) == request
