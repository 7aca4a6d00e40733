"""The callers' side of the loop's Unix sockets: `srl stop` and the supervisor reach the loop without the bus.

Datagrams are JSON: {"ask": "reset", "expires": CLOCK_MONOTONIC ns}; {"ask": "exit"} and {"ask": "fault"} may have a
"cause". {"ask": "note", "text": ...} of a process of the run becomes an event. The loop answers to the sender's own
address. The kernel tells it the sender's process and user.

That address is an abstract one, and so of a network namespace, though the run folder isn't. No answer reaches a sender
in another one (a container), nor one that got no address. It finds the answer in the loop's rows.

What stops goes to a socket of its own, where every datagram stops: so no flood of other requests can leave a stop
without room in the kernel's queue, and a flood of stops is one. `srl.runtime.loop.request_queue` is the loop's side.
"""

from __future__ import annotations

import contextlib
import json
import socket
import time
from pathlib import Path
from typing import Any

from srl.runtime.ipc.run_folder import RunFolder

RETRY = 0.02  # s between attempts to reach a loop that is about to begin
LOOK = 0.1  # s without an answer after which the loop's rows are looked at
NOTE = 400  # bytes of a note's text
NOTES = 5  # that the loop takes at once, and then as many a second
DATAGRAM = 512  # bytes; a longer one is no request
LIFETIME = 2_000_000_000  # ns that a request lives; a stop has no end
STOPS = ("stop", "exit", "fault")


def send_request(
    run_folder: RunFolder, what: str, cause: str | None = None, timeout: float = 2.0, since: int | None = None,
    through: Path | None = None,
) -> dict[str, object] | None:  # fmt: skip
    """Sends a request to a running loop. A stop waits for one that is about to begin, and until then is tried again.

    Args:
        run_folder: the instance's folder.
        what: "start", "stop", "reset", "exit" or "fault".
        cause: for "exit" and "fault" of the supervisor: the name of a `Cause`.
        timeout: s.
        since: CLOCK_MONOTONIC ns of what the sender has seen: a stop after that refuses the start or reset. Default:
            now.
        through: the socket of somebody who looks at a start or reset before the loop does.
    Returns:
        The loop's answer, as it sends it or as its rows tell it; None if there was none in time. Then it may still have
        been carried out.
    """
    message: dict[str, Any] = {"ask": what} | ({"cause": cause} if cause else {})
    if what not in STOPS:
        message["expires"] = (time.monotonic_ns() if since is None else since) + LIFETIME
    deadline = time.monotonic() + timeout
    try:
        sender = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
    except OSError:  # no descriptor is left
        return None
    with sender:
        sender.settimeout(timeout)
        try:
            # Connected before it has an address: the kernel then refuses answers from anybody but the loop. Any
            # local user could send one to an abstract address and claim that the limb has stopped.
            _connect(sender, through or _end(run_folder, what), what, deadline)
            with contextlib.suppress(OSError):  # any local user can hold all addresses; then no answer comes
                sender.bind("")  # an abstract address of its own, for the answer
            sent = time.monotonic_ns()
            sender.send(json.dumps(message).encode())
            return _answer(sender, run_folder, what, sent, timeout)
        except (OSError, ValueError):
            return None


def _answer(
    sender: socket.socket, run_folder: RunFolder, what: str, sent: int, timeout: float
) -> dict[str, object] | None:
    """Raises OSError, ValueError: there is none in time, or not from the loop."""
    deadline = time.monotonic() + timeout
    while True:
        left = deadline - time.monotonic()
        sender.settimeout(min(max(left, 0.0), LOOK))
        try:
            answer: dict[str, object] = json.loads(sender.recv(2048))
            return answer
        except (BlockingIOError, TimeoutError):
            if timeout == 0.0:
                raise
        from srl.runtime.ipc import answers  # it brings NumPy, and a stop is sent before that is loaded
        from srl.runtime.ipc.requests import RequestKind

        found = answers.in_rows(run_folder, RequestKind[what.upper()], sent)
        # A refusal may be that of another's request of this kind: the loop has until the end to grant this one.
        if found is not None and (found["ok"] or left <= LOOK):
            return found
        if left <= LOOK:
            return None


def send_note(run_folder: RunFolder, text: str) -> bool:
    """Has the loop write an event: it is on the bus, and in the recording. A long text is cut.

    Returns:
        Whether there is a loop, with room for it.
    """
    text = text.encode(errors="replace")[:NOTE].decode(errors="ignore")
    while len(data := json.dumps({"ask": "note", "text": text}, ensure_ascii=False).encode()) > DATAGRAM:
        text = text[:-16]  # JSON writes some letters with more, a name's quotes for one
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK) as sender:
        try:
            sender.connect(str(run_folder.loop_socket))
            sender.send(data)
        except OSError:
            return False
        return True


def _end(run_folder: RunFolder, what: str) -> Path:
    return run_folder.stop_socket if what in STOPS else run_folder.loop_socket


def _connect(sender: socket.socket, end: Path, what: str, deadline: float) -> None:
    """Raises OSError: there is no loop; for a stop, not until `deadline` (CLOCK_MONOTONIC s) either."""
    while True:
        try:
            sender.connect(str(end))
            return
        except (FileNotFoundError, ConnectionRefusedError):
            if what not in STOPS or time.monotonic() >= deadline:
                raise
        time.sleep(RETRY)
