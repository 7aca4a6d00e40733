"""A serial port: 8N1, no flow control, exclusively locked."""

from __future__ import annotations

import errno
import glob
import os
import termios

import serial

from srl.drivers.transport.base import Transport, ioctl_int
from srl.runtime.contracts.errors import DeviceError


class SerialPort(Transport):
    """A tty that pyserial opens and configures, and that is then used through its descriptor."""

    def __init__(self, url: str, place: str, port: serial.Serial) -> None:
        super().__init__(url, place)
        self._port = port
        self._fd = port.fileno()
        os.set_blocking(self._fd, False)
        # With pyserial's VMIN = 0 both "nothing there" and "hung up" read as b""; with VMIN = 1 the first is EAGAIN.
        mode = termios.tcgetattr(self._fd)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._fd, termios.TCSANOW, mode)

    def fileno(self) -> int:
        return self._fd

    def _take(self, most: int) -> bytes:
        return os.read(self._fd, most)

    def _give(self, data: bytes) -> int:
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0

    def _queued(self) -> int:
        return ioctl_int(self._fd, termios.TIOCOUTQ)

    def _shut(self) -> None:
        try:
            if self._queued():
                termios.tcflush(self._fd, termios.TCOFLUSH)  # otherwise close() waits 30 s for a stalled port
        finally:
            self._fd = -1
            self._port.close()


def open_serial(path: str, place: str, baudrate: int) -> Transport:
    """Opens a tty or a pty. Raises DeviceError."""
    try:
        port = serial.Serial(path, baudrate, exclusive=True)
    except (OSError, ValueError, termios.error) as error:  # SerialException is an OSError
        number = getattr(error, "errno", None)
        if number == errno.ENOENT:
            found = sorted(glob.glob("/dev/ttyUSB*") + glob.glob("/dev/ttyACM*"))
            remedy = f"Ports that exist: {', '.join(found)}" if found else "No /dev/ttyUSB* or /dev/ttyACM* exists"
            raise DeviceError(place, f"there is no port {path}", f"{remedy}; plug the device in") from None
        if number in (errno.EACCES, errno.EPERM):
            raise DeviceError(
                place,
                f"no permission to open {path}",
                "Add the user to the port's group, 'sudo usermod -aG dialout $USER', and log in again",
            ) from None
        if number in (errno.EAGAIN, errno.EBUSY):
            raise DeviceError(
                place, f"{path} is in use by another program", f"'fuser -v {path}' shows which; end it"
            ) from None
        raise DeviceError(
            place, f"{path} can't be opened as a serial port: {error}", "Check the path and the baud rate"
        ) from None
    return SerialPort(path, place, port)
