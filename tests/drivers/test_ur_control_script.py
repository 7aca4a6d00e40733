"""The control program itself, pass by pass, in the twin's URScript with hand-made registers."""

import pytest

from srl.drivers.ur import UrConfig
from srl.drivers.ur.registers import MODE, NONCE, SEQUENCE, STATE, TIMEOUT, VALUES, Mode, ScriptState
from srl.drivers.ur.script import ALONE, STRANGE, program
from srl.sim.devices.ur.twin_script import Script

MINE = 77


class Controller:
    """Registers, and what the program did in each cycle.

    Attributes:
        between: called once, after the values were read and before the number is read again.
    """

    def __init__(self, **config):
        self.ints, self.doubles, self.out = [0] * 48, [0.0] * 48, {}
        self.did = []
        self.watchdogs = []
        self.between = None
        self.reported, self.payloads = (0.0, [0.0, 0.0, 0.0]), []
        self.tcp, self.tcps = [0.0] * 6, []
        functions = {
            "get_target_payload": lambda: self.reported[0],
            "get_target_payload_cog": lambda: self.reported[1],
            "get_tcp_offset": lambda: self.tcp,
            "set_tcp": self.set_tcp,
            "norm": abs,
            "set_payload": self.set_payload,
            "read_input_integer_register": self.read_int,
            "read_input_float_register": self.doubles.__getitem__,
            "write_output_integer_register": self.out.__setitem__,
            "rtde_set_watchdog": lambda *given: self.watchdogs.append(given),
        }
        motions = {name: self.motion(name) for name in ("speedj", "servoj", "stopj", "sync")}
        self.ints[NONCE] = MINE
        self.text, self.functions, self.motions = program(UrConfig(port="tcp://h", **config), MINE), functions, motions
        self.restart()

    def set_payload(self, mass, cog):
        self.reported = (mass, cog)
        self.payloads.append(self.reported)

    def set_tcp(self, pose):
        self.tcp = list(pose)
        self.tcps.append(self.tcp)

    def restart(self):
        """The program from its beginning, as after a recovery."""
        self.script = Script(self.text, self.functions, self.motions)

    def motion(self, name):
        def wait(*given):
            self.did.append((name, *given))
            yield

        return wait

    def read_int(self, number):
        found = self.ints[number]
        if number == NONCE and self.between is not None:
            self.between, change = None, self.between
            change()
        return found

    def command(self, number, mode=Mode.FOLLOW, value=0.1, cycles=5):
        self.ints[SEQUENCE], self.ints[MODE], self.ints[TIMEOUT] = number, mode, cycles
        self.doubles[VALUES : VALUES + 6] = [value] * 6

    def cycles(self, count):
        """What was done in so many cycles, by name; fewer if the program ended."""
        self.did.clear()
        for _ in range(count):
            if not self.script.cycle():
                break
        return [one[0] for one in self.did]

    @property
    def state(self):
        return self.out[STATE]


@pytest.fixture
def controller():
    return Controller()


def test_it_says_that_it_is_ready_and_waits(controller):
    assert controller.cycles(3) == ["sync"] * 3
    assert (controller.state, controller.out[NONCE]) == (ScriptState.READY, MINE)


@pytest.mark.parametrize(
    "reported", [(2.0, [0.0, 0.0, 0.1]), (2.5, [0.0, 0.0, 0.2]), (2.5, [0.05, 0.0, 0.1]), (0.0, [0.0, 0.0, 0.0])]
)
def test_another_payload_is_set_once_and_not_again_at_a_recovery(reported):
    controller = Controller(payload=2.5, payload_cog=(0.0, 0.0, 0.1))
    controller.reported = reported
    controller.cycles(3)
    assert controller.payloads == [(2.5, [0.0, 0.0, 0.1])]
    controller.restart()
    controller.cycles(3)
    assert len(controller.payloads) == 1  # it would zero the force sensor while the arm is pressed against something


