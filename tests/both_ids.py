"""Both environments, single and batch, and a short scenario for them."""

import numpy as np

from sffr_baselines.damping_env import SFFRFlexDampingEnv, SFFRFlexDampingVectorEnv
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.task.scenario import Scenario

IDS = ("SFFRFlex-v0", "SFFRFlexDamping-v0")
SINGLES = (SFFRFlexEnv, SFFRFlexDampingEnv)
VECTORS = (SFFRFlexVectorEnv, SFFRFlexDampingVectorEnv)
SHORT = Scenario(name="short", description="a test's", duration=0.2)


def zeros(env):
    return np.zeros(env.action_space.shape)
