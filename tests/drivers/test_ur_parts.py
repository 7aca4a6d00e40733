"""What the UR driver is made of: address, dashboard lines, status words, poses, the control program's text."""

import numpy as np
import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError
from scipy.spatial.transform import Rotation

from srl.drivers.ur import UrConfig, dashboard
from srl.drivers.ur.config import Address, address
from srl.drivers.ur.dashboard import Lines
from srl.drivers.ur.declaration import commands, limits, states
from srl.drivers.ur.models import same
from srl.drivers.ur.sample import TYPES, Sample, fill_pose, names
from srl.drivers.ur.script import program
from srl.drivers.ur.status import SafetyBits, safety_words
from srl.runtime.contracts import rotation


@pytest.mark.parametrize(
    ("port", "wanted"),
    [
        ("tcp://10.0.0.5", Address("10.0.0.5", 30004, 29999, 30002)),
        ("tcp://arm.lab:40004", Address("arm.lab", 40004, 29999, 30002)),
        ("tcp://127.0.0.1:5?dashboard=6&script=7", Address("127.0.0.1", 5, 6, 7)),
        ("tcp://127.0.0.1?script=30003", Address("127.0.0.1", 30004, 29999, 30003)),
        ("spy:arm.log:tcp://10.0.0.5", Address("10.0.0.5", 30004, 29999, 30002, "arm.log")),
    ],
)
def test_addresses(port, wanted):
    assert address(port) == wanted


def test_a_spied_link_is_one_of_the_transports():
    assert address("spy:arm.log:tcp://10.0.0.5").url == "spy:arm.log:tcp://10.0.0.5:30004"


@pytest.mark.parametrize(
    "port",
    ["", "10.0.0.5", "udp://10.0.0.5", "tcp://", "tcp://h:99999", "tcp://h/x", "tcp://h?rtde=1", "tcp://h?script=x",
     "tcp://h?script=0", "spy:tcp://h"],
)  # fmt: skip
def test_other_addresses_are_refused(port):
    with pytest.raises(ValidationError, match="isn't tcp://HOST"):
        UrConfig(port=port)


@pytest.mark.parametrize(
    "wrong",
    [
        {"buttons": {"a": 18}},
        {"payload_cog": (0.0, 0.0, 0.1)},
        {"payload": 1.0, "payload_cog": (0.0, 0.0, 50.0)},
        {"tcp": (0.0, 0.0, 150.0, 0.0, 0.0, 0.0)},
        {"model": "UR5"},
        {"timeout": 0.001},
        {"gain": 50},
    ],
)
def test_options_out_of_range_are_refused(wrong):
    with pytest.raises(ValidationError):
        UrConfig(port="tcp://h", **wrong)


def test_lines_are_joined_and_bounded():
    lines = Lines()
    assert lines.feed(b"Robotmode: RUN") == []
    assert lines.feed(b"NING\r\nsecond\nthird") == ["Robotmode: RUNNING", "second"]
    fuzz(lines.feed, b"Safetystatus: NORMAL\nProgram running: false\n" + b"x" * 3000, total=300_000)
    assert size_of(lines) < 10_000


def test_dashboard_answers_are_understood():
    assert dashboard.version("URSoftware 5.11.0.108249 (Apr 22 2021)") == (5, 11, 0)
    assert dashboard.version("nonsense") == (0, 0, 0)
    assert dashboard.value("Robotmode: POWER_OFF") == "POWER_OFF"
    assert not dashboard.understood('could not understand: "is in remote control"')


def test_models_are_the_same_with_and_without_their_letter():
    assert same("UR16e", "UR16")
    assert same("UR16e", "UR16e ")
    assert not same("UR16e", "UR10")


@pytest.mark.parametrize(
    ("bits", "word"),
    [
        (SafetyBits.NORMAL, ""), (SafetyBits.REDUCED, ""), (0, ""),
        (SafetyBits.NORMAL | SafetyBits.PROTECTIVE_STOP | SafetyBits.STOPPED, "protective stop"),
        (SafetyBits.ROBOT_EMERGENCY_STOP | SafetyBits.EMERGENCY_STOP | SafetyBits.STOPPED, "emergency stop"),
        (SafetyBits.SAFEGUARD_STOP | SafetyBits.STOPPED, "safeguard stop"),
        (SafetyBits.FAULT | SafetyBits.PROTECTIVE_STOP, "fault"), (SafetyBits.STOPPED, "stopped"),
    ],
)  # fmt: skip
def test_safety_in_words(bits, word):
    assert safety_words(int(bits)).startswith(word)
    assert bool(safety_words(int(bits))) == bool(word)