@pytest.mark.parametrize("axis", range(6))
def test_another_tool_centre_is_set_once(axis):
    wanted = [0.1, 0.0, 0.15, 0.0, 1.5, 0.0]
    controller = Controller(tcp=wanted)
    controller.tcp = [value + 0.01 * (i == axis) for i, value in enumerate(wanted)]
    controller.cycles(3)
    controller.restart()
    controller.cycles(3)
    assert controller.tcps == [wanted]


def test_a_command_that_was_there_before_it_is_not_obeyed():
    controller = Controller()
    controller.command(12345)
    assert controller.cycles(20) == ["sync"] * 20
    controller.command(12346)
    assert controller.cycles(1) == ["speedj"]


def test_a_command_is_followed_and_its_number_sent_back(controller):
    controller.cycles(2)
    controller.command(8, value=0.25)
    controller.cycles(1)
    assert controller.did == [("speedj", [0.25] * 6, 10.0, 0.002)]
    assert (controller.state, controller.out[SEQUENCE]) == (ScriptState.FOLLOWING, 8)
    assert controller.watchdogs == [(f"input_int_register_{SEQUENCE}", 4.0, "stop")]


def test_a_command_holds_for_its_own_time_and_no_longer(controller):
    controller.cycles(1)
    controller.command(8, cycles=5)
    assert controller.cycles(100) == ["speedj"] * 5 + ["stopj"]
    assert controller.state == ScriptState.TIMED_OUT


def test_each_command_starts_its_time_anew(controller):
    controller.cycles(1)
    for number in range(1, 50):
        controller.command(number, cycles=5)
        assert controller.cycles(4) == ["speedj"] * 4
    assert controller.state == ScriptState.FOLLOWING


def test_a_command_that_changes_while_it_is_read_is_taken_whole_in_the_next_cycle(controller):
    controller.cycles(1)
    controller.command(1, value=0.1)
    controller.cycles(1)
    controller.command(2, value=0.2)
    controller.between = lambda: controller.command(3, value=0.3)
    controller.cycles(1)
    assert controller.did[0][1] == [0.1] * 6  # still the one before
    assert controller.out[SEQUENCE] == 1
    controller.cycles(1)
    assert controller.did[0][1] == [0.3] * 6
    assert controller.out[SEQUENCE] == 3


def test_staying_ramps_down_once_and_disarms_the_watchdog(controller):
    controller.cycles(1)
    controller.command(1)
    controller.cycles(2)
    controller.command(0, Mode.STAY)  # the stop frame's number
    assert controller.cycles(4) == ["stopj", "sync", "sync", "sync"]
    assert controller.state == ScriptState.READY
    assert controller.watchdogs[-1][-1] == "ignore"
    controller.command(2)
    assert controller.cycles(1) == ["speedj"]


def test_it_ends_when_told_to(controller):
    controller.cycles(1)
    controller.command(1)
    controller.cycles(2)
    controller.command(2, Mode.END)
    assert controller.cycles(10) == ["stopj"]
    assert controller.state == ScriptState.ENDED


def test_another_drivers_commands_stop_it_at_once_and_end_it_soon(controller):
    controller.cycles(1)
    controller.command(1)
    controller.cycles(2)
    controller.ints[NONCE] = MINE + 1
    controller.command(2, value=9.0)
    did = controller.cycles(STRANGE + 10)
    assert did[0] == "stopj"
    assert set(did[1:-1]) == {"sync"}
    assert controller.state == ScriptState.ABANDONED


@pytest.mark.slow
def test_alone_it_ends_after_a_minute(controller):
    assert len(controller.cycles(ALONE + 100)) == ALONE + 1
    assert controller.state == ScriptState.ABANDONED


def test_positions_are_servoed():
    controller = Controller(interface="position", lookahead=0.05, gain=500)
    controller.cycles(1)
    controller.command(1, value=0.7)
    controller.cycles(1)
    assert controller.did == [("servoj", [0.7] * 6, 0, 0, 0.002, 0.05, 500.0)]
