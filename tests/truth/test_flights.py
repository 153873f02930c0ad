"""A sample of `python -m campaigns.flights`, and mistakes that it sees."""

import math

import pytest
from scipy.stats import chi2

from campaigns.flights.fleet import RMS, Fleet, by_time, rms_of
from campaigns.flights.planted import PLANTED, PLANTED_IN_SAMPLES

pytestmark = pytest.mark.slow
SEEDS = range(1, 7)
CHANCE = [math.sqrt(chi2.ppf(share, len(SEEDS)) / len(SEEDS)) for share in (0.001, 0.999)]
CHANNEL, INERTIAL = ("M0", "as shipped"), ("M2", "negative scale")
MUCH = 3.0  # times the error without a planted mistake
ONLY_INERTIAL = ("sign of the scale factor lost", "no cross-coupling")


@pytest.fixture(scope="module", params=[CHANNEL, INERTIAL], ids=" ".join)
def flown(request, tmp_path_factory):
    """Flights of a fleet, with their files."""
    folder = tmp_path_factory.mktemp("fleet")
    fleet = Fleet.of(*request.param, folder)
    flights = [fleet.fly(seed, folder / str(seed)) for seed in SEEDS]
    assert all(flights)
    return request.param, flights


def rms_of_all(flights):
    """R.m.s. of error over u by channel and time."""
    return {at: rms_of(found) for at, found in by_time([each for one in flights for each in one.arrivals()]).items()}


def test_velocities_are_as_wrong_as_is_stated(flown):
    found = rms_of_all(flown[1])
    assert min(found.values()) > RMS[0] * CHANCE[0]
    assert max(found.values()) < RMS[1] * CHANCE[1]


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_mistake_is_seen(name, flown):
    fleet, flights = flown
    if fleet == CHANNEL and name in ONLY_INERTIAL:
        pytest.skip("a single channel of positive scale factor has none")
    honest = rms_of_all(flights)
    with PLANTED[name]():
        found = rms_of_all(flights)
    assert any(each > MUCH * max(honest[at], 1.0) for at, each in found.items())


@pytest.mark.parametrize("fleet", [("M0 volts", "negative scale"), ("M0 codes", "as shipped")], ids=" ".join)
def test_samples_give_velocities_as_wrong_as_is_stated_and_show_mistakes(fleet, tmp_path):
    """One flight, since its calibration is a run through all wires; more in `python -m campaigns.flights`."""
    flown = Fleet.of(*fleet, tmp_path).fly(7, tmp_path / "7")
    honest = max(abs(each.ratio) for each in flown.arrivals())
    assert honest < 3
    for plant in PLANTED_IN_SAMPLES.values():
        with plant():
            assert max(abs(each.ratio) for each in flown.arrivals()) > MUCH * max(honest, 1.0)
