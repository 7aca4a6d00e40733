"""Reads the sensor's identity and scale, over HTTP or its TCP port. Blocks: for `open` only."""

from __future__ import annotations

import contextlib
import http.client
import socket
import time

from srl.drivers.ati_netft import settings
from srl.drivers.ati_netft.config import Address
from srl.drivers.ati_netft.settings import Settings
from srl.runtime.contracts.errors import DeviceError

ANSWER = 2.0  # s
_CHECK = "Check the address and the power; open the sensor's page in a browser"


def identify(where: Address, place: str) -> Settings:
    """Returns the settings from the sensor's page, or from its TCP port if no page answers.

    Raises:
        DeviceError: neither answers, or the answer isn't from a Net F/T.
    """
    try:
        page = get(where, settings.PAGE)
    except OSError as no_page:
        try:
            answer = _ask(where)
        except (OSError, UnicodeError) as no_answer:
            raise DeviceError(
                place,
                f"{where.host} gives no settings: port {where.http} {_why(no_page)}, "
                f"port {where.tcp} {_why(no_answer)}",
                f"{_CHECK}; or give 'counts' in the profile",
            ) from None
        try:
            return settings.parse_calibration(answer)
        except ValueError as error:
            raise DeviceError(place, f"{where.host} is no ATI Net F/T: {error}", _CHECK) from None
    try:
        return settings.parse_page(page)
    except ValueError as error:
        raise DeviceError(place, f"{where.host} is no ATI Net F/T: {error}", _CHECK) from None


def set_rate(where: Address, rate: int, place: str) -> None:
    """Sets the rate of the records. Raises DeviceError."""
    try:
        get(where, f"/comm.cgi?comrdte=1&comrdtrate={rate}")
    except OSError as error:
        raise DeviceError(
            place, f"{where.host} takes no record rate: port {where.http} {_why(error)}", "Leave 'rate' out"
        ) from None


def get(where: Address, path: str) -> bytes:
    """Returns one page, at most 64 KiB. Raises OSError, also for a status of 400 and above."""
    deadline = time.monotonic() + ANSWER
    connection = http.client.HTTPConnection(where.host, where.http, timeout=ANSWER)
    try:
        connection.request("GET", path)
        answer = connection.getresponse()
        if answer.status >= 400:
            raise OSError(f"says {answer.status} {answer.reason}")
        body = b""
        while len(body) <= settings.LONGEST and (chunk := answer.read1(4096)):
            body += chunk
            if time.monotonic() > deadline:
                raise TimeoutError
        return body
    except (http.client.HTTPException, ValueError) as error:
        raise OSError(f"speaks no HTTP ({type(error).__name__})") from None
    finally:
        connection.close()


def _ask(where: Address) -> bytes:
    """Returns the answer to READ_CALIBRATION."""
    deadline = time.monotonic() + ANSWER
    with socket.create_connection((where.host, where.tcp), timeout=ANSWER) as link:
        link.sendall(settings.READ_CALIBRATION)
        heard = b""
        with contextlib.suppress(TimeoutError):
            while len(heard) < settings.CALIBRATION_SIZE and time.monotonic() < deadline:
                chunk = link.recv(settings.CALIBRATION_SIZE - len(heard))
                if not chunk:
                    break
                heard += chunk
        return heard


def _why(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return "is silent"
    if isinstance(error, ConnectionRefusedError):
        return "refuses"
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
