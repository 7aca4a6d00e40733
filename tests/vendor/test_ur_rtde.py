"""ur_rtde, unchanged, at `srl twin`: receive, control, dashboard, I/O. Each client in a process of its own.

It knows the real controller's ports only, so the twin has a loopback address to itself.
"""

import json
import os
import subprocess
import sys
import textwrap

import pytest
from helpers import environment
from helpers.srl_twin import TwinProcess

pytest.importorskip("rtde_receive", reason="ur-rtde isn't installed")

HOST = f"127.{os.getpid() % 200 + 20}.{os.getpid() // 200 % 250}.7"
PROFILE = f"""\
name: ur-vendor
rate: 500
devices:
  arm: {{driver: ur, port: "tcp://{HOST}", interface: position}}
setpoints:
  client.position:
    {{shape: [6], unit: rad, labels: [shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3]}}
controllers:
  - use: joint-setpoint
    name: jog
    joints: [shoulder_pan, shoulder_lift, elbow, wrist_1, wrist_2, wrist_3]
    in: {{target: client.position}}
    out: {{q: arm.position_command, q_velocity: arm.position_command.velocity}}
guard:
  arm.position_command: {{velocity: 1.0, acceleration: 5.0}}
sim:
  world: cell
  parts: {{arm: {{part: ur16e}}}}
  devices: {{arm: {{host: {HOST}, standard_ports: true, noise: 0}}}}
"""


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    profile = tmp_path_factory.mktemp("ur") / "ur.yaml"
    profile.write_text(PROFILE)
    with TwinProcess(str(profile)) as twin:
        assert twin.addresses["arm"] == f"tcp://{HOST}"
        yield twin


PRELUDE = f"""
import json, time
from helpers.wait import until
HOST = {HOST!r}
out = {{}}
"""


def client(text):
    """Runs a client; what it leaves in `out`."""
    text = PRELUDE + textwrap.dedent(text) + "\nprint('OUT' + json.dumps(out))"
    done = subprocess.run(
        [sys.executable, "-c", text], env=environment(), capture_output=True, text=True, timeout=60, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout.rpartition("OUT")[2])


def test_receive_gets_every_default_variable(twin):
    out = client(
        """
        from rtde_receive import RTDEReceiveInterface
        r = RTDEReceiveInterface(HOST)
        first = r.getTimestamp()
        until(lambda: r.getTimestamp() >= first + 0.5)
        out = {"q": r.getActualQ(), "pose": r.getActualTCPPose(), "mode": r.getRobotMode(), "safety": r.getSafetyMode(),
               "joints": r.getJointMode(), "scaling": r.getSpeedScaling(), "connected": r.isConnected()}
        r.disconnect()
        """
    )
    assert out["q"] == pytest.approx([0.0, -1.5708, 1.5708, -1.5708, -1.5708, 0.0], abs=1e-3)
    assert out["pose"][:3] == pytest.approx([-0.47985, -0.17415, 0.54255], abs=1e-3)
    assert (out["mode"], out["safety"], out["joints"], out["scaling"]) == (7, 1, [253] * 6, 1.0)
    assert out["connected"]


def test_receive_gets_what_it_names_and_is_told_what_isnt_there(twin):
    out = client(
        """
        from rtde_receive import RTDEReceiveInterface
        r = RTDEReceiveInterface(HOST, 125.0, ["timestamp", "actual_q"])
        out["q"] = r.getActualQ()
        r.disconnect()
        try:
            RTDEReceiveInterface(HOST, 500.0, ["timestamp", "actual_nonsense"])
        except Exception as error:
            out["error"] = str(error)
        """
    )
    assert len(out["q"]) == 6
    assert "actual_nonsense" in out["error"]


def test_the_dashboard(twin):
    out = client(
        """
        from dashboard_client import DashboardClient
        d = DashboardClient(HOST)
        d.connect()
        out = {"version": d.polyscopeVersion(), "mode": d.robotmode(), "safety": d.safetystatus(),
               "running": d.running(), "remote": d.isInRemoteControl(), "model": d.getRobotModel(),
               "serial": d.getSerialNumber(),
               "state": d.programState()}
        d.popup("hello")
        d.disconnect()
        """
    )
    assert out["version"].startswith("5.11.0")
    assert (out["mode"], out["safety"]) == ("Robotmode: RUNNING", "Safetystatus: NORMAL")
    assert (out["running"], out["remote"], out["model"], out["serial"]) == (False, True, "UR16", "20195500001")


