"""Debouncing: a level counts once it has lasted."""

from hypothesis import given
from hypothesis import strategies as st

from srl.drivers.firmata.buttons import Buttons

MS = 1_000_000


def panel():
    buttons = Buttons([2, 5, 9], [0.02, 0.02, 0.0])
    buttons.start({0: 0xFF, 1: 0xFF})
    return buttons


def test_levels_at_opening_count_at_once():
    buttons = Buttons([2, 5, 9], [0.02, 0.02, 0.02])
    buttons.start({0: 0b0010_0000, 1: 0b0000_0010})
    assert buttons.pressed == [1.0, 0.0, 0.0]
    assert buttons.ports == (0, 1)


def test_a_bouncing_press_counts_once_after_the_last_bounce():
    buttons, history = panel(), []
    bounces = {1: 0xFB, 3: 0xFF, 4: 0xFB, 9: 0xFF, 10: 0xFB, 60: 0xFF, 62: 0xFB, 63: 0xFF}
    for ms in range(100):
        if ms in bounces:
            buttons.take(0, bounces[ms], ms * MS)
        buttons.settle(ms * MS)
        history.append(buttons.pressed[0])
    assert history == [0.0] * 30 + [1.0] * 53 + [0.0] * 17


def test_a_bounce_within_one_read_starts_the_time_again():
    buttons = panel()
    buttons.take(0, 0xFB, 0)
    buttons.take(0, 0xFF, 15 * MS)
    buttons.take(0, 0xFB, 15 * MS)
    buttons.settle(20 * MS)
    assert buttons.pressed[0] == 0.0
    buttons.settle(35 * MS)
    assert buttons.pressed[0] == 1.0


def test_without_debounce_a_press_counts_at_once_and_ports_do_not_mix():
    buttons = panel()
    buttons.take(1, 0b1111_1101, 0)
    buttons.settle(0)
    assert buttons.pressed == [0.0, 0.0, 1.0]


@given(st.lists(st.tuples(st.integers(1, 50), st.integers(0, 255)), max_size=40))
def test_a_button_changes_only_after_its_level_has_lasted(changes):
    buttons = panel()
    now, level, since = 0, 0.0, 0
    for wait, mask in changes:
        for _ in range(wait):
            now += MS
            before = buttons.pressed[0]
            buttons.settle(now)
            if buttons.pressed[0] != before:
                assert buttons.pressed[0] == level
                assert now - since >= 20 * MS
            elif level != before:
                assert now - since < 20 * MS
        buttons.take(0, mask, now)
        if level != (0.0 if mask & 4 else 1.0):
            level, since = 1.0 - level, now
