"""The benches by name: where each is, and whether the quick set has it."""

from __future__ import annotations

from typing import Final, NamedTuple


class Bench(NamedTuple):
    """One bench.

    Attributes:
        function: "module:function"; it takes `arguments` and returns rows.
        quick: whether it is in the quick set: those of the loop, and short ones.
    """

    function: str
    arguments: tuple[int, ...] = ()
    quick: bool = False


BENCHES: Final[dict[str, Bench]] = {
    "arm-angles": Bench("bench.arm_angles:run"),
    "bus-age-100hz": Bench("bench.bus_age:run", (100,), quick=True),
    "bus-age-1khz": Bench("bench.bus_age:run", (1000,)),
    "ros2-node": Bench("bench.ros2_node:run", (100,)),
    "byte-to-byte": Bench("bench.byte_to_byte:run"),
    "can-actuators": Bench("bench.can_actuators:run"),
    "clock-100hz": Bench("bench.clock:run", (100,)),
    "clock-1khz": Bench("bench.clock:run", (1000,), quick=True),
    "collision": Bench("bench.collision:run"),
    "compiled": Bench("bench.compiled:run", quick=True),
    "cue": Bench("bench.cue:run"),
    "drivers": Bench("bench.drivers:run"),
    "dynamixel": Bench("bench.dynamixel:run", quick=True),
    "growth": Bench("bench.growth:run"),
    "ikns-cycle": Bench("bench.ikns:run"),
    "noitom-text": Bench("bench.noitom:run"),
    "object-mapping": Bench("bench.object_mapping:run"),
    "panda-cycle": Bench("bench.panda:run"),
    "panel": Bench("bench.panel:run"),
    "reach": Bench("bench.reach:run"),
    "ur-rtde-receive": Bench("bench.ur:run"),
    "pycgm": Bench("bench.pycgm:run"),
    "sibson": Bench("bench.sibson:run"),
    "skeleton": Bench("bench.skeleton:run"),
    "cycle-sixth-finger": Bench("bench.sixth_finger:cycle", quick=True),
    "sim-moca-man": Bench("bench.simulated:moca_man"),
    "sim-sixth-finger": Bench("bench.simulated:sixth_finger"),
    "stop-latency": Bench("bench.stop_latency:run"),
    "superman": Bench("bench.superman:run"),
    "superman-laws": Bench("bench.whole_body_laws:run"),
    "telemetry-1khz": Bench("bench.sixth_finger:telemetry"),
}