@pytest.mark.slow
def test_control_moves_servos_and_streams_velocities(twin):
    out = client(
        """
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface
        c, r = RTDEControlInterface(HOST, 500.0), RTDEReceiveInterface(HOST)
        q = [0.1, -1.5, 1.5, -1.5, -1.5, 0.2]
        out["moved"] = c.moveJ(q, 1.05, 1.4)
        out["q_moved"] = r.getActualQ()
        for k in range(250):
            t = c.initPeriod()
            c.servoJ([q[0] + 0.1 * k / 250, *q[1:]], 0.5, 0.25, 0.002, 0.1, 300)
            c.waitPeriod(t)
        for k in range(2000):  # a busy machine lets some of them come late
            t = c.initPeriod()
            c.servoJ([q[0] + 0.1, *q[1:]], 0.5, 0.25, 0.002, 0.1, 300)
            c.waitPeriod(t)
            if abs(r.getActualQ()[0] - q[0] - 0.1) < 2e-3:
                break
        out["q_servoed"] = r.getActualQ()
        out["servo_stopped"] = c.servoStop()
        for k in range(400):
            t = c.initPeriod()
            c.speedJ([0.1, 0.2, 0.3, -0.1, -0.2, -0.3], 2.0, 0.002)
            c.waitPeriod(t)
        out["qd"] = r.getActualQd()
        out["speed_stopped"] = c.speedStop()
        until(lambda: max(map(abs, r.getActualQd())) < 4e-3)
        out["qd_stopped"] = r.getActualQd()
        out["offset"] = c.getTCPOffset()
        out["joint_stopped"] = c.stopJ(2.0)
        out["program"] = c.isProgramRunning()
        c.stopScript()
        c.disconnect()
        r.disconnect()
        """
    )
    assert out["moved"]
    assert out["q_moved"] == pytest.approx([0.1, -1.5, 1.5, -1.5, -1.5, 0.2], abs=5e-3)
    assert out["q_servoed"][0] == pytest.approx(0.2, abs=5e-3)
    assert out["qd"] == pytest.approx([0.1, 0.2, 0.3, -0.1, -0.2, -0.3], abs=0.02)
    assert out["qd_stopped"] == pytest.approx([0.0] * 6, abs=5e-3)
    assert out["servo_stopped"]
    assert out["speed_stopped"]
    assert out["program"]
    assert out["offset"] == [0.0] * 6


def test_io_sets_outputs_registers_and_the_slider(twin):
    out = client(
        """
        from rtde_io import RTDEIOInterface
        from rtde_receive import RTDEReceiveInterface
        io = RTDEIOInterface(HOST)
        r = RTDEReceiveInterface(HOST)
        out["set"] = [io.setStandardDigitalOut(3, True), io.setSpeedSlider(0.5), io.setInputIntRegister(19, 42)]
        until(lambda: r.getSpeedScaling() == 0.5 and r.getDigitalOutState(3))
        out["got"] = [r.getDigitalOutState(3), r.getDigitalOutState(2), r.getSpeedScaling()]
        io.setSpeedSlider(1.0)
        io.setStandardDigitalOut(3, False)
        until(lambda: r.getSpeedScaling() == 1.0 and not r.getDigitalOutState(3))
        out["again"] = [r.getDigitalOutState(3), r.getSpeedScaling()]
        io.disconnect()
        r.disconnect()
        """
    )
    assert out["set"] == [True, True, True]
    assert out["got"] == [True, False, 0.5]
    assert out["again"] == [False, 1.0]


def test_a_script_client_runs_urscript(twin):
    out = client(
        """
        from rtde_receive import RTDEReceiveInterface
        from script_client import ScriptClient
        r = RTDEReceiveInterface(HOST)
        start = r.getActualQ()
        s = ScriptClient(HOST, 5, 11)
        s.connect()
        goal = [start[0] - 0.1, *start[1:]]
        s.sendScriptCommand(f"def go():\\n  movej({goal}, a=2, v=1)\\nend\\n")
        until(lambda: abs(r.getActualQ()[0] - goal[0]) < 4e-3)
        out = {"moved": r.getActualQ()[0] - start[0]}
        """
    )
    assert out["moved"] == pytest.approx(-0.1, abs=5e-3)
