"""Your first law: positive position feedback of the panels' tips, beside none and AHSC.

Positive position feedback (Goh and Caughey, 1985) passes a deflection through a damped filter tuned to the mode and
feeds it back with a positive sign: the filter lags by a quarter of a turn at the mode, so that the force brakes.
"""

import numpy as np
from scipy.linalg import expm

from sffr_baselines import ControlLaw, make_policy
from sffr_workbench import evaluate


class PPF(ControlLaw):
    """A filter for each panel's transverse tip displacement; base, arms and object by the paper's impedance control."""

    def __init__(self, gain=0.15, frequency=0.66, damping=0.5):
        self.gain, self.frequency, self.damping = gain, frequency, damping  # part of the stiffness, rad/s, -

    def design(self, params, simulator):
        w, zeta = self.frequency, self.damping
        continuous = np.array([[0.0, 1.0, 0.0], [-w * w, -2 * zeta * w, w * w], [0.0, 0.0, 0.0]])
        self.step = expm(continuous * self.period)[:2]
        self.stiffness = 3.0 * params.panel.EI / params.panel.length**3  # of a tip against a force [N/m]
        self.allocation = simulator.actuators.allocation

    def reset(self, params, simulator, seed):
        self.rigid = make_policy("none", params)
        self.filter = np.zeros((2, len(params.panel.mounts)))

    def __call__(self, obs):
        action = self.rigid(obs)
        deflection = self.see(obs, "elastic").reshape(-1, 3)[:, 1]
        self.filter = self.step @ np.vstack([self.filter, deflection])
        forces = np.zeros((len(deflection), 3))
        forces[:, 1] = self.gain * self.stiffness * self.filter[0]
        volts = np.einsum("pcf,pf->pc", self.allocation, forces).ravel()
        action[: volts.size] = volts / self.limit[: volts.size]
        return action


if __name__ == "__main__":
    found = evaluate(["none", f"{__file__}:PPF", f"{__file__}:PPF,gain=0.3", "ahsc"], "excited", episodes=2)
    for name, row in found.table.items():
        print(f"{name:14} vibration {1e3 * row['vibration']:7.3f} mJ, tracking {1e6 * row['track_rmse']:6.2f} um")
    assert found.table["PPF"]["vibration"] < 0.5 * found.table["none"]["vibration"]
