"""Vicon's own DataStream SDK (1.11, as pyvicon-datastream wraps it) against the twin, unchanged.

The package has no wheels: pip builds it with a C++ compiler, and gets Boost from GitHub meanwhile.
"""

from itertools import pairwise

import numpy as np
import pytest
from helpers.peer import Peer
from helpers.wait import until
from scipy.spatial.transform import Rotation

pv = pytest.importorskip("pyvicon_datastream", reason="pip install pyvicon-datastream (builds with a C++ compiler)")

QUATERNION = Rotation.from_euler("XYZ", [0.3, -0.5, 1.2])
W, X, Y, Z = QUATERNION.as_quat()[[3, 0, 1, 2]].tolist()
PARTS = {
    "tool": {
        "part": "mocap-body",
        "subject": "Tool",
        "segment": "Tip",
        "at": {"position": [0.4, -0.2, 1.1], "quaternion": [W, X, Y, Z]},
        "markers": {"A": [0.0, 0.0, 0.05], "B": [0.06, 0.0, 0.0], "C": [0.0, 0.04, 0.0], "D": [-0.03, 0.0, 0.0]},
    },
    "hidden": {"part": "mocap-body", "subject": "Hidden", "at": {"position": [1.0, 0.0, 1.0]}},
}
EXACT = {"noise": 0.0, "delay": 0.004, "occlusion": {"Hidden": [[0.0, 1e6]], "Tool/D": [[0.0, 1e6]]}}


class Vendor:
    """The SDK's client, connected; waits for what a test looks for, as its first frames may lack it."""

    def __init__(self, address: str, mode) -> None:
        self.client = pv.PyViconDatastream()
        assert self.client.connect(address.removeprefix("tcp://")) == pv.Result.Success
        self.client.enable_segment_data()
        self.client.enable_marker_data()
        self.client.enable_unlabeled_marker_data()
        self.client.set_stream_mode(mode)

    def frame(self) -> int:
        """The next frame's number."""
        until(lambda: self.client.get_frame() == pv.Result.Success, pause=0.0)
        number: int = self.client.get_frame_number()
        return number

    def until(self, condition) -> None:
        until(condition, self.frame, pause=0.0)


MODES = [("ClientPull", False), ("ServerPush", False), ("ClientPullPreFetch", False), ("ServerPush", True)]


@pytest.fixture(params=MODES, ids=lambda mode: f"{mode[0]}{'-y-up' * mode[1]}")
def vendor(request):
    """The SDK turns what a y-up server sends into z up by itself."""
    mode, y_up = request.param
    options = EXACT | {"reflections": [[1.0, 2.0, 0.5]], "y_up": y_up}
    with Peer("vicon", {"segments": {"tip": "Tool"}}, options, {"world": "cell", "parts": PARTS}) as peer:
        found = Vendor(peer.address, pv.StreamMode[mode])
        client = found.client
        found.until(lambda: client.get_segment_global_translation("Tool", "Tip") is not None)
        # Markers are asked for later than segments: the first frames may lack them.
        found.until(lambda: client.get_marker_global_translation("Tool", "B") is not None)
        found.until(lambda: client.get_unlabeled_marker_count() == 1)
        yield found
        found.client.disconnect()


def test_the_sdk_reads_what_the_simulated_cameras_see(vendor):
    client = vendor.client
    assert [client.get_subject_name(i) for i in range(client.get_subject_count())] == ["Tool", "Hidden"]
    assert client.get_subject_root_segment_name("Tool") == "Tip"
    assert client.get_frame_rate() == pytest.approx(100.0)
    assert client.get_latency_total() == pytest.approx(0.004)
    assert client.get_subject_quality("Tool") == 1.0
    np.testing.assert_allclose(client.get_segment_global_translation("Tool", "Tip"), [400, -200, 1100], atol=0.01)
    np.testing.assert_allclose(
        client.get_segment_global_rotation_matrix("Tool", "Tip"), QUATERNION.as_matrix(), atol=1e-5
    )
    np.testing.assert_allclose(client.get_segment_global_rotation_euler_xyz("Tool", "Tip"), [0.3, -0.5, 1.2], atol=1e-5)
    np.testing.assert_allclose(
        np.abs(client.get_segment_global_quaternion("Tool", "Tip")), np.abs([W, X, Y, Z]), atol=1e-5
    )
    np.testing.assert_allclose(client.get_segment_local_translation("Tool", "Tip"), [400, -200, 1100], atol=0.01)
    names = [client.get_marker_name("Tool", i) for i in range(client.get_marker_count("Tool"))]
    assert names == ["A", "B", "C", "D"]
    expected = np.array([400, -200, 1100]) + QUATERNION.apply([60.0, 0, 0])
    np.testing.assert_allclose(client.get_marker_global_translation("Tool", "B"), expected, atol=0.01)
    assert client.get_unlabeled_marker_count() == 1
    np.testing.assert_allclose(client.get_unlabeled_marker_global_translation(0), [1000, 2000, 500])


def test_what_is_occluded_reads_so(vendor):
    # The wrapper gives zeros or nothing for what the SDK calls occluded.
    for found in (
        vendor.client.get_segment_global_translation("Hidden", "Hidden"),
        vendor.client.get_marker_global_translation("Hidden", "M1"),
        vendor.client.get_marker_global_translation("Tool", "D"),
    ):
        assert found is None or not np.any(found)


def test_frame_numbers_go_up(vendor):
    numbers = [vendor.frame() for _ in range(30)]
    assert all(a <= b for a, b in pairwise(numbers))
    assert numbers[-1] > numbers[0]
