"""Keys, tokens and hashes are ROS 2's: against another's client, rosbags, and strings of rmw_zenoh's design."""

from __future__ import annotations

import pytest
from helpers import ros2_types
from rosbags.typesys import Stores

from srl.runtime.messages import messages
from srl.runtime.messages.definitions import INDEXED
from srl.runtime.ros2.names import HASHES, TF, TRIGGER, NodeName, Qos, dds_type, gid, mangled, token, type_hash

SESSION = "8b20917502ee955ac4476e0266340d5c"


@pytest.mark.parametrize("distribution", ["jazzy", "kilted", "lyrical"])
def test_hashes_are_those_of_the_distributions(distribution: str) -> None:
    known = ros2_types.store(getattr(Stores, f"ROS2_{distribution.upper()}"), indexed=distribution != "jazzy")
    for kind in HASHES:
        if not kind.endswith(INDEXED):
            assert known.hash_rihs01(kind) == type_hash(kind, distribution), kind


def test_a_services_hash_is_that_of_anothers_client() -> None:
    utils = pytest.importorskip("zenoh_ros2_sdk.utils")
    made = utils.compute_service_type_hash(
        TRIGGER, request_definition="# nothing", response_definition="bool success\nstring message\n", dependencies={}
    )
    assert made == f"RIHS01_{HASHES[TRIGGER]}"


def test_a_gid_is_the_hash_of_the_token_low_half_first() -> None:
    xxhash = pytest.importorskip("xxhash")
    whole = xxhash.xxh3_128_digest(b"@ros2_lv/0/1")  # canonical: high half first, each big-endian
    assert gid("@ros2_lv/0/1") == whole[15:7:-1] + whole[7::-1]
    assert gid("@ros2_lv/0/1") != gid("@ros2_lv/0/2")


def test_humble_has_no_hash() -> None:
    assert type_hash(TF, "humble") == "TypeHashNotSupported"


# The examples of ros2/rmw_zenoh, docs/design.md.
def test_strings_of_the_design_page() -> None:
    node = NodeName(0, "aac3178e146ba6f1fc6e6a4085e77f21", "", "listener")
    assert node.alive == "@ros2_lv/0/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/listener"
    hashed = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert type_hash(messages.STRING, "jazzy") == hashed
    assert node.data_key("chatter", messages.STRING, hashed) == f"0/chatter/std_msgs::msg::dds_::String_/{hashed}"
    talker = NodeName(0, SESSION, "", "talker")
    made = talker.entity(10, "MP", "/chatter", messages.STRING, hashed, Qos(depth=7))
    theirs = f"@ros2_lv/0/{SESSION}/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{hashed}"
    assert made.rpartition("/")[0] == theirs


def test_another_client_writes_the_same() -> None:
    sdk = pytest.importorskip("zenoh_ros2_sdk")
    from zenoh_ros2_sdk import entity, keyexpr, qos

    assert sdk is not None
    theirs = entity.NodeEntity(domain_id=3, session_id=SESSION, node_id=0, node_name="arm", namespace="/left/worn")
    ours = NodeName(3, SESSION, "/left/worn", "arm")
    assert ours.alive == keyexpr.node_liveliness_keyexpr(theirs)
    hashed = type_hash(messages.JOINT_STATE, "jazzy")
    for role, kind in (("MP", entity.EntityKind.PUBLISHER), ("SS", entity.EntityKind.SERVICE)):
        end = entity.EndpointEntity(
            node=theirs, entity_id=4, kind=kind, name="/left/worn/joint_states",
            dds_type_name=dds_type(messages.JOINT_STATE), type_hash=hashed, qos=Qos().text,
        )  # fmt: skip
        made = ours.entity(4, role, "joint_states", messages.JOINT_STATE, hashed, Qos())
        assert made == keyexpr.endpoint_liveliness_keyexpr(end)
    read = qos.QosProfile.decode(Qos(depth=1, transient_local=True).text)
    assert (read.durability, read.reliability) == (qos.QosDurability.TRANSIENT_LOCAL, qos.QosReliability.RELIABLE)
    assert read.history_depth == 1


@pytest.mark.parametrize(
    ("name", "legal"), [("position_command", "position_command"), ("thumb-1", "thumb_1"), ("3d", "_3d"), ("é", "_")]
)
def test_parts_of_names_are_legal(name: str, legal: str) -> None:
    assert token(name) == legal


def test_a_name_within_a_token() -> None:
    assert mangled("/worn_arm/joint_states") == "%worn_arm%joint_states"
    assert mangled("") == "%"
