"""The way of a press on the operator's panel to a run of `srl jog --panel`: one datagram in the run folder.

A datagram is JSON: {"joint": index, "way": -1, 0 or 1, "expires": CLOCK_MONOTONIC ns, "fine": bool}; a fine one moves
at a fifth of the speed. Nobody answers: what came of it
is in the rows. The press lives until `expires`, which the sender counts from when the page was last known to be alive.

A reset goes the same way, as `srl.runtime.ipc.control_socket` writes it to the loop, and is answered as there: the run
of `srl jog` refuses it where nothing knows where the limb is, before the loop is asked.
"""

from __future__ import annotations

import json
import socket
from typing import Final

from srl.runtime.ipc.control_socket import send_request
from srl.runtime.ipc.run_folder import RunFolder

FRESH: Final = 0.04  # s that a press lives, from the server's word that the page answered with it
MOVES: Final = 0.05  # s of motion that it gives: with `FRESH` and a cycle of 10 ms, 0.1 s
SLOWEST: Final = 100.0  # Hz of the loop, below which that is more


def send(run_folder: RunFolder, joint: int, way: int, expires: int, fine: bool = False) -> bool:
    """Sends a press; never waits. Returns whether it left: False where no run takes presses from the panel."""
    content = json.dumps({"joint": joint, "way": way, "expires": expires, "fine": fine}).encode()
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK) as sender:
        try:
            sender.sendto(content, str(run_folder.press_socket))
        except OSError:
            return False
    return True


def reset(run_folder: RunFolder, since: int) -> dict[str, object] | None:
    """Asks the run of `srl jog --panel` for a reset; as `send_request`."""
    return send_request(run_folder, "reset", since=since, through=run_folder.press_socket)
