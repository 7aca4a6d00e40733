"""ROBOTIS' own client of rmw_zenoh drives the base's twin: keys, attachments, tokens and CDR fit a stranger's."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np
import pytest
from helpers.base import robot
from helpers.wait import until
from rosbags.typesys import Stores, get_typestore

sdk = pytest.importorskip("zenoh_ros2_sdk")

KINDS = {  # with the hashes of the protocol sheet
    "geometry_msgs/msg/Twist": "RIHS01_9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
    "nav_msgs/msg/Odometry": "RIHS01_3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0",
}


def session(port: int) -> Any:
    """Its session, told the messages: else it would fetch their definitions from the network."""
    made = sdk.ZenohSession.get_instance("127.0.0.1", port)
    known = get_typestore(Stores.ROS2_HUMBLE).fielddefs
    made.store.register({name: fields for name, fields in known.items() if name not in made.store.fielddefs})
    made._registered_types.update({kind: kind for kind in KINDS})
    return made


def test_a_strangers_client_drives_the_twin() -> None:
    with robot(middleware="rmw_zenoh", sim={"noise": 0.0}) as r:
        port = int(r.twin.address.rpartition(":")[2])
        types = session(port).store.types
        vector = types["geometry_msgs/msg/Vector3"]
        seen: list[Any] = []
        arrived = threading.Event()

        def arrive(message: Any) -> None:
            seen.append(message)
            arrived.set()

        def place(kind: str) -> dict[str, Any]:
            return {"msg_type": kind, "domain_id": 0, "router_port": port, "type_hash": KINDS[kind]}

        subscriber = sdk.ROS2Subscriber(
            topic="/robot/robotnik_base_control/odom", callback=arrive, **place("nav_msgs/msg/Odometry")
        )
        publisher = sdk.ROS2Publisher(topic="/robot/cmd_vel", **place("geometry_msgs/msg/Twist"))
        try:
            assert arrived.wait(20)
            linear, angular = vector(x=0.4, y=0.0, z=0.0), vector(x=0.0, y=0.0, z=0.0)
            until(lambda: r.speed() >= 0.35, lambda: publisher.publish(linear=linear, angular=angular), pause=0.02)
            assert r.twin.refused == 0
            message = seen[-1]
            assert message.child_frame_id == "robot_base_footprint"
            assert message.twist.twist.linear.x > 0.3
            assert np.isfinite(message.pose.pose.position.x)
        finally:
            publisher.close()
            subscriber.close()
            session(port).close()
