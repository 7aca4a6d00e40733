"""Makes the description of an arm from a URDF: the joints between two links, limits, inertias, contact shapes.

What the file's other joints move is part of the link that it hangs on, as they stand at zero.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import inf
from typing import Final

import numpy as np

from srl.runtime.contracts import rotation
from srl.runtime.contracts.errors import OptionError, nearest
from srl.runtime.contracts.frames import IDENTITY
from srl.runtime.contracts.signals import Array
from srl.runtime.models.robots.description import Capsule, Inertial, Joint, RobotDescription, everywhere, trans
from srl.runtime.models.robots.urdf import UrdfJoint, UrdfTree
from srl.runtime.models.robots.urdf_link import Warning, collision_shapes, inertial

STIFF: Final = 0.05  # rad or m, by which the greatest torque stretches a simulated drive; ours
UNKNOWN_STIFFNESS: Final = 1000.0  # N m/rad, of a drive whose greatest torque nobody says; ours
INERTIA: Final = 0.1  # kg m^2, that a joint moves, for the damping of simulated drives; ours
LIMB: Final = 3.0  # m, between two joints of anything that is worn or stands on a table
TURN: Final = 2 * np.pi + 1e-3  # rad; a joint's range may be a turn both ways
FAST: Final = {False: 50.0, True: 20.0}  # rad/s, m/s
LIMITS: Final = ("lower", "upper", "velocity", "effort")

MOST = 64  # moving joints of which the last is looked for


@dataclass(frozen=True)
class UrdfArm:
    """What was made of the file.

    Attributes:
        base, tip: the links between which its joints are.
        held: joints that aren't between them and are taken to stay where they are.
    """

    robot: RobotDescription
    base: str
    tip: str
    held: tuple[str, ...]


def read(
    tree: UrdfTree,
    base: str | None,
    tip: str | None,
    limits: Mapping[str, Mapping[str, float]],
    capsules: Mapping[str, tuple[Capsule, ...]],
    home: Mapping[str, float],
) -> UrdfArm:
    """Makes the description.

    Args:
        base: the link whose frame is the arm's own; None: the root.
        tip: the link whose frame is the flange's; None: the one behind the only chain of joints.
        limits: by joint, what replaces the file's: lower, upper (rad or m), velocity (rad/s or m/s), effort (N m or N).
        capsules: by link, contact shapes in place of the file's, in the link's frame.
        home: by joint, rad or m.
    Raises:
        OptionError: it can't be used.
    """
    file = tree.place
    chain, base, tip = _chain(tree, base, tip)
    movers = [joint for joint in chain if joint.moves]
    names = [joint.name for joint in movers]
    for what, given in (("limits", limits), ("home", home)):
        for name in given:
            if name not in names:
                raise OptionError(f"{file}: '{name}' of '{what}' doesn't move between {base} and {tip}",
                                  nearest(name, names))  # fmt: skip
    for link in capsules:
        if link not in tree.links:
            raise OptionError(f"{file} has no link '{link}' for 'capsules'", nearest(link, tree.links))
    warnings: list[Warning] = []
    bounds = {joint.name: _bounds(joint, limits.get(joint.name, {}), file, warnings) for joint in movers}
    held = _held(tree, base, set(names))
    owners, places, placements, flange = _placed(tree, base, tip, names, held)
    bodies: list[list[Inertial]] = [[] for _ in range(len(movers) + 1)]
    shapes: list[list[Capsule]] = [[] for _ in range(len(movers) + 1)]
    unseen = []
    for link, owner in owners.items():
        behind = [j for j in tree.joints if j.parent == link]
        found = inertial(tree.links[link], file, [np.array(j.pose[:3]) for j in behind], warnings)
        if found is not None:
            bodies[owner].append(found.moved(places[link]))
        drawn, whole = (capsules[link], True) if link in capsules else collision_shapes(tree.links[link], file)
        shapes[owner] += [_moved(capsule, places[link]) for capsule in drawn]
        if not whole:
            unseen.append(link)
    warnings += [
        f"joint {joint.name} is {np.linalg.norm(joint.pose[:3]):.4g} m from the one before. Are these millimetres?"
        for joint in chain
        if np.linalg.norm(joint.pose[:3]) > LIMB
    ]
    joints = tuple(
        Joint(joint.name, place, _sum(body), tuple(shape), joint.kind == "prismatic")
        for joint, place, body, shape in zip(movers, placements, bodies[1:], shapes[1:], strict=True)
    )
    lower, upper, velocity, effort = (np.array([bounds[name][key] for name in names]) for key in LIMITS)
    n = len(movers)
    made = RobotDescription(
        name=tree.name, base=_sum(bodies[0]), base_shape=tuple(shapes[0]), joints=joints, flange=flange,
        q_lower=lower, q_upper=upper, dq_max=velocity, ddq_max=everywhere(inf, n), dddq_max=everywhere(inf, n),
        tau_max=effort, dtau_max=everywhere(inf, n), rotor_inertia=everywhere(0.0, n),
        dry_friction=np.array([joint.friction for joint in movers]),
        stiffness=np.where(np.isfinite(effort), effort / STIFF, UNKNOWN_STIFFNESS), inertia=everywhere(INERTIA, n),
        home=_home(home, names, lower, upper, file), payload=inf, unseen=tuple(unseen),
    )  # fmt: skip
    if made.weightless:
        warnings.append(f"nothing behind joint {made.weightless[0]} has a mass: only kinematics can be made of it")
    return UrdfArm(replace(made, warnings=tuple(warnings)), base, tip, tuple(held))


def _chain(tree: UrdfTree, base: str | None, tip: str | None) -> tuple[list[UrdfJoint], str, str]:
    """The joints from base to tip, and the two links."""
    file = tree.place
    for what, link in (("base", base), ("tip", tip)):
        if link is not None and link not in tree.links:
            raise OptionError(f"{file} has no link '{link}' for '{what}'", nearest(link, tree.links))
    base = base or next(link for link in tree.links if link not in tree.before)
    if tip is None:
        moving = [j for j in tree.joints if j.moves and j.mimic is None and base in _links(tree, j.child)]
        inner = {each.name for other in moving for each in tree.way(other.parent)} if len(moving) <= MOST else set()
        ends = [j for j in moving if j.name not in inner]
        if len(moving) > MOST:
            raise OptionError(
                f"{file} has {len(moving)} joints behind {base}", "Say by 'tip' which link is the arm's end"
            )
        if len(ends) != 1:
            tips = ", ".join(j.child for j in ends[:6])
            raise OptionError(f"{file} has {len(ends)} chains of joints behind {base}, which end at: {tips or 'none'}",
                              "Say by 'tip' which link is the arm's end")  # fmt: skip
        tip = ends[0].child
        if followers := [j.name for j in tree.joints if j.mimic is not None and j.mimic[0] == ends[0].name]:
            raise OptionError(
                f"{file}: {', '.join(followers)} follows {ends[0].name}, the last joint behind {base}, as in a gripper",
                f"Say by 'tip' which link is the arm's end, such as '{ends[0].parent}'",
            )
    if base not in _links(tree, tip):
        raise OptionError(f"{file}: the link '{tip}' doesn't hang on '{base}'", "Name a 'tip' behind the 'base'")
    above = {j.name for j in tree.way(base)}
    chain = [j for j in tree.way(tip) if j.name not in above]
    for joint in chain:
        if joint.mimic is not None:
            raise OptionError(f"{file}: joint {joint.name} follows '{joint.mimic[0]}' and is between {base} and {tip}",
                              "An arm's joints are driven each by itself: name another 'tip' or 'base'")  # fmt: skip
        if not joint.moves and joint.kind != "fixed":
            raise OptionError(f"{file}: joint {joint.name} between {base} and {tip} is '{joint.kind}'",
                              "An arm's joints are revolute, continuous, prismatic or fixed")  # fmt: skip
    if not any(joint.moves for joint in chain):
        raise OptionError(f"{file}: nothing moves between {base} and {tip}", "Name the 'base' and the 'tip' of the arm")
    return chain, base, tip


def _links(tree: UrdfTree, link: str) -> list[str]:
    """A link and those that it hangs on."""
    return [link, *(joint.parent for joint in tree.way(link))]


def _bounds(joint: UrdfJoint, given: Mapping[str, float], file: object, warnings: list[Warning]) -> dict[str, float]:
    """The four limits of a joint."""
    found, place = {**joint.limits, **given}, f"{file}: joint {joint.name}"
    slides = joint.kind == "prismatic"
    if joint.kind == "continuous":
        rest = {key: value for key, value in found.items() if key in given or key in ("velocity", "effort")}
        found = {"lower": -inf, "upper": inf, **rest}
    _right_way_round(place, found.get("lower", 0.0), found.get("upper", 0.0))
    if not found.get("lower", 0.0) < found.get("upper", 0.0):
        raise OptionError(
            f"{place} has no position limits",
            f"Say them in the URDF, or in the entry: limits: {{{joint.name}: {{lower: ..., upper: ...}}}}; "
            "a joint that turns without end is 'continuous'",
        )
    for key in ("velocity", "effort"):
        if found.get(key, 0.0) <= 0.0:  # zero is what exporters write where nobody has said any
            found[key] = inf
            warnings.append(f"joint {joint.name} has no {key} limit: say it by 'limits'")
    for key in ("lower", "upper"):
        value = found[key]
        if np.isfinite(value) and abs(value) > (LIMB if slides else TURN):
            asked = "Are these millimetres?" if slides else f"Are these degrees? {value:g} degrees are " \
                    f"{np.radians(value):.4g} rad"  # fmt: skip
            warnings.append(f"joint {joint.name}: its limit {key} is {value:g} {'m' if slides else 'rad'}. {asked}")
    for key, value in given.items():
        limit, sign = joint.limits.get(key), -1.0 if key == "lower" else 1.0
        if limit and joint.kind != "continuous" and sign * value > sign * limit:
            warnings.append(f"joint {joint.name}: {key} {value:g} is wider than the file's {limit:g}")
    if np.isfinite(found["velocity"]) and found["velocity"] > FAST[slides]:
        unit = "m/s. Are these millimetres?" if slides else "rad/s. Are these degrees?"
        warnings.append(f"joint {joint.name}: its limit velocity is {found['velocity']:g} {unit}")
    return found


def _held(tree: UrdfTree, base: str, names: set[str]) -> dict[str, float]:
    """The joints behind the base that aren't the arm's, and where they are taken to stay (rad or m)."""
    held: dict[str, float] = {}
    for joint in tree.joints:
        if joint.moves and joint.name not in names and base in _links(tree, joint.parent):
            lower, upper = joint.limits.get("lower", -inf), joint.limits.get("upper", inf)
            if joint.kind != "continuous":
                _right_way_round(f"{tree.place}: joint {joint.name}", lower, upper)
            held[joint.name] = 0.0 if joint.kind == "continuous" or lower >= upper else min(max(0.0, lower), upper)
    for joint in tree.joints:
        if joint.name in held and joint.mimic is not None:
            followed, factor, offset = joint.mimic
            held[joint.name] = factor * held.get(followed, 0.0) + offset
    return held


def _placed(
    tree: UrdfTree, base: str, tip: str, names: list[str], held: Mapping[str, float]
) -> tuple[dict[str, int], dict[str, Array], list[Array], Array]:
    """Of each link behind the base: number of the arm's link that it is part of (0: the base), and pose in that one.

    Also each joint's placement in the arm's link before, and the tip's pose in the last one.
    """
    owners, places = {base: 0}, {base: np.eye(4)}
    placements: list[Array] = [np.eye(4)] * len(names)
    for link in tree.ordered():
        joint = tree.before.get(link)
        if joint is None or link == base or joint.parent not in owners:
            continue
        here = places[joint.parent] @ rotation.homogeneous(joint.pose)
        if joint.name in names:
            number = names.index(joint.name)
            turn = _onto_axis(joint)
            placements[number] = here @ turn
            owners[link], places[link] = number + 1, turn.T.copy()
            continue
        owners[link] = owners[joint.parent]
        places[link] = here @ _along(joint, held[joint.name]) if joint.name in held else here
    return owners, places, placements, places[tip]


def _onto_axis(joint: UrdfJoint) -> Array:
    """(4, 4): the frame whose z is the joint's axis, in the joint's own; the identity where that is z already."""
    made = np.eye(4)
    if joint.axis != (0.0, 0.0, 1.0):
        w, x, y, z = rotation.from_z(np.array([joint.axis]))[0].tolist()
        made[:3, :3] = rotation.matrix((w, x, y, z))
    return made


def _along(joint: UrdfJoint, value: float) -> Array:
    """(4, 4): what a joint does to its link at a value, rad or m."""
    x, y, z = (value * u for u in joint.axis)
    if joint.kind == "prismatic":
        return trans(x, y, z)
    return rotation.homogeneous((*IDENTITY[:3], *rotation.exp(x, y, z)))


def _sum(bodies: list[Inertial]) -> Inertial:
    """One body of several."""
    mass = sum(body.mass for body in bodies)
    if mass <= 0.0:
        return Inertial(0.0, np.zeros(3), np.zeros((3, 3)))
    com = sum((body.mass * body.com for body in bodies), np.zeros(3)) / mass
    total = np.zeros((3, 3))
    for body in bodies:
        r = body.com - com
        total += body.inertia + body.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return Inertial(mass, com, total)


def _moved(capsule: Capsule, place: Array) -> Capsule:
    ends = ((place @ [*end, 1.0])[:3].tolist() for end in (capsule.start, capsule.end))
    start, end = ((x, y, z) for x, y, z in ends)
    return replace(capsule, start=start, end=end)


def _home(given: Mapping[str, float], names: list[str], lower: Array, upper: Array, file: object) -> Array:
    """(n,): what is given; else zero, or the middle of a range that doesn't have it."""
    home = np.where((lower < 0.0) & (upper > 0.0), 0.0, np.clip(0.0, lower, upper))
    off = home != 0.0  # zero isn't within the range, which is then finite
    home[off] = (lower[off] + upper[off]) / 2
    for name, value in given.items():
        i = names.index(name)
        if not lower[i] <= value <= upper[i]:
            problem = f"{file}: home of {name}, {value:g}, isn't within {lower[i]:g} to {upper[i]:g}"
            raise OptionError(problem, "Give it in rad, or m where the joint slides")
        home[i] = value
    return home


def _right_way_round(place: str, lower: float, upper: float) -> None:
    """Raises OptionError for a lower limit above the upper one."""
    if lower > upper:
        raise OptionError(f"{place}: its lower limit {lower:g} is above the upper {upper:g}", "Exchange them")
