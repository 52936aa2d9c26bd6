"""Values per energy: what a panel's energy counts as, and actors that explore and learn how far they do."""

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box

from sffr_agents.energy_scaling import EnergyPolicy, SchedulePolicy, energy
from sffr_baselines.schedule import N_FEATURES

LOG_AMPLITUDE = 4  # log10 of the root of a panel's energy over the reward's scale, as documented


def observations(*logs, stack_size=1):
    """An observation of as many panels, whose other numbers, older ones too, say nothing of their energy."""
    obs = np.random.default_rng(0).uniform(-1.0, 1.0, (len(logs), stack_size, N_FEATURES))
    obs[:, 0, LOG_AMPLITUDE] = logs
    return obs.ravel()


@pytest.mark.parametrize("stack_size", [1, 4])
@pytest.mark.parametrize(
    ("logs", "expected"),
    [((0.0,), 1.02), ((1.0,), 100.02), ((0.5,), 10.02), ((-3.0,), 0.020001), ((-3.0, -3.0), 0.040002),
     ((0.0, 1.0), 101.04), ((1.0, -0.5, 0.0), 101.16)],
)  # fmt: skip
def test_energies_add_up_over_the_panels_and_never_vanish(logs, expected, stack_size):
    """Each in units of the reward's scale, plus 2 % of it, which a damped panel keeps; one for each observation."""
    obs = observations(*logs, stack_size=stack_size)
    assert energy(obs, stack_size) == pytest.approx(expected, rel=1e-9)
    many = energy(np.stack([obs, observations(*(1.0 for _ in logs), stack_size=stack_size), obs]), stack_size)
    np.testing.assert_allclose(many, [expected, 100.02 * len(logs), expected], rtol=1e-9)
    np.testing.assert_allclose(energy(torch.as_tensor(obs), stack_size), expected, rtol=1e-9)


@pytest.mark.parametrize("kind", [SchedulePolicy, EnergyPolicy])
def test_an_actor_explores_and_learns_how_far_unless_it_is_told_otherwise(kind):
    """Around a mean within the bounds; asked for it, the same actions for the same observation."""
    torch.manual_seed(0)
    space, actions = Box(-np.inf, np.inf, (N_FEATURES,), np.float32), Box(-1.0, 1.0, (2,), np.float32)
    policy = kind(space, actions, lambda left: 1e-3)
    assert policy.log_std.requires_grad
    assert not kind(space, actions, lambda left: 1e-3, learn_spread=False).log_std.requires_grad
    seen = torch.as_tensor(np.tile(1e3 * observations(0.0), (64, 1)).astype(np.float32))
    seen[:, LOG_AMPLITUDE] = 0.0
    tried, usual = policy(seen)[0], policy(seen, deterministic=True)[0]
    assert len(torch.unique(tried[:, 0])) == 64 and len(torch.unique(usual[:, 0])) == 1
    assert usual.abs().max() <= 1.0 < tried.abs().max()
