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
ALONE = HOST[:-1] + "8"  # of a twin for one test
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
import json, math, time
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
        for k in range(2000):
            t = c.initPeriod()
            c.speedJ([0.1, 0.2, 0.3, -0.1, -0.2, -0.3], 2.0, 0.002)
            c.waitPeriod(t)
            if k > 50 and abs(r.getActualQd()[2] - 0.3) < 5e-3:
                break
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


@pytest.mark.slow
def test_cartesian_commands_kinematics_tcp_and_paths_do_what_they_answer(twin):
    out = client(
        """
        from rtde_control import RTDEControlInterface, Path, PathEntry
        from rtde_receive import RTDEReceiveInterface
        c, r = RTDEControlInterface(HOST, 500.0), RTDEReceiveInterface(HOST)
        home = [0.0, -1.5, 1.5, -1.5, -1.5, 0.0]
        c.moveJ(home, 2.0, 3.0)
        pose = c.getForwardKinematics()
        out["here"] = [pose, r.getActualTCPPose()]
        out["ik"] = c.getInverseKinematics(pose, home)
        out["solvable"] = [c.getInverseKinematicsHasSolution(pose, home),
                           c.getInverseKinematicsHasSolution([3.0, 0, 0, 0, 0, 0], home)]
        goal = [pose[0] + 0.05, pose[1] - 0.05, pose[2], *pose[3:]]
        out["moveL"] = [c.moveL(goal, 0.2, 1.0), goal, r.getActualTCPPose()]
        out["moveL_FK"] = [c.moveL_FK(home, 0.2, 1.0), r.getActualQ()]
        out["moveJ_IK"] = [c.moveJ_IK(goal, 1.0, 2.0), r.getActualTCPPose()]
        path = [[*home, 1.0, 2.0, 0.0], [0.2, *home[1:], 1.0, 2.0, 0.02], [0.2, -1.4, *home[2:], 1.0, 2.0, 0.0]]
        out["path"] = [c.moveJ(path), r.getActualQ()]
        out["tcp"] = [c.setTcp([0, 0, 0.1, 0, 0, 0]), c.getTCPOffset()]
        until(lambda: abs(math.dist(r.getActualTCPPose()[:3], c.getActualToolFlangePose()[:3]) - 0.1) < 2e-3)
        c.setTcp([0.0] * 6)
        for k in range(3000):
            t = c.initPeriod()
            c.speedL([0.0, 0.0, 0.05, 0, 0, 0], 1.0, 0.002)
            c.waitPeriod(t)
            out["speedL"] = r.getActualTCPSpeed()
            if abs(out["speedL"][2] - 0.05) < 2e-3:
                break
        out["speedStop"] = c.speedStop()
        out["poseTrans"] = c.poseTrans([1, 0, 0, 0, 0, 1.5707963], [1, 0, 0, 0, 0, 0])
        out["limits"] = [c.isJointsWithinSafetyLimits(home), c.isJointsWithinSafetyLimits([7.0, *home[1:]])]
        until(lambda: c.getStepTime() == 0.002)  # the client reads it before the script has written it
        out["program"] = c.isProgramRunning()
        c.stopScript()
        """
    )
    assert out["here"][0][:3] == pytest.approx(out["here"][1][:3], abs=1e-3)
    assert out["ik"] == pytest.approx([0.0, -1.5, 1.5, -1.5, -1.5, 0.0], abs=1e-6)
    assert out["solvable"] == [True, False]
    done, goal, there = out["moveL"]
    assert done
    assert there[:3] == pytest.approx(goal[:3], abs=1e-3)
    assert out["moveL_FK"][0]
    assert out["moveL_FK"][1] == pytest.approx([0.0, -1.5, 1.5, -1.5, -1.5, 0.0], abs=5e-3)
    assert out["moveJ_IK"][0]
    assert out["moveJ_IK"][1][:3] == pytest.approx(goal[:3], abs=1e-3)
    assert out["path"][0]
    assert out["path"][1] == pytest.approx([0.2, -1.4, 1.5, -1.5, -1.5, 0.0], abs=5e-3)
    done, offset = out["tcp"]
    assert done
    assert offset == pytest.approx([0, 0, 0.1, 0, 0, 0], abs=1e-9)
    assert out["speedL"] == pytest.approx([0, 0, 0.05, 0, 0, 0], abs=6e-3)
    assert out["speedStop"]
    assert out["poseTrans"] == pytest.approx([1, 1, 0, 0, 0, 1.5707963], abs=1e-6)
    assert out["limits"] == [True, False]
    assert out["program"]


@pytest.mark.slow
def test_force_mode_freedrive_jogging_and_a_protective_stop(twin):
    out = client(
        """
        from dashboard_client import DashboardClient
        from rtde_control import RTDEControlInterface
        from rtde_receive import RTDEReceiveInterface
        c, r = RTDEControlInterface(HOST, 500.0), RTDEReceiveInterface(HOST)
        c.moveJ([0.0, -1.5, 1.5, -1.5, -1.5, 0.0], 2.0, 3.0)
        height = r.getActualTCPPose()[2]
        c.forceMode([0] * 6, [0, 0, 1, 0, 0, 0], [0, 0, 10, 0, 0, 0], 2, [2, 2, 0.1, 1, 1, 1])
        until(lambda: r.getActualTCPPose()[2] > height + 0.02)
        out["force"] = [c.forceModeStop(), r.getActualTCPPose()[2] - height]
        out["jog"] = [c.jogStart([0, 0, -0.03, 0, 0, 0], c.FEATURE_BASE)]
        until(lambda: r.getActualTCPSpeed()[2] < -0.02)
        out["jog"].append(c.jogStop())
        out["free"] = [c.teachMode(), c.endTeachMode(), c.freedriveMode(), c.getFreedriveStatus(), c.endFreedriveMode()]
        out["zero"] = c.zeroFtSensor()
        out["payload"] = c.setPayload(1.0, [0, 0, 0.05])
        out["stop"] = c.triggerProtectiveStop()
        until(lambda: r.isProtectiveStopped())
        d = DashboardClient(HOST)
        d.connect()
        def unlocked():
            try:
                d.unlockProtectiveStop()
            except RuntimeError as error:
                assert "5 seconds" in str(error)
            return not r.isProtectiveStopped()

        until(unlocked, timeout=40)
        d.stop()
        until(lambda: not d.running())
        """
    )
    assert out["force"][0]
    assert out["force"][1] > 0.02
    assert out["jog"] == [True, True]
    assert out["free"] == [True, True, True, 0, True]
    assert out["zero"]
    assert out["payload"]


@pytest.mark.slow
def test_what_the_twin_refuses_ends_the_program_and_the_client_sees_it(tmp_path, monkeypatch):
    profile = tmp_path / "ur.yaml"
    profile.write_text(PROFILE.replace(HOST, ALONE))
    monkeypatch.setattr(sys.modules[__name__], "PRELUDE", PRELUDE.replace(HOST, ALONE))
    with TwinProcess(str(profile)) as twin:
        out = client(
            """
            from rtde_control import RTDEControlInterface
            c = RTDEControlInterface(HOST, 500.0)
            c.setGravity([0, 0, 9.82])
            until(lambda: not c.isProgramRunning())
            out["again"] = c.reuploadScript()
            until(lambda: c.getStepTime() > 0)  # the client reads it before the script has written it
            out["works"] = c.getStepTime()
            c.stopScript()
            """
        )
    assert out["again"]
    assert out["works"] == pytest.approx(0.002)
    assert twin.metrics["arm"]["refused"] == {"set_gravity": 1}
