"""The Panda driver against franka-sim (PyPI, Apache-2.0): an FCI server and a robot that somebody else wrote.

It speaks protocol 10, steps its own MuJoCo model in real time and, asked to, stops for what an FR3 stops for. It
needs numpy 1 and an older MuJoCo, so it gets an environment of its own in the user's cache folder.
"""

import fcntl
import os
import select
import shutil
import socket
import subprocess
import sys
import time
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from helpers.wait import until
from helpers.zenoh import reopened

from srl.drivers.panda import Panda
from srl.drivers.panda.config import PandaConfig
from srl.drivers.panda.packets import decode_state
from srl.runtime.contracts.signals import Stop
from srl.runtime.models.robots import FR3

# Serial: a robot that wants a packet each millisecond.
pytestmark = [pytest.mark.slow, pytest.mark.serial, pytest.mark.timeout(600)]
PACKAGE = "franka-sim==1.1.7"
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "srl-runtime-tests"
SERVE = (
    "import sys, logging\n"
    "from franka_sim import FrankaSimServer\n"
    "logging.basicConfig(level=logging.WARNING)\n"
    "FrankaSimServer(host='127.0.0.1', port=int(sys.argv[1]), enable_gripper=False, physics='mujoco',\n"
    "    enforce_motion_limits='limits' in sys.argv, enforce_comm_constraints='packets' in sys.argv).start()\n"
)


@pytest.fixture(scope="module")
def python():
    """The interpreter of franka-sim's own environment, made at the first use."""
    home = CACHE / PACKAGE.replace("==", "-")
    interpreter, complete = home / "bin" / "python", home / "complete"
    CACHE.mkdir(parents=True, exist_ok=True)
    with open(CACHE / "lock", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete.exists():
            shutil.rmtree(home, ignore_errors=True)
            subprocess.run([sys.executable, "-m", "venv", str(home)], check=True, capture_output=True)
            install = [str(interpreter), "-m", "pip", "install", "--quiet", PACKAGE]
            try:
                done = subprocess.run(install, capture_output=True, text=True, timeout=400, check=False)
                why = done.stderr.strip().splitlines()[-1:] if done.returncode else []
            except subprocess.TimeoutExpired:
                why = ["it took more than 400 s"]
            if why:
                shutil.rmtree(home, ignore_errors=True)
                pytest.skip(f"{PACKAGE} can't be installed: {why[0]}")
            complete.touch()
    return str(interpreter)


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    """The FR3 as an MJCF with the names that franka-sim looks for; from the runtime's own description."""
    root = ElementTree.Element("mujoco", model="fr3")
    ElementTree.SubElement(root, "compiler", angle="radian", autolimits="true")
    parent = ElementTree.SubElement(root, "worldbody")
    parent = ElementTree.SubElement(parent, "body", name="fr3_link0")
    for i, joint in enumerate(FR3.joints):
        place, link = joint.placement, joint.link
        axes = " ".join(f"{x:.12g}" for x in np.concatenate([place[:3, 0], place[:3, 1]]))
        parent = ElementTree.SubElement(parent, "body", name=f"fr3_link{i + 1}", pos=_text(place[:3, 3]), xyaxes=axes)
        inertia = link.inertia
        ElementTree.SubElement(
            parent,
            "inertial",
            pos=_text(link.com),
            mass=f"{link.mass:.12g}",
            fullinertia=_text(
                [inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]]
            ),
        )
        ElementTree.SubElement(
            parent, "joint", name=f"fr3_joint{i + 1}", axis="0 0 1", range=_text([FR3.q_lower[i], FR3.q_upper[i]]),
            armature="0.1",
        )  # fmt: skip
    file = tmp_path_factory.mktemp("fr3") / "fr3.xml"
    ElementTree.ElementTree(root).write(file)
    return file


def _text(values):
    return " ".join(f"{x:.12g}" for x in values)


@pytest.fixture
def server(python, model):
    """Starts a server that stops the robot for what is to be enforced, "limits" or "packets"; gives its address."""
    running = []

    def start(*enforced):
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        order = [python, "-c", SERVE, str(port), *enforced]
        running.append(subprocess.Popen(order, env=os.environ | {"FR3_MJCF": str(model)}, stdout=subprocess.DEVNULL))

        def listens():
            assert running[-1].poll() is None, "franka-sim didn't start"
            with socket.socket() as probe:
                probe.settimeout(1)
                return probe.connect_ex(("127.0.0.1", port)) == 0

        until(listens, what="franka-sim's port", timeout=60.0, pause=0.2)
        return f"tcp://127.0.0.1:{port}"

    yield start
    for process in running:
        process.kill()
        process.wait()


class Client:
    """The driver, open, with a loop that the robot's states pace."""

    def __init__(self, address, interface, **options):
        self.driver = Panda("arm", PandaConfig(port=address, interface=interface, **options))
        self.state = {s.name: np.zeros(s.shape) for s in self.driver.states}
        (command,) = self.driver.commands
        self.command = np.zeros(command.shape)
        self.driver.bind(self.state, {command.name: self.command})
        self.worst = 1.0  # success rate in a motion: less than 1 where this machine had no time for a packet
        reopened(self.driver)  # it has just let the probe go

    def desired(self):
        """The joint angles that the robot itself says it is to have, rad (7,)."""
        return decode_state(10, self.driver._newest)["q_d"].astype(float)

    def run(self, seconds, law=lambda t: None, write=True):
        """Runs for so much of the robot's time, as its states tell it; `law` sets the command."""
        start = None
        deadline = time.monotonic() + 20 + 10 * seconds
        while time.monotonic() < deadline:
            select.select([self.driver.fileno()], [], [], 0.1)
            self.driver.read(time.monotonic_ns())
            now = self.driver._id / 1000
            start = now if start is None else start
            if now - start >= seconds or self.driver.health.fault:
                return
            if self.state["success_rate"][0] > 0:
                self.worst = min(self.worst, self.state["success_rate"][0])
            law(now - start)
            if write:
                self.driver.write(time.monotonic_ns())
        raise AssertionError("the robot's time stood still")


