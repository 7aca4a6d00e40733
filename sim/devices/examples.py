"""One small configuration of every device, with a world in which its fake and twin can work.

For measurements, and for tests that check every device in the same way.
"""

from __future__ import annotations

from typing import Any

THING = {"thing": {"part": "box", "size": [0.1, 0.1, 0.1]}}
CELL = {"world": "cell", "parts": THING}


def _cell(**parts: dict[str, Any]) -> dict[str, Any]:
    return {"world": "cell", "parts": parts}


HAND = _cell(hand={"part": "human-hand"})
_OFTEN = [[0.02 * k, 0.02 * k + 0.01] for k in range(1, 3000)]  # s, a button pressed 50 times a second

CUBEMARS = {
    "id": 1, "model": "AK80-9", "parked": 0.0, "lower": -1.5, "upper": 1.5, "velocity": 5.0, "acceleration": 50.0,
    "current": 10.0, "torque_constant": 0.819,
}  # fmt: skip
ODRIVE = {"node": 1, "gear": 8, "parked": 0.0, "velocity": 5.0, "current": 20.0, "torque_constant": 0.083}

# driver: (config without port, fake's options, world, a port on which nobody answers)
DEVICES: dict[str, tuple[dict[str, Any], dict[str, Any], dict[str, Any], str]] = {
    "ati-netft": ({}, {}, _cell(ft_sensor={"part": "ft-sensor"}), "udp://127.0.0.1:9"),
    "base": ({}, {}, _cell(base={"part": "summit-xl"}), "tcp://127.0.0.1:9"),
    "bno085": ({}, {}, _cell(imu={"part": "imu"}), "tcp://127.0.0.1:9"),
    "can-ft": ({}, {}, _cell(ft_sensor={"part": "ft-sensor"}), "can://udp_multicast/239.74.163.99?port=43199"),
    "cubemars-servo": (
        {"timeout": 0.5, "axes": {"one": CUBEMARS}},
        {},
        _cell(chain={"part": "actuator-chain", "axes": {"one": {"model": "AK80-9"}}}),
        "can://udp_multicast/239.74.163.99?port=43198",
    ),
    "cyberglove": ({}, {}, HAND, "tcp://127.0.0.1:9"),
    "dynamixel": (
        {"motors": {"one": {"id": 1, "model": "MX-64"}}},
        {},
        _cell(chain={"part": "dynamixel-chain", "axes": {"one": {"model": "MX-64"}}}),
        "tcp://127.0.0.1:9",
    ),
    "feetech": (
        {"motors": {"one": {"id": 1, "model": "STS3215"}}},
        {},
        _cell(chain={"part": "feetech-chain", "axes": {"one": {"model": "STS3215"}}}),
        "tcp://127.0.0.1:9",
    ),
    "firmata": (
        {"buttons": {"go": {"pin": 2, "debounce": 0.001}}},
        {"presses": {"go": _OFTEN}},
        CELL,
        "tcp://127.0.0.1:9",
    ),
    "gamepad": ({}, {"axes": {"left_x": [[0.0, 0.0], [100.0, 1.0]]}}, CELL, "/dev/input/event-none"),
    "hand-camera": ({"start": 0.2}, {}, HAND, "udp://127.0.0.1:0"),
    "lsl": (
        {
            "stream": {"source_id": "srl-test"},
            "rate": 200,
            "signals": {"position": {"channels": {"a": "A", "b": "B"}, "unit": "rad"}},
        },
        {},
        CELL,
        "lsl://127.0.0.1:26571",
    ),
    "mit-can": (
        {
            "maker": "damiao",
            "motors": {"one": {"id": 1, "model": "DM4340", "lower": -2.0, "upper": 2.0, "kp": 20.0, "kd": 1.0}},
        },
        {},
        _cell(chain={"part": "actuator-chain", "axes": {"one": {"model": "DM4340"}}}),
        "can://udp_multicast/239.74.163.99?port=43198",
    ),
    "natnet": ({"segments": {"wand": "wand"}}, {}, _cell(wand={"part": "mocap-body"}), "udp://127.0.0.1:9"),
    "noitom": ({}, {}, _cell(body={"part": "body"}), "tcp://127.0.0.1:9"),
    "odrive": (
        {"firmware": "0.5", "watchdog_set": True, "axes": {"one": ODRIVE}},
        {},
        _cell(chain={"part": "actuator-chain", "axes": {"one": {"model": "ODrive-8"}}}),
        "can://udp_multicast/239.74.163.99?port=43197",
    ),
    "panda": ({}, {}, _cell(arm={"part": "panda"}), "tcp://127.0.0.1:9"),
    "ring": ({}, {}, CELL, "/dev/ttyRING"),
    "serial-lines": (
        {
            "rate": 100,
            "columns": 3,
            "checksum": "sum",
            "counter": 3,
            "signals": {"force": {"elements": {"toe": 1, "heel": 2}, "unit": "N", "gain": 0.05}},
        },
        {"high": 20.0},
        CELL,
        "tcp://127.0.0.1:9",
    ),
    "softhand": ({}, {}, _cell(hand={"part": "softhand"}), "tcp://127.0.0.1:9"),
    "trigno": ({"channels": {"biceps": 1}}, {}, CELL, "tcp://127.0.0.1:9"),
    "udp-messages": (
        {
            "rate": 100,
            "sequence": "n",
            "start": 0.2,
            "signals": {"tips": {"elements": {"thumb": "hand.tips.0", "index": "hand.tips.1"}, "unit": "m"}},
        },
        {},
        CELL,
        "udp://127.0.0.1:0",
    ),
    "ur": ({}, {}, _cell(arm={"part": "ur16e"}), "tcp://127.0.0.1:9"),
    "vibration-motors": ({"motors": {"wrist": {"pin": 5}}}, {}, CELL, "tcp://127.0.0.1:9"),
    "vicon": ({"segments": {"wand": "wand/wand"}}, {}, _cell(wand={"part": "mocap-body"}), "tcp://127.0.0.1:9"),
    "xsens-mti": ({}, {}, _cell(imu={"part": "imu"}), "tcp://127.0.0.1:9"),
    "xsens-mvn": ({}, {}, _cell(body={"part": "body"}), "udp://127.0.0.1:0"),
    "zenoh": (
        {
            "signals": {
                "position": {
                    "key": "srl/other/state/glove/position",
                    "shape": [3],
                    "unit": "rad",
                    "labels": ["a", "b", "c"],
                }
            }
        },
        {},
        CELL,
        "tcp://127.0.0.1:9",
    ),
}
