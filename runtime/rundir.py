"""The folder of one running instance: ring, mailbox, sockets. In memory (tmpfs) where the host has it."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from pathlib import Path

from runtime.errors import HostError

MODE = 0o750  # the service's user moves limbs; its group may look and ask


class RunDir:
    """Paths of an instance's files; `claim` makes it this process's."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows = path / "rows.ring"
        self.notes = path / "notes.ring"
        self.mail = path / "mail.ring"
        self.order = path / "order.json"
        self.layout = path / "layout.json"
        self.loop_socket = path / "loop.sock"
        self.bus_socket = path / "zenoh.sock"
        self.stops = path / "stops.slots"
        self.running = path / "running"  # there while a run is under way: left behind by a crash
        self._lock: int | None = None

    @classmethod
    def of(cls, name: str) -> RunDir:
        """The folder of the instance called `name`."""
        return cls(base() / name)

    def claim(self) -> bool:
        """Makes the folder and locks it for this process.

        Returns:
            True if an earlier run of this instance ended in a crash.
        Raises:
            HostError: another process runs this instance.
        """
        try:
            self.path.mkdir(mode=MODE, parents=True, exist_ok=True)
            self._lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
        except OSError as error:
            raise HostError(
                str(self.path),
                f"the instance's folder can't be made: {error.strerror}",
                "Set SRL_RUNTIME_DIR to a folder of yours, best on tmpfs",
            ) from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise HostError(
                f"instance '{self.path.name}'",
                "it is running already",
                f"End it first (`srl stop --exit {self.path.name}`), or run this one with --instance NAME",
            ) from None
        crashed = self.running.exists()
        self.running.touch()
        return crashed

    def release(self, clean: bool) -> None:
        """Lets go of the folder; `clean` removes what a crash would leave behind."""
        if clean:
            self.running.unlink(missing_ok=True)
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None


def base() -> Path:
    """Where instances live: SRL_RUNTIME_DIR, systemd's RUNTIME_DIRECTORY, or the first tmpfs that is ours.

    On a disk, writing dirty pages back could stall the loop's stores into the ring.
    """
    for variable in ("SRL_RUNTIME_DIR", "RUNTIME_DIRECTORY"):
        if value := os.environ.get(variable):
            return Path(value.split(":")[0])
    if value := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(value) / "srl"
    if os.geteuid() == 0 and _is_tmpfs("/run"):
        return Path("/run/srl")
    root = "/dev/shm" if os.access("/dev/shm", os.W_OK) else tempfile.gettempdir()
    return Path(root) / f"srl-{os.getuid()}"


def _is_tmpfs(mount: str) -> bool:
    return any(line.split()[1:3] == [mount, "tmpfs"] for line in Path("/proc/mounts").read_text().splitlines())


def running() -> list[RunDir]:
    """Every instance that runs now, by the lock its supervisor holds."""
    found = []
    for path in sorted(base().glob("*/lock")):
        descriptor = os.open(path, os.O_RDONLY)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            found.append(RunDir(path.parent))
        finally:
            os.close(descriptor)
    return found


def free_bytes(path: Path) -> int:
    """Free space of the file system that holds `path`, bytes."""
    return shutil.disk_usage(path).free
