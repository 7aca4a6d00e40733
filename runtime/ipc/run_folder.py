"""The folder of one running instance: rings, sockets, launch file. It is in memory (tmpfs) if the host has one."""

from __future__ import annotations

import fcntl
import json
import os
import shutil
import stat
import tempfile
import time
from pathlib import Path

from srl.runtime.contracts.errors import HostError

SERVICES = Path("/run/srl")  # folder of the systemd unit's instances
_SOCKET_PATH = 107  # bytes, sun_path without its terminator
_LOOKS = 0.2  # s, longer than looks at the lock take
_PAUSE = 0.001  # s between two tries
ROOM = 64 << 20  # bytes free on a disk for a recording to begin there: some minutes of rows
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
        self.stop_socket = path / "stop.sock"
        self.bus_socket = path / "zenoh.sock"
        self.press_socket = path / "press.sock"  # of a run of `srl jog --panel`
        self.guide_socket = path / "guide.sock"  # of a run of `srl calibrate --panel`
        self.panel_lock = path / "panel.lock"  # of the `srl panel` that has control
        self.stops = path / "stops.slots"
        self.result = path / "result.json"  # the loop's own figures, written at its end
        self.lock: int | None = None  # of a claimed folder; what inherits it keeps the claim

    @property
    def sockets(self) -> tuple[Path, ...]:
        """What is bound in the folder; the kernel bounds the length of each one's path."""
        return self.loop_socket, self.stop_socket, self.bus_socket, self.press_socket, self.guide_socket

    @property
    def evidence(self) -> tuple[Path, ...]:
        """What a black box holds."""
        return self.rows, self.events, self.layout, self.launch

    @classmethod
    def of(cls, name: str) -> RunFolder:
        """The folder of the instance called `name`."""
        return cls(base() / name)

    def claim(self) -> None:
        """Makes the folder and locks it for this process.

        Raises:
            HostError: another process runs this instance, the folder can't be made or used, or another user could
            replace it.
        """
        if max(len(os.fsencode(socket)) for socket in self.sockets) > _SOCKET_PATH:
            raise HostError(
                str(self.path), f"the path is too long for a Unix socket ({_SOCKET_PATH} bytes)",
                "Set SRL_RUNTIME_DIR to a shorter one, best on tmpfs",
            )  # fmt: skip
        try:
            self.path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)  # whatever the umask
            self.path.mkdir(mode=MODE, exist_ok=True)
            check_owners(self.path)
            os.chmod(self.path, MODE)  # an older one may let others in
            self.lock = os.open(self.path / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o640)
            os.close(os.open(self.panel_lock, os.O_RDONLY | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600))
        except OSError as error:
            raise HostError(
                str(self.path),
                f"the instance's folder can't be made: {error.strerror}",
                "Set SRL_RUNTIME_DIR to a folder of yours, best on tmpfs",
            ) from None
        if not self._locked():
            raise HostError(
                f"instance '{self.path.name}'",
                f"it is running already, or something it started hasn't ended yet{self._whose()}",
                f"Run this one with --instance NAME; if that one is yours to end, `srl stop --exit {self.path.name}`",
            )
        os.ftruncate(self.lock, 0)
        os.pwrite(self.lock, json.dumps({"pid": os.getpid(), "uid": os.getuid(), "since": time.time()}).encode(), 0)

    def _whose(self) -> str:
        """Who holds the lock, as it has written there; "" where nothing can be read."""
        assert self.lock is not None
        try:
            holder = json.loads(os.pread(self.lock, 4096, 0))
            since = time.strftime("%Y-%m-%d %H:%M:%S", time.localtime(holder["since"]))
            return f" (process {int(holder['pid'])} of user {int(holder['uid'])}, since {since})"
        except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError):
            return ""

    def _locked(self) -> bool:
        """Locks the open folder. Who looks whether it is claimed holds the lock for an instant: that is no claim."""
        assert self.lock is not None
        end = time.monotonic() + _LOOKS
        while True:
            try:
                fcntl.flock(self.lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                if time.monotonic() > end:
                    return False
                time.sleep(_PAUSE)
            else:
                return True

    def release(self) -> None:
        """Releases the folder. Its files remain, so that they can be examined."""
        if self.lock is not None:
            os.close(self.lock)
            self.lock = None

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


def check_owners(path: Path, own: bool = True) -> None:
    """Checks that nobody but this user (and root) can replace the folder: it and all above it are theirs.

    Args:
        path: the folder.
        own: it is an instance's, so this user's alone, and `claim` closes it; else it is one above it.
    Raises:
        HostError: another user owns one of them, or may write it.
        OSError: one of them can't be looked at.
    """
    remedy = "Set SRL_RUNTIME_DIR to a folder that nobody else can replace, best on tmpfs"
    ours = (os.geteuid(), 0)
    for folder in dict.fromkeys((path.absolute(), *path.absolute().parents, *path.resolve().parents)):
        status = folder.lstat()
        its_own = own and folder == path.absolute()
        if status.st_uid not in (ours[:1] if its_own else ours):
            raise HostError(str(folder), "the folder belongs to another user, who could replace the instance's", remedy)
        # Where the sticky bit is set (/tmp), only its owner can replace what is in it.
        if stat.S_ISDIR(status.st_mode) and status.st_mode & 0o022 and not status.st_mode & stat.S_ISVTX:
            if its_own:
                continue  # `claim` closes it
            raise HostError(str(folder), "others may write this folder, and so replace the instance's", remedy)


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