VECTORS = arrays(np.float64, 3, elements=st.floats(-4, 4))


@given(VECTORS)
def test_a_rotation_vector_becomes_its_quaternion(vector):
    out = np.zeros(7)  # as a row begins
    fill_pose([1.0, 2.0, 3.0, *vector.tolist()], out)
    x, y, z, *wxyz = out
    assert (x, y, z) == (1.0, 2.0, 3.0)
    wanted = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(Rotation.from_quat(wxyz, scalar_first=True).as_matrix(), wanted, atol=1e-9)
    assert wxyz[0] >= 0


@given(VECTORS)
def test_a_rotation_becomes_its_vector_also_near_a_half_turn(vector):
    length = np.linalg.norm(vector)
    for scale in (1.0, (np.pi - 1e-9) / length if length > 1e-3 else 1.0):
        turn = Rotation.from_rotvec(vector * scale).as_matrix()
        again = Rotation.from_rotvec(rotation.log(rotation.from_matrix(turn))).as_matrix()
        np.testing.assert_allclose(again, turn, atol=2e-6)


def test_poses_dont_jump_where_the_vector_flips():
    out = np.zeros(7)
    fill_pose([0.0, 0.0, 0.0, np.pi - 1e-6, 0.0, 0.0], out)
    before = out.copy()
    fill_pose([0.0, 0.0, 0.0, -(np.pi - 1e-6), 0.0, 0.0], out)
    np.testing.assert_allclose(out, before, atol=1e-5)


def test_a_sample_with_nonsense_in_it_changes_nothing():
    from srl.drivers.ur.recipe import Recipe

    recipe = Recipe(names("target"), TYPES)
    good = [1.0, *[tuple(np.arange(6.0) + k) for k in range(5)], 0.5, 7, 1, 3, 2, 4, 1, 9, 5]
    sample = Sample()
    assert sample.take(b"\x01" + recipe.pack(good))
    assert sample.position.tolist() == [0, 1, 2, 3, 4, 5]
    assert sample.wrench.tolist() == [3, 4, 5, 6, 7, 8]
    assert (sample.timestamp, sample.speed_scaling) == (1.0, 0.5)
    assert sample.words == (7, 1, 3, 2, 4, 1, 9, 5)
    bad = [2.0, (np.nan,) * 6, *good[2:]]
    assert not sample.take(b"\x01" + recipe.pack(bad))
    assert sample.timestamp == 1.0


def test_what_an_arm_declares():
    config = UrConfig(port="tcp://h", buttons={"go": 0, "halt": 16})
    assert {signal.name: signal.shape for signal in states(config, "arm")} == {
        "position": (6,), "velocity": (6,), "effort": (6,), "wrench": (6,), "pose": (7,), "speed_scaling": (1,),
        "buttons": (2,),
    }  # fmt: skip
    (command,) = commands(config)
    assert command.name == "velocity_command"
    assert command.feedback == "position"
    assert commands(config.model_copy(update={"interface": "none"})) == ()
    found = limits(config)
    np.testing.assert_allclose(found.velocity, np.radians([120, 120, 180, 180, 180, 180]))
    np.testing.assert_allclose(found.upper, 2 * np.pi)


def test_the_program_says_what_the_profile_says():
    velocity = program(UrConfig(port="tcp://h", acceleration=7.5, deceleration=3.0), 99)
    assert "nonce = 99\n" in velocity
    assert "speedj(goal, 7.5, 0.002)" in velocity
    assert "stopj(3.0)" in velocity
    assert "set_payload" not in velocity
    position = program(UrConfig(port="tcp://h", interface="position", payload=2.5, payload_cog=(0, 0, 0.1)), 1)
    assert "servoj(goal, 0, 0, 0.002, 0.1, 300.0)" in position
    assert "cog = [0.000000, 0.000000, 0.100000]\n" in position
    assert "set_payload(2.500000, cog)" in position
    for text in (velocity, position):
        assert text.isascii()
        assert "{" not in text
        opens = sum(line.strip().startswith(("def", "while", "if")) for line in text.splitlines())
        assert opens == sum(line.strip() == "end" for line in text.splitlines())
