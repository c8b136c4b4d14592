import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from engine.capture_checks import exposure
from engine.capture_checks.shot_preview import LEVELS_PER_EV, LOWEST_EV, Sensor
from engine.hdr.exposures import SensorNoise

SENSOR = Sensor(1.0, SensorNoise(0.3, 1.5))
FULL = 15_000.0
BINS = 60 * LEVELS_PER_EV


def histogram(lowest_ev: float, highest_ev: float) -> np.ndarray:
    """Light spread evenly between two levels."""
    counts = np.zeros(BINS)
    counts[
        round((lowest_ev - LOWEST_EV) * LEVELS_PER_EV) : round((highest_ev - LOWEST_EV) * LEVELS_PER_EV)
    ] = 1
    return counts


@settings(deadline=None)
@given(
    lowest=st.floats(-20, -7),
    span=st.floats(1, 15) | st.floats(22, 26),
    base=st.floats(-8, 4),
    clipped=st.booleans(),
)
def test_a_proposed_bracket_holds_the_light(lowest, span, base, clipped):
    now = [2.0 ** (base + stop) for stop in (-3, 0, 3)]
    light = histogram(lowest, lowest + span)
    found = exposure.proposal(now, light, 0.01 if clipped else 0.0, SENSOR, FULL)
    if found is None:
        assert not clipped
        evs = np.log2(now)
    else:
        evs = np.log2(now[1]) + found.shift_ev + np.array(found.stops)
        assert found.at_least == clipped
        assert len(found.stops) % 2 == 1
        assert np.diff(found.stops).max(initial=0) <= exposure.WIDEST_STEP_EV + 0.4
    third = 1 / 3 + 1 / LEVELS_PER_EV
    # The brightest level stays below full, the darkest rises above the noise.
    assert evs.min() + lowest + span - third <= 0.001
    assert 2 ** (evs.max() + lowest + third) * FULL > exposure.DARK_FLOORS * SENSOR.noise.read


def test_a_bracket_that_suits_is_left_alone():
    now = [2.0**stop for stop in (-3, 0, 3)]
    assert exposure.proposal(now, histogram(-5, 2), 0.0, SENSOR, FULL) is None


def test_lamps_beyond_the_shortest_exposure_ask_for_more_than_is_known():
    now = [2.0**stop for stop in (-3, 0, 3)]
    found = exposure.proposal(now, histogram(-5, 3), 0.02, SENSOR, FULL)
    assert found is not None
    assert found.at_least
    assert "or wider" in found.told()
    assert found.shift_ev + found.stops[0] <= -5.6


def test_a_proposal_reads_as_one_would_set_it():
    told = exposure.Proposal(-4 / 3, (-3.0, 0.0, 3.0), False).told()
    assert told == "change the middle exposure by -1.3 EV and bracket -3, 0, +3 EV"
    assert exposure.Proposal(0.0, (0.0,), False).told() == "bracket 0 EV"


def test_nothing_is_proposed_without_light():
    assert exposure.proposal([1.0], np.zeros(BINS), 0.0, SENSOR, FULL) is None
