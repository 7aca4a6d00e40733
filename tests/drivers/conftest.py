"""Fixtures that several files of a device share."""

import pytest
from helpers.fci_pair import Pair


@pytest.fixture
def pair():
    """Makes pairs of a Franka driver and a scripted robot; closes them."""
    made = []

    def make(*args, **options):
        made.append(Pair(*args, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
