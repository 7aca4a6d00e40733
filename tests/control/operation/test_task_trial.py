"""Independent operation behind the verified stop, beside a wearer who moves both arms and doesn't look."""

import pytest
from helpers.task_trial import run


def test_path_is_repeated_by_a_late_servo_within_some_millimetres_beside_a_wearer_who_stands_still() -> None:
    found = run(0, "bend", still=True)
    mean, p95, most = found.figures()
    assert found.done
    assert not found.contacts.contacts
    assert found.seconds < 7.0
    # Mostly the servo's delay of 30 ms at up to 0.25 m/s.
    assert mean < 5.0
    assert p95 < 10.0
    assert most < 15.0


@pytest.mark.parametrize("around", ["bend", "wait"])
def test_task_is_done_beside_a_moving_wearer_and_no_contact_is_the_arms(around: str) -> None:
    found = run(1, around)
    assert found.done
    assert found.seconds > 7.0  # it has waited
    assert found.contacts.blamed == 0
    assert found.figures()[2] < 20.0


@pytest.mark.slow
def test_without_the_distances_and_the_verified_stop_the_arm_runs_into_the_wearer() -> None:
    assert sum(run(seed, "ignore", guarded=False).contacts.blamed for seed in range(8)) > 0
    assert sum(run(seed, "bend").contacts.blamed for seed in range(8)) == 0
