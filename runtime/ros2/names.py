"""Names, type hashes, liveliness tokens and quality of service as ROS 2 has them under rmw_zenoh.

Sources: protocol sheet rmw_zenoh; ros2/rmw_zenoh, docs/design.md and detail/liveliness_utils.cpp.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from typing import Final

from srl.runtime.messages import messages
from srl.runtime.messages.definitions import FOLLOW, INDEXED

TF: Final = "tf2_msgs/msg/TFMessage"
TRIGGER: Final = "std_srvs/srv/Trigger"
TRAJECTORY: Final = "trajectory_msgs/msg/JointTrajectory"
SEND_GOAL: Final = f"{FOLLOW}_SendGoal"
GET_RESULT: Final = f"{FOLLOW}_GetResult"
FEEDBACK: Final = f"{FOLLOW}_FeedbackMessage"
CANCEL_GOAL: Final = "action_msgs/srv/CancelGoal"
GOAL_STATUS: Final = "action_msgs/msg/GoalStatusArray"
PARAMETERS: Final = "rcl_interfaces/srv/"  # of which there are six services

# RIHS01 of REP 2016, the same in Jazzy, Kilted and Lyrical but for one (a test computes them anew).
HASHES: Final = {
    messages.JOINT_STATE: "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
    messages.MULTI_ARRAY: "1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
    messages.WRENCH: "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77",
    messages.TWIST: "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
    messages.POSE: "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8",
    messages.STRING: "df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
    messages.DIAGNOSTICS: "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
    TF: "e369d0f05a23ae52508854b66f6aa0437f3449d652e8cbf22d5abe85d020f087",
    TRAJECTORY: "179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    TRIGGER: "eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f",
    SEND_GOAL: "b13789dddc325a7a962825c45e28c77d37237ec129dd0c34dc5994562938c57f",
    GET_RESULT: "e3ceb38e3e1867c8dc0f46014df26e90eb93422f27e9e97f936e07f94be4bc8b",
    FEEDBACK: "80398fcb9674a79081a9906e2ccf0c804dd7cb15e22e362e606ee87186beab71",
    FEEDBACK + INDEXED: "95618cc73912d99b9acaa17d2da5e832cb0bfdeede7534fa8ec600feca2a6c4b",
    CANCEL_GOAL: "573d8b0a534451d7bc2ac8c5ffde8ac14b8593b7001175d0cd6516dcbeb8689a",
    GOAL_STATUS: "6c1684b00f177d37438febe6e709fc4e2b0d4248dca4854946f9ed8b30cda83e",
    PARAMETERS + "GetParameters": "bf9803d5c74cf989a5de3e0c2e99444599a627c7ff75f97b8c05b01003675cbc",
    PARAMETERS + "SetParameters": "56eed9a67e169f9cb6c1f987bc88f868c14a8fc9f743a263bc734c154015d7e0",
    PARAMETERS + "SetParametersAtomically": "0e192ef259c07fc3c07a13191d27002222e65e00ccec653ca05e856f79285fcd",
    PARAMETERS + "ListParameters": "3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
    PARAMETERS + "GetParameterTypes": "da199c878688b3e530bdfe3ca8f74cb9fa0c303101e980a9e8f260e25e1c80ca",
    PARAMETERS + "DescribeParameters": "845b484d71eb0673dae682f2e3ba3c4851a65a3dcfb97bddd82c5b57e91e4cff",
}
_UNHASHED: Final = "TypeHashNotSupported"  # what Humble says in a hash's place


def definition(kind: str, distribution: str) -> str:
    """The name in `cdr.TYPES` of a type as a distribution has it."""
    return kind + INDEXED if kind == FEEDBACK and distribution in ("kilted", "lyrical") else kind


def type_hash(kind: str, distribution: str) -> str:
    """The hash of a type as keys have it."""
    return _UNHASHED if distribution == "humble" else f"RIHS01_{HASHES[definition(kind, distribution)]}"


def dds_type(kind: str) -> str:
    """The type as keys have it: "std_msgs/msg/String" -> "std_msgs::msg::dds_::String_"."""
    package, group, name = kind.split("/")
    return f"{package}::{group}::dds_::{name}_"


def gid(alive: str) -> bytes:
    """The 16 bytes by which samples name the entity of a liveliness token: its XXH3-128; random without xxhash."""
    try:
        from xxhash import xxh3_128_intdigest
    except ImportError:
        return os.urandom(16)
    return int(xxh3_128_intdigest(alive.encode())).to_bytes(16, "little")


def token(name: str) -> str:
    """A part of a ROS name: letters, digits and underscores, beginning with no digit."""
    made = re.sub(r"[^A-Za-z0-9_]", "_", name)
    return f"_{made}" if made[:1].isdigit() else made


def topic(signal: str) -> str:
    """A signal's topic, below the namespace: "finger.position" -> "finger/position"."""
    return "/".join(token(part) for part in signal.split("."))


def mangled(name: str) -> str:
    """A name within a liveliness token, where `/` separates: "/a/b" -> "%a%b"; "" -> "%"."""
    return name.replace("/", "%") or "%"


@dataclass(frozen=True)
class Qos:
    """Quality of service, as far as the runtime chooses it.

    Attributes:
        depth: of the history, keep last.
        transient_local: durability transient local: who comes late gets the last samples; else volatile.
    """

    depth: int = 10
    transient_local: bool = False

    @property
    def text(self) -> str:
        """As in a liveliness token: reliable; deadline, lifespan and liveliness are the default."""
        return f"1:{1 if self.transient_local else 2}:1,{self.depth}:,:,:,,"


@dataclass(frozen=True)
class NodeName:
    """A node in the graph.

    Attributes:
        domain: ROS_DOMAIN_ID.
        session: the zenoh session's id, hexadecimal.
        namespace: "/worn_arm"; "" for the root.
        name: of the node.
    """

    domain: int
    session: str
    namespace: str
    name: str

    def qualified(self, name: str) -> str:
        """A topic's or service's whole name: "joint_states" -> "/worn_arm/joint_states"; "/tf" stays."""
        return name if name.startswith("/") else f"{self.namespace}/{name}"

    def data_key(self, name: str, kind: str, hashed: str) -> str:
        """The key of a topic's samples, or of a service."""
        return f"{self.domain}/{self.qualified(name).strip('/')}/{dds_type(kind)}/{hashed}"

    @property
    def alive(self) -> str:
        """The node's own token."""
        return f"@ros2_lv/{self.domain}/{self.session}/0/0/NN/%/{mangled(self.namespace)}/{self.name}"

    def entity(self, number: int, role: str, name: str, kind: str, hashed: str, qos: Qos) -> str:
        """The token of an entity.

        Args:
            number: of the entity in this session, from 1.
            role: MP publisher, MS subscription, SS service, SC client of one.
            name, kind, hashed, qos: of the topic or service.
        """
        return (
            f"@ros2_lv/{self.domain}/{self.session}/0/{number}/{role}/%/{mangled(self.namespace)}/{self.name}/"
            f"{mangled(self.qualified(name))}/{dds_type(kind)}/{hashed}/{qos.text}"
        )
