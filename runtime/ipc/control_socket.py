"""The callers' side of the loop's Unix socket: `srl stop` and the supervisor reach the loop without the bus.

Datagrams are JSON: {"ask": "stop"}, with a "cause" for "exit" and "fault". The loop answers to the sender's
own address. `runtime.loop.request_queue` is the loop's side.
"""

from __future__ import annotations

import json
import socket

from runtime.ipc.run_folder import RunFolder


def send_request(
    run_folder: RunFolder, what: str, cause: str | None = None, timeout: float = 2.0
) -> dict[str, object] | None:
    """Sends a request to a running loop.

    Args:
        run_folder: the instance's folder.
        what: "start", "stop", "reset", "exit" or "fault".
        cause: for "exit" and "fault": the name of a `Cause`.
        timeout: s.
    Returns:
        The loop's answer; None if there was none in time.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
        sender.settimeout(timeout)
        message = {"ask": what} | ({"cause": cause} if cause else {})
        try:
            # Connected before it has an address: the kernel then refuses answers from anybody but the loop. Any
            # local user could send one to an abstract address and claim that the limb has stopped.
            sender.connect(str(run_folder.loop_socket))
            sender.bind("")  # an abstract address of its own, for the answer
            sender.send(json.dumps(message).encode())
            answer: dict[str, object] = json.loads(sender.recv(2048))
        except (OSError, ValueError):
            return None
        return answer
