"""The parser of pysio-hermes-mvn, which others wrote, on the twin's datagrams. It checks that each payload is used up.

Its base classes, which want a broker, are stubs here; its parsing is unchanged.
"""

from __future__ import annotations

import sys
import types
from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any

import numpy as np
import pytest
from helpers.xsens import mvn

_STUBS = {
    "hermes.utils.time_utils": ("get_time", "get_time_s_from_utc_time_no_date_str"),
    "hermes.utils.types": ("LoggingSpec", "NewDataDict", "VideoCodec", "VideoFormatEnum"),
    "hermes.utils.zmq_utils": ("IP_LOOPBACK", "PORT_MVN", "PORT_BACKEND", "PORT_SYNC_HOST", "PORT_KILL"),
    "hermes.base.nodes.producer": ("Producer",),
    "hermes.base.stream": ("Stream",),
    "hermes.utils": (),
    "hermes.base": (),
    "hermes.base.nodes": (),
}


@pytest.fixture
def parser(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Its class, without its base classes."""
    if find_spec("hermes") is None:
        pytest.skip("pip install --no-deps pysio-hermes-mvn")
    for name, members in _STUBS.items():
        stub = types.ModuleType(name)
        for member in members:
            setattr(stub, member, type(member, (), {}))
        if name.endswith("time_utils"):
            stub.get_time = lambda: 0.0  # type: ignore[attr-defined]
        if name.endswith("utils.types"):
            stub.NewDataDict = dict  # type: ignore[attr-defined]
        monkeypatch.setitem(sys.modules, name, stub)
    from hermes.mvn.producer import MvnAnalyzeProducer

    yield MvnAnalyzeProducer
    for name in [name for name in sys.modules if name.startswith("hermes.mvn")]:
        del sys.modules[name]


@pytest.mark.parametrize("sample", [5, 40])
def test_it_reads_segments_and_centre_of_mass(parser: Any, sample: int) -> None:
    with mvn({}, {"noise": 0.01}) as bench:
        bench.run(0.5)
        values = bench.twin.mvn.sample(sample)
        sent = bench.twin.datagrams(sample, values)
        poses, centre = bench.twin.mvn.split(values)
    found: dict[str, Any] = {}
    client = _made(parser, found)
    for data in sent:
        client._buffer = data
        assert client._process_buffer() is not None  # the payload's end is met
    quaternions = _only(found["xsens_pose_quaternion"], "quaternion", (23, 4))
    np.testing.assert_allclose(quaternions, poses[:, 3:], atol=1e-6)
    np.testing.assert_allclose(_only(found["xsens_pose_quaternion"], "position", (23, 3)), poses[:, :3], atol=1e-6)
    assert "xsens_joints" in found  # its own table of joints doesn't find them: `<< 16 + id`
    np.testing.assert_allclose(_only(found["xsens_com"], "position", (3,)), centre, atol=1e-6)
    assert found["xsens_com"]["counter"].item() == sample


def _made(parser: Any, found: dict[str, Any]) -> Any:
    from hermes.mvn.stream import MVN_JOINT_SETUP, MVN_SEGMENT_SETUP, MVN_SENSOR_SETUP

    client = parser.__new__(parser)
    for name, setup in (("segment", MVN_SEGMENT_SETUP), ("joint", MVN_JOINT_SETUP), ("sensor", MVN_SENSOR_SETUP)):
        ids = list(setup["full_body"])
        setattr(client, f"_{name}_id_mapping", {number: i for i, number in enumerate(ids)})
        setattr(client, f"_num_{name}s", len(ids))
    client._num_fingers = None
    client._topic = client.topic = "mvn"
    client._xsens_sample_index = client._xsens_message_start_time_s = client._xsens_timestep_receive_time_s = None
    client._publish = lambda tag, process_time_s, data: found.update(data)
    return client


def _only(data: dict[str, Any], word: str, shape: tuple[int, ...]) -> Any:
    """The one array under a key with this word, without what it pads."""
    (key,) = [key for key in data if word in key]
    array = np.asarray(data[key])
    return array.reshape(-1, *shape[1:])[: shape[0]] if len(shape) > 1 else array.reshape(shape)
