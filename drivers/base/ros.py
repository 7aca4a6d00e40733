"""Where a ROS 2 topic is on zenoh, for both ways a robot can be reached.

Behind zenoh-bridge-ros2dds the key is the topic; with rmw_zenoh_cpp it has domain, type and type hash around
it. Both announce who publishes and who subscribes by liveliness tokens. Source: protocol sheet
summit-xl-zenoh, sections 2 and 4.
"""

from __future__ import annotations

from typing import NamedTuple

_SLASH = "§"  # the bridge's tokens have it for "/"


class Subscriber(NamedTuple):
    """What a token tells of a subscriber.

    Attributes:
        key: where to publish.
        type: "geometry_msgs/msg/Twist".
    """

    key: str
    type: str


def bridge_tokens(topic: str) -> str:
    """The key expression of the bridge's tokens for subscribers of a topic."""
    return f"@/*/@ros2_lv/MS/{topic.replace('/', _SLASH)}/*/*"


def read_bridge_token(token: str) -> Subscriber | None:
    """A bridge's token; None if it is something else."""
    parts = token.split("/")
    if len(parts) != 7 or parts[0] != "@" or parts[2] != "@ros2_lv":
        return None
    return Subscriber(parts[4].replace(_SLASH, "/"), parts[5].replace(_SLASH, "/"))


def rmw_tokens(domain: int, topic: str) -> str:
    """The key expression of rmw_zenoh's tokens for subscribers of a topic."""
    return f"@ros2_lv/{domain}/*/*/*/MS/*/*/*/{'%' + topic.replace('/', '%')}/*/*/*"


def read_rmw_token(token: str) -> Subscriber | None:
    """rmw_zenoh's token; None if it is something else."""
    parts = token.split("/")
    if len(parts) != 13 or parts[0] != "@ros2_lv":
        return None
    domain, topic, kind, digest = parts[1], parts[9], parts[10], parts[11]
    return Subscriber(f"{domain}/{topic.strip('%').replace('%', '/')}/{kind}/{digest}", _plain_type(kind))


def rmw_key(domain: int, topic: str) -> str:
    """The key expression of a topic's samples, whatever their type's hash."""
    return f"{domain}/{topic}/**"


def _plain_type(kind: str) -> str:
    """ "geometry_msgs::msg::dds_::Twist_" -> "geometry_msgs/msg/Twist"."""
    return kind.replace("::dds_::", "::").replace("::", "/").rstrip("_")
