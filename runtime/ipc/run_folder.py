"""The folder of one running instance: rings, sockets, launch file. It is in memory (tmpfs) if the host has one."""

from __future__ import annotations

import fcntl
import os
import shutil
import tempfile
from pathlib import Path

from runtime.contracts.errors import HostError

SERVICES = Path("/run/srl")  # folder of the systemd unit's instances
_SOCKET_PATH = 107  # bytes, sun_path without its terminator
MODE = 0o750  # only the service's user moves limbs; its group may read and send requests


class RunFolder:
    """Paths of an instance's files. `claim` locks the folder for this process."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.rows = path / "rows.ring"
        self.events = path / "events.ring"
        self.requests = path / "requests.ring"
        self.launch = path / "launch.json"
        self.layout = path / "layout.json"
        self.loop_socket = path / "loop.sock"
        self.bus_socket = path / "zenoh.sock"
        self.stops = path / "stops.slots"
        self.result = path / "result.json"  # the loop's own figures, written at its end
        self._lock: int | None = None

    @classmethod
    def of(cls, name: str) -> RunFolder:
        """The folder of the instance called `name`."""
        return cls(base() / name)

    def claim(self) -> None:
        """Makes the folder and locks it for this process.

        Raises:
            HostError: another process runs this instance, or the folder can't be made or used.
        """
        if len(str(self.loop_socket)) > _SOCKET_PATH:
            raise HostError(
                str(self.path), f"the path is too long for a Unix socket ({_SOCKET_PATH} bytes)",
                "Set SRL_RUNTIME_DIR to a shorter one, best on tmpfs",
            )  # fmt: skip
        try:
            self.path.mkdir(mode=MODE, parents=True, exist_ok=True)
            self._lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
        except OSError as error:
            raise HostError(
                str(self.path),
                f"the instance's folder can't be made: {error.strerror}",
                "Set SRL_RUNTIME_DIR to a folder of yours, best on tmpfs",
            ) from None
        if self.path.stat().st_uid != os.geteuid():
            raise HostError(str(self.path), "the folder belongs to another user", "Set SRL_RUNTIME_DIR to one of yours")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise HostError(
                f"instance '{self.path.name}'",
                "it is running already",
                f"End it first (`srl stop --exit {self.path.name}`), or run this one with --instance NAME",
            ) from None

    def release(self) -> None:
        """Releases the folder. Its files remain, so that they can be examined."""
        if self._lock is not None:
            os.close(self._lock)
            self._lock = None

    def is_claimed(self) -> bool:
        """Whether a process runs this instance now."""
        try:
            descriptor = os.open(self.path / "lock", os.O_RDONLY)
        except OSError:
            return False
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        finally:
            os.close(descriptor)
        return False


def base() -> Path:
    """The parent folder of instances: SRL_RUNTIME_DIR, systemd's RUNTIME_DIRECTORY, or the first tmpfs we may use.

    On a disk, the write-back of dirty pages could stall the loop's stores into the ring.
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


def running() -> list[RunFolder]:
    """All running instances that this user may see: the user's own and the host's services."""
    folders = {
        p.parent for root in (base(), SERVICES) for pattern in ("*/lock", "*/*/lock") for p in root.glob(pattern)
    }
    return [run_folder for run_folder in map(RunFolder, sorted(folders)) if run_folder.is_claimed()]


def free_bytes(path: Path) -> int:
    """Free space of the file system that holds `path`, bytes."""
    return shutil.disk_usage(path).free