@pytest.fixture
def client():
    made = []

    def make(*args, **options):
        made.append(Client(*args, **options))
        return made[-1]

    yield make
    for one in made:
        one.driver.close()


def undisturbed(make, law, well=lambda: True):
    """Runs a motion of 2 s with a new client; again, three times at most, if it failed while packets came late.

    The server then replaces a packet, may take the late one after all, and finds a jump between the two; without
    its limits it follows that jump instead (then `well` says no).
    """
    for _ in range(3):
        c = make()
        c.run(0.1, write=False)
        c.run(2.0, law(c))
        if c.worst == 1.0 or (well() and not c.driver.health.fault):
            break
    return c


def test_states_agree_with_our_own_kinematics(server, client):
    c = client(server(), "torque", load={"mass": 0.0}, collision={"torque": 80.0, "force": 80.0})
    c.run(0.2, write=False)
    assert "protocol 10" in c.driver.health.message
    assert c.driver.health.fault == ""
    flange = FR3.forward(c.state["position"])
    distance = np.linalg.norm(flange[:3, 3] - c.state["pose"][:3])
    assert distance == pytest.approx(0.0, abs=0.12)  # its end effector's frame lies between joint 7 and the flange
    assert np.linalg.norm(c.state["pose"][3:]) == pytest.approx(1.0)


def test_velocities_that_jump_pass_its_limits_and_end_in_good_order(server, client):
    seen, asked = [], []

    def law(c):
        seen.clear()
        asked.clear()

        def step(t):
            c.command[:] = 0.4 if 0.1 < t < 0.6 else -0.4 if 0.6 <= t < 1.1 else 0.0
            seen.append(c.state["position"].copy())
            asked.append(c.desired())

        return step

    c = undisturbed(lambda: client(server("limits"), "velocity"), law)
    assert c.driver.health.fault == ""
    start, wanted = seen[0], asked[0]
    assert (np.max(seen, axis=0) - start > 0.1).all()
    # Its velocity servo is soft; what it understood is what it integrates.
    assert np.max(asked, axis=0) - wanted == pytest.approx([0.2] * 7, abs=0.05)
    assert c.desired() == pytest.approx(wanted, abs=0.05)
    assert c.driver.metrics()["moves"] == 1
    c.driver.stop(Stop.HOLD)
    c.run(0.3, write=False)
    assert c.driver.health.fault == ""
    c.command[:] = 0.0
    c.run(0.3)
    assert c.driver.metrics()["moves"] == 2
    assert c.driver.health.fault == ""


def test_without_the_last_line_it_would_stop_for_the_same_command(server, client):
    c = client(server("limits"), "velocity")
    c.driver._motion._movement = lambda data, wanted: wanted
    c.command[:] = 0.4
    c.run(1.0)
    assert c.driver.health.fault.startswith("reflex: joint_motion_generator_")


def test_a_joint_is_moved_by_torque(server, client):
    c = client(server("limits"), "torque")
    c.run(0.1, write=False)
    start = c.state["position"].copy()
    goal = start + np.array([0.1, 0.05, -0.1, 0.05, 0.1, -0.1, 0.1])
    stiffness = np.array([80.0, 80.0, 80.0, 80.0, 30.0, 20.0, 10.0])

    def law(t):
        wanted = start + (goal - start) * min(t / 1.0, 1.0)
        c.command[:] = stiffness * (wanted - c.state["position"]) - 0.3 * stiffness**0.9 * c.state["velocity"]

    c.run(3.0, law)
    assert c.driver.health.fault == ""
    assert c.state["position"] == pytest.approx(goal, abs=0.03)


def test_positions_are_followed(server, client):
    errors = []

    def law(c):
        errors.clear()
        start = c.state["position"].copy()

        def step(t):
            c.command[:] = start + 0.1 * (1 - np.cos(np.pi * t))
            errors.append(np.abs(c.command - c.state["position"]).max())

        return step

    # Positions differentiated three times leave no room for its late packets, which this machine always has some of.
    c = undisturbed(lambda: client(server(), "position"), law, lambda: max(errors) < 0.05)
    assert c.driver.health.fault == ""
    assert max(errors) < 0.05
    assert errors[-1] < 0.03


def test_a_pause_of_ours_is_a_fault_that_a_person_recovers_from(server, client):
    c = client(server("packets"), "torque")
    for _ in range(20):  # a busy machine may lose 20 packets by itself: that is the same fault
        c.run(0.05)
        if c.driver.metrics()["moves"]:
            break
    time.sleep(3.0)  # the pause
    c.driver.read(time.monotonic_ns())
    c.driver.write(time.monotonic_ns())
    until(lambda: c.driver.health.fault.startswith("reflex"), lambda: c.driver.read(time.monotonic_ns()))
    assert c.driver.health.fault == "reflex: communication_constraints_violation"
    c.driver.recover(time.monotonic_ns())
    until(lambda: not c.driver.health.fault, lambda: c.driver.read(time.monotonic_ns()))
    moves = c.driver.metrics()["moves"]
    c.run(0.3)
    assert (c.driver.health.fault, c.driver.metrics()["moves"]) == ("", moves + 1)
