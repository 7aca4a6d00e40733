"""A glove keeps offsets and gains that change its counts: other ones than the profile's are refused."""

from __future__ import annotations

import re

import pytest
from helpers.peer import make

from srl.drivers.cyberglove import CyberGlove
from srl.runtime.contracts.errors import DeviceError
from srl.runtime.testing.twin_bench import TwinBench
from srl.sim.devices.examples import DEVICES


def test_a_glove_whose_own_offsets_were_changed_is_refused() -> None:
    config, options, world, port = DEVICES["cyberglove"]
    order = {"driver": "cyberglove", "config": {"port": port} | config, "options": options, "world": world, "seed": 3}
    with TwinBench.of(make(order)[2]) as bench, bench.serving():
        reported = CyberGlove.who_is_at(bench.address)
        (settings,) = re.findall(r", settings ([0-9a-f]{8})$", reported)

        def opened() -> None:
            glove = CyberGlove("glove", CyberGlove.Config(port=bench.address, settings=settings))
            glove.open()
            glove.close()

        opened()
        bench.twin.commands._offsets[3] ^= 1
        with pytest.raises(DeviceError, match=r"own offsets and gains are other ones.*calibrate again"):
            opened()
        bench.twin.commands._offsets[3] ^= 1
        opened()
