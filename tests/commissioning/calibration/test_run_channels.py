"""What a calibration reads of a run's rows: a device that isn't there has observed nothing."""

from __future__ import annotations

import numpy as np
import pytest

from srl.commissioning.calibration.run_channels import RunChannels
from srl.commissioning.calibration.task.method import ChannelMap
from srl.runtime.ipc.header import CYCLE, DEVICE, LINK_ACTIVE, LINK_CONNECTED, LINK_ERROR, LINK_STALE, State
from srl.runtime.ipc.layout import Layout


@pytest.fixture
def layout() -> Layout:
    made = Layout(devices=["suit", "arm"])
    made.add("suit.rotation", "state", (4,), "1")
    made.add("arm.position", "state", (2,), "rad")
    made.add("marks.mark", "param", (1,), "1")
    return made


@pytest.mark.parametrize("link", [0, LINK_CONNECTED | LINK_STALE, LINK_CONNECTED | LINK_ERROR])
def test_what_a_lost_suit_showed_last_counts_for_nothing(layout: Layout, link: int) -> None:
    """The run goes on without a device that feeds no law, so its last values stay in the rows."""
    rows = np.zeros((3, layout.width), np.int64)
    rows[:, CYCLE.state] = State.ACTIVE
    for i in range(2):
        rows[:, layout.device(i)][:, DEVICE.link] = LINK_CONNECTED | LINK_ACTIVE
    rows[1, layout.device(0)][DEVICE.link] = link
    rows[:, layout.ints :] = np.full((3, layout.width - layout.ints), 0.5).view(np.int64)
    nowhere = np.array([], np.intp)
    channel_map: RunChannels = ChannelMap(layout, None, None, nowhere, nowhere)
    floats = channel_map.floats(rows)
    suit, arm, mark = (layout.fields[n] for n in ("suit.rotation", "arm.position", "marks.mark"))
    assert np.isnan(floats[1, suit.offset : suit.offset + 4]).all()
    assert np.isfinite(np.delete(floats, 1, axis=0)).all()
    assert np.isfinite(floats[1, arm.offset : arm.offset + 2]).all()
    assert floats[1, mark.offset] == 0.5
