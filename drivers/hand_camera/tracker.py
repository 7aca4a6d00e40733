"""Finds a hand in a webcam's pictures with MediaPipe, and sends its landmarks to `srl`. A program of its own.

It needs an environment of its own, as MediaPipe 0.10.21 (the last with models inside) wants an old numpy:

    python3 -m venv ~/hand-camera
    ~/hand-camera/bin/pip install 'mediapipe==0.10.21'
    ~/hand-camera/bin/python tracker.py --camera 0

It imports nothing of srl, so this file can be copied alone. Nothing of the pictures is kept or sent.
"""

from __future__ import annotations

import argparse
import json
import socket
import sys
import time
from typing import Any


def main() -> int:
    """Runs until Ctrl-C, the end of a video, or a camera that is gone. Returns 0, or 2: the camera can't be opened."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--camera", default="0", help="its number, or a video file")
    parser.add_argument("--to", default="127.0.0.1:5006", metavar="HOST:PORT", help="where srl listens")
    parser.add_argument("--mirrored", action="store_true", help="the pictures are mirrored, as in a selfie")
    args = parser.parse_args()
    import cv2  # type: ignore[import-not-found]
    import mediapipe as mp  # type: ignore[import-not-found]

    host, _, port = args.to.rpartition(":")
    camera = cv2.VideoCapture(int(args.camera) if args.camera.isdigit() else args.camera)
    if not camera.isOpened():
        print(f"tracker: the camera {args.camera} can't be opened. Is another program using it?", file=sys.stderr)
        return 2
    camera.set(cv2.CAP_PROP_BUFFERSIZE, 1)  # what waits in a buffer is old
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    hands = mp.solutions.hands.Hands(max_num_hands=1, model_complexity=1, min_detection_confidence=0.6)
    number, looked, seen, since = 0, 0, 0, time.monotonic()
    try:
        while True:
            there, picture = camera.read()
            taken = time.monotonic()
            if not there:
                return 0
            number, looked = number + 1, looked + 1
            found = hands.process(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
            if found.multi_hand_world_landmarks:
                seen += 1
                out.sendto(_message(found, number, taken, args.mirrored), (host or "127.0.0.1", int(port)))
            if taken - since > 2.0:
                rate = looked / (taken - since)
                print(f"\r{rate:.0f} pictures a second, a hand in {seen} of {looked}  ", end="", flush=True)
                looked, seen, since = 0, 0, taken
    except KeyboardInterrupt:
        return 0
    finally:
        camera.release()


def _message(found: Any, number: int, taken: float, mirrored: bool) -> bytes:
    """MediaPipe takes pictures for mirrored ones: in others its right hand is a left one."""
    label = found.multi_handedness[0].classification[0]
    points = found.multi_hand_world_landmarks[0].landmark
    return json.dumps({
        "frame": number, "time": taken, "right": (label.label == "Right") == mirrored, "confidence": label.score,
        "landmarks": [[-p.x if mirrored else p.x, p.y, p.z] for p in points],
    }).encode()  # fmt: skip


if __name__ == "__main__":
    sys.exit(main())
