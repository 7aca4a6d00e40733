"""The place of a ROS 2 topic on zenoh, for both ways to reach a robot.

Behind zenoh-bridge-ros2dds the key is the topic. With rmw_zenoh_cpp the key also has domain, type and type hash.
Both announce publishers and subscribers by liveliness tokens. Source: protocol sheet summit-xl-zenoh, sections 2
and 4.
"""

from __future__ import annotations

from typing import NamedTuple

_SLASH = "§"  # stands for "/" in the bridge's tokens


class Subscriber(NamedTuple):
    """A subscriber, as described by a token.

    Attributes:
        key: the key to publish on.
        type: "geometry_msgs/msg/Twist".
    """

    key: str
    type: str


def bridge_tokens(topic: str) -> str:
    """Returns the key expression of the bridge's tokens for subscribers of a topic."""
    return f"@/*/@ros2_lv/MS/{topic.replace('/', _SLASH)}/*/*"


def read_bridge_token(token: str) -> Subscriber | None:
    """Parses a bridge's token; None if it is something else."""
    parts = token.split("/")
    if len(parts) != 7 or parts[0] != "@" or parts[2] != "@ros2_lv":
        return None
    return Subscriber(parts[4].replace(_SLASH, "/"), parts[5].replace(_SLASH, "/"))


def rmw_tokens(domain: int, topic: str) -> str:
    """Returns the key expression of rmw_zenoh's tokens for subscribers of a topic."""
    return f"@ros2_lv/{domain}/*/*/*/MS/*/*/*/{'%' + topic.replace('/', '%')}/*/*/*"


def read_rmw_token(token: str) -> Subscriber | None:
    """Parses rmw_zenoh's token; None if it is something else."""
    parts = token.split("/")
    if len(parts) != 13 or parts[0] != "@ros2_lv":
        return None
    domain, topic, kind, digest = parts[1], parts[9], parts[10], parts[11]
    return Subscriber(f"{domain}/{topic.strip('%').replace('%', '/')}/{kind}/{digest}", _plain_type(kind))


def rmw_key(domain: int, topic: str) -> str:
    """Returns the key expression of a topic's samples, whatever their type's hash."""
    return f"{domain}/{topic}/**"


def _plain_type(kind: str) -> str:
    """Converts "geometry_msgs::msg::dds_::Twist_" to "geometry_msgs/msg/Twist"."""
    return kind.replace("::dds_::", "::").replace("::", "/").rstrip("_")
