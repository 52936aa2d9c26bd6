"""The report's spectra and shares on made-up motions: bins, ends, and what tells nothing."""

from dataclasses import replace

import numpy as np
import pytest

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym import Simulator
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.task.scenario import Scenario
from sffr_workbench.evaluation.recording import Recording
from sffr_workbench.report.spectrum import mode_frequencies, spectrum, use_of_limits


@pytest.fixture(scope="module")
def recording():
    env = SFFRFlexEnv(Scenario(name="short", description="a test's", duration=0.4))
    return Recording.of(rollout(env, make_policy("ahsc", env), 0))


def of_noise(recording, rows, period):
    """A recording of tips that move at random."""
    return replace(recording, tips=np.random.default_rng(0).normal(size=(rows, 2)), period=period)


@pytest.mark.parametrize(
    ("rows", "period", "there"),
    [(159, 0.01, False), (160, 0.01, True), (399, 5.0e-4, False), (400, 5.0e-4, True), (479, 1.0 / 2400.0, False),
     (480, 1.0 / 2400.0, True)],
)  # fmt: skip
def test_a_spectrum_takes_a_number_for_each_bin_and_four_periods_of_20_hz(recording, rows, period, there):
    found = spectrum(of_noise(recording, rows, period))
    assert bool(found["f"]) == there and len(found["psd"]) == 2 and bool(found["psd"][0]) == there


@pytest.mark.parametrize(("seconds", "period"), [(70.0, 0.01), (20.0, 0.005)])
def test_a_spectrum_has_160_bins_from_its_resolution_to_20_hz(recording, seconds, period):
    """Even in the logarithm; each shows the mean of the frequencies in it, and those without one are left out."""
    lowest = 1.0 / min(seconds, 60.0)
    f = lowest * np.arange(1, round(20.0 / lowest))
    bins = np.floor(160.0 * np.log(f / (0.999 * lowest)) / np.log(20.0 / (0.999 * lowest)))
    expected = [f[bins == k].mean() for k in np.unique(bins)]
    found = spectrum(of_noise(recording, round(seconds / period), period))
    np.testing.assert_allclose(found["f"], expected, rtol=1e-4)
    power = np.array(found["psd"]) / (2.0 * period)  # of white noise of one, half of it at negative frequencies
    assert power.shape == (2, len(expected)) and power[:, -40:].mean() == pytest.approx(1.0, rel=0.15)


def test_a_spectrum_leaves_out_what_is_not_finite(recording):
    """As the last period of an episode that blew up."""
    whole = of_noise(recording, 500, 0.01)
    broken = replace(whole, tips=np.vstack([whole.tips, [[np.nan, 0.0], [0.0, np.inf]]]))
    assert spectrum(broken) == spectrum(whole)


def test_frequencies_are_those_of_the_first_state_below_20_hz(recording):
    """Whatever came later; none of a state that is not finite."""
    sim, first = Simulator(recording.plant), recording.p[0]
    everything = sim.frequencies(sim.unflatten(0.0, first, np.zeros_like(first))) / (2.0 * np.pi)
    found = mode_frequencies(recording)
    np.testing.assert_allclose(found, [f for f in everything if f < 20.0], rtol=1e-4)
    assert 0 < len(found) < len(everything)
    later = np.vstack([first, np.full((2, len(first)), np.nan)])
    assert mode_frequencies(replace(recording, p=later)) == found
    turned = first.copy()
    turned[3:9] += 0.4
    assert mode_frequencies(replace(recording, p=np.array([turned, first]))) != found
    assert mode_frequencies(replace(recording, p=later[::-1])) == []


@pytest.mark.parametrize(
    ("share", "place"),
    [(0.0, 0), (0.9e-5, 0), (1.1e-5, 1), (2.0e-5, 1), (2.3e-5, 2), (0.9e-4, 3), (1.1e-4, 4), (0.09, 12), (0.11, 13),
     (0.2, 13), (0.3, 14), (0.9, 15), (0.9999, 15), (1.0, 16)],
)  # fmt: skip
def test_use_of_limits_has_three_bins_a_decade(recording, share, place):
    """From a hundred-thousandth on; what is less stands before them, what is at its limit behind."""
    busy = Recording(**vars(recording) | {"applied": np.tile(share * recording.limit, (len(recording.t), 1))})
    for shares in use_of_limits(busy).values():
        assert [k for k, each in enumerate(shares) if each] == [place] and shares[place] == 1.0


def test_what_can_give_little_counts_and_what_is_dead_does_not(recording):
    """A share of its own limit, however small that is; a group without any that live has no shares."""
    limit = np.full_like(recording.limit, 0.5)
    limit[:6] = 0.0
    shares = use_of_limits(replace(recording, limit=limit, applied=np.tile(0.5 * limit, (len(recording.t), 1))))
    assert not any(shares["piezo"]) and shares["thruster"][-2] == shares["joint"][-2] == 1.0


def test_a_single_command_is_all_there_is(recording):
    limit = np.zeros_like(recording.limit)
    limit[[0, 7, -1]] = 2.0
    shares = use_of_limits(replace(recording, limit=limit, applied=limit[None, :]))
    assert [shares[name][-1] for name in ("piezo", "thruster", "joint")] == [1.0, 1.0, 1.0]
