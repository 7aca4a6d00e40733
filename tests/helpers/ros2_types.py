"""rosbags' types with the services, the action and ros2_control's messages that it doesn't know, from their texts."""

from __future__ import annotations

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

SERVICES = {
    "std_srvs/srv/Trigger": ("", "bool success\nstring message"),
    "rcl_interfaces/srv/GetParameters": ("string[] names", "rcl_interfaces/ParameterValue[] values"),
    "rcl_interfaces/srv/GetParameterTypes": ("string[] names", "uint8[] types"),
    "rcl_interfaces/srv/DescribeParameters": ("string[] names", "rcl_interfaces/ParameterDescriptor[] descriptors"),
    "rcl_interfaces/srv/ListParameters": (
        "string[] prefixes\nuint64 depth",
        "rcl_interfaces/ListParametersResult result",
    ),
    "rcl_interfaces/srv/SetParameters": (
        "rcl_interfaces/Parameter[] parameters",
        "rcl_interfaces/SetParametersResult[] results",
    ),
    "rcl_interfaces/srv/SetParametersAtomically": (
        "rcl_interfaces/Parameter[] parameters",
        "rcl_interfaces/SetParametersResult result",
    ),
    "action_msgs/srv/CancelGoal": (
        "action_msgs/GoalInfo goal_info",
        "int8 return_code\naction_msgs/GoalInfo[] goals_canceling",
    ),
}
FOLLOW = "control_msgs/action/FollowJointTrajectory"
_TOLERANCE = "float64 position\nfloat64 velocity\nfloat64 acceleration"
_GOAL = """trajectory_msgs/JointTrajectory trajectory
trajectory_msgs/MultiDOFJointTrajectory multi_dof_trajectory
control_msgs/JointTolerance[] path_tolerance
control_msgs/JointComponentTolerance[] component_path_tolerance
control_msgs/JointTolerance[] goal_tolerance
control_msgs/JointComponentTolerance[] component_goal_tolerance
builtin_interfaces/Duration goal_time_tolerance"""


def _feedback(indexed: bool) -> str:
    joint, multi = "trajectory_msgs/JointTrajectoryPoint", "trajectory_msgs/MultiDOFJointTrajectoryPoint"
    lines = [
        "std_msgs/Header header",
        "string[] joint_names",
        *(f"{joint} {p}" for p in ("desired", "actual", "error")),
    ]
    lines += ["int32 index"] * indexed + ["string[] multi_dof_joint_names"]
    lines += [f"{multi} multi_dof_{p}" for p in ("desired", "actual", "error")] + ["int32 multi_dof_index"] * indexed
    return "\n".join(lines)


def _spelled(entry: Any) -> Any:
    """rosbags puts a `msg` into services' names, and has `char` apart, which is ROS 2's uint8."""
    if isinstance(entry, str):
        return "uint8" if entry == "char" else entry.replace("/srv/msg/", "/srv/")
    return type(entry)(_spelled(each) for each in entry) if isinstance(entry, tuple | list) else entry


def store(distribution: Stores, indexed: bool = False) -> Typestore:
    """rosbags' store of a distribution, with more types. `indexed`: the action's feedback as since Kilted."""
    made = get_typestore(distribution)
    described = "service_msgs/msg/ServiceEventInfo" in made.types

    def add(name: str, text: str) -> None:
        made.register(get_types_from_msg(text, name))

    def service(name: str, request: str, response: str) -> None:
        add(f"{name}_Request", request or "uint8 structure_needs_at_least_one_member")
        add(f"{name}_Response", response)
        if described:
            parts = f"{name}_Request[<=1] request\n{name}_Response[<=1] response"
            add(f"{name}_Event", f"service_msgs/ServiceEventInfo info\n{parts}")
            whole = f"{name}_Request request_message\n{name}_Response response_message\n{name}_Event event_message"
            add(name, whole)

    for name, (request, response) in SERVICES.items():
        service(name, request, response)
    add("control_msgs/msg/JointTolerance", f"string name\n{_TOLERANCE}")
    add("control_msgs/msg/JointComponentTolerance", f"string joint_name\nuint16 component\n{_TOLERANCE}")
    add(f"{FOLLOW}_Goal", _GOAL)
    add(f"{FOLLOW}_Result", "int32 error_code\nstring error_string")
    add(f"{FOLLOW}_Feedback", _feedback(indexed))
    identity = "unique_identifier_msgs/UUID goal_id"
    service(f"{FOLLOW}_SendGoal", f"{identity}\n{FOLLOW}_Goal goal", "bool accepted\nbuiltin_interfaces/Time stamp")
    service(f"{FOLLOW}_GetResult", identity, f"int8 status\n{FOLLOW}_Result result")
    add(f"{FOLLOW}_FeedbackMessage", f"{identity}\n{FOLLOW}_Feedback feedback")
    for kind in list(made.fielddefs):
        made.fielddefs[_spelled(kind)] = _spelled(made.fielddefs[kind])
        made.types[_spelled(kind)] = made.types[kind]
    return made
