"""The small URScript: what it runs, what it refuses, and that no text upsets it."""

import pytest
from helpers.fuzz import fuzz, size_of
from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.ur import UrConfig
from srl.drivers.ur.script import program
from srl.sim.devices.ur.twin_expressions import ScriptError
from srl.sim.devices.ur.twin_program_text import Programs, name_of
from srl.sim.devices.ur.twin_script import Script


class Host:
    """Functions that a program may call, and what it said."""

    def __init__(self):
        self.output = []
        self.reads = {}

    def script(self, text):
        def wait(*given, **named):
            self.output.append(("wait", *given, *named.items()))
            yield

        functions = {"say": lambda *given: self.output.append(given), "read": lambda k: self.reads.get(k, 0)}
        return Script(text, functions, {"wait": wait})

    def run(self, text, cycles=100):
        script = self.script(text)
        for cycle in range(cycles):
            if not script.cycle():
                return cycle
        return cycles


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("1 + 2 * 3", 7), ("(1 + 2) * 3", 9), ("-2 - -3", 1), ("7 % 4", 3), ("1 / 4", 0.25), ("1e-3 * 2.", 0.002),
        ("1 < 2 and not (2 <= 1)", True), ("False or 3 != 3", False), ("[1, [2, 3]][1][0]", 2),
        ("p[0.1, 2, 3, 0, 0, 0][0]", 0.1), ('"a # no remark"', "a # no remark"), ("2 == 2.0", True),
        ("read(3) + 1", 6), ("1 - 2 - 3", -4), ("not True == False", True),
    ],
)  # fmt: skip
def test_expressions(expression, value):
    host = Host()
    host.reads[3] = 5
    host.run(f"def f():\n say({expression})\nend\n")
    assert host.output == [(value,)]


def test_the_flow_of_a_program():
    host = Host()
    cycles = host.run(
        """
def f():
  # a remark
  n = 0
  while True:
    n = n + 1
    if n == 2:
      continue
    elif n > 4:
      break
    else:
      say(n)
    end
    wait(n, t=0.5)
  end
  say("end")
end
"""
    )
    assert cycles == 3
    assert host.output == [
        (1,), ("wait", 1, ("t", 0.5)), (3,), ("wait", 3, ("t", 0.5)), (4,), ("wait", 4, ("t", 0.5)), ("end",),
    ]  # fmt: skip


def test_functions_have_names_of_their_own_and_share_globals():
    host = Host()
    host.run(
        """def f():
  global total = 1
  x = 10
  def add(x):
    if x < 0:
      return
    end
    total = total + x
    wait(total)
  end
  add(5)
  add(-1)
  say(total, x)
end
"""
    )
    assert host.output == [("wait", 6), (6, 10)]


def test_a_single_line_is_a_program():
    host = Host()
    assert host.run("say(3)\n") == 0
    assert host.output == [(3,)]
    assert name_of("say(3)\n") == ""
    assert name_of("  def servo_control():\n") == "servo_control"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def f():\n say(1)\n", "no end"), ("def f():\n x = \nend\n", "too early"), ("end\n", "without a beginning"),
        ("def f():\n struct(a=1)\nend\n", "no 'struct'"),
        ("def f():\n x = p[1, 2]\nend\n", "six elements"),
        ("def f():\n unknown(1)\nend\n", "no function 'unknown'"),
        ("def f():\n say(1 2)\nend\n", r"expected '\)'"), ("def f():\n x = 1 @ 2\nend\n", "isn't expected"),
        ("def f():\n while True\n end\nend\n", "expected ':'"), ("def f(\nend\n", "expected 'def"),
        ("say" + "(" * 5000 + ")" * 5000 + "\n", "nested"),
    ],
)  # fmt: skip
def test_what_isnt_a_program_is_refused_with_its_line(text, words):
    with pytest.raises(ScriptError, match=words):
        Host().script(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("def f():\n while True:\n  x = 1\n end\nend\n", "without letting time pass"),
        ("def f():\n say(x)\nend\n", "has no value"), ("def f():\n say(1 / 0)\nend\n", "division"),
        ("def f():\n say([1][3])\nend\n", "index"), ("def f():\n wait()\n say(1, [2] - 1)\nend\n", "unsupported"),
        ("def f():\n def g():\n  g()\n end\n g()\nend\n", "too deeply"),
    ],
)  # fmt: skip
def test_what_a_program_cant_do_ends_it(text, words):
    with pytest.raises(ScriptError, match=words):
        Host().run(text)


def test_programs_are_cut_out_of_whatever_chunks_they_come_in():
    text = program(UrConfig(port="tcp://h"), 5)
    stream = (text + "say(1)\n\n" + text).encode()
    for size in (1, 7, 1000, len(stream)):
        programs = Programs()
        found = [t for at in range(0, len(stream), size) for t in programs.feed(stream[at : at + size])]
        assert found == [text, "say(1)\n", text]


def test_a_program_without_an_end_doesnt_fill_the_memory():
    programs = Programs()
    for _ in range(200):
        assert programs.feed(b"def f():\n" + b"  x = 1\n" * 1000) == []
    assert programs.too_long > 0
    assert size_of(programs) < 3_000_000


def test_mutated_programs_neither_raise_anything_else_nor_hang():
    good = program(UrConfig(port="tcp://h"), 5).encode()
    programs = Programs()

    def feed(chunk):
        for text in programs.feed(chunk):
            try:
                script = Host().script(text)
                for _ in range(3):
                    script.cycle()
            except ScriptError:
                pass

    fuzz(feed, good, total=300_000)


@given(st.text(alphabet='def if():end=+-[]1x\n wait,say"', max_size=120))
def test_any_text_runs_or_is_refused(text):
    try:
        script = Host().script(text)
        for _ in range(3):
            script.cycle()
    except ScriptError:
        pass
