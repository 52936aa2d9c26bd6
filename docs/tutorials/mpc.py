"""Model predictive control of the panels: volts within a tight limit, planned ten times a second.

The model has its base held, as impedance control nearly does: it is linearised with one of a million kilograms.
"""

import numpy as np
from scipy.optimize import lsq_linear

from sffr_baselines import ControlLaw, make_policy
from sffr_gym import Simulator
from sffr_workbench import evaluate


class MPC(ControlLaw):
    """Plans the volts of a panel over a horizon, with a step of ``hold`` seconds, and applies the first."""

    def __init__(self, limit=2.0, hold=0.1, horizon=20, effort=1e-3):
        self.most, self.hold, self.horizon, self.effort = limit, hold, horizon, effort  # V, s, steps, J^0.5/V

    def design(self, params, simulator):
        heavy = params.with_overrides("object=null", "base.mass=1.0e+6", "base.inertia=1.0e+6")
        model, plant = Simulator(heavy).linearize().discrete(self.hold), simulator.model
        name, bent = params.panel.mounts[0].name, slice(plant.n_axial, None)
        modes = [f"{name}_mode{k + 1}" for k in range(plant.omega2.shape[1])][bent]
        x = model.find("states", *modes, *(f"{mode}_rate" for mode in modes))
        u = model.find("inputs", f"{name}_piezo2", f"{name}_piezo3")
        A, B = model.A[np.ix_(x, x)], model.B[np.ix_(x, u)]
        size = np.sqrt(np.append(plant.omega2[0, bent], np.ones(len(modes))))  # roots of the energy
        powers, steps = [np.linalg.matrix_power(A, k) for k in range(self.horizon + 1)], range(self.horizon)
        forced = np.block([[powers[i - j] @ B if j <= i else 0 * B for j in steps] for i in steps])
        self.forced = np.vstack([np.tile(size, self.horizon)[:, None] * forced, self.effort * np.eye(forced.shape[1])])
        self.free = np.vstack([*(size[:, None] * power for power in powers[1:]), np.zeros((forced.shape[1], len(x)))])
        across = np.column_stack([-plant.panel_axis[:, 1], plant.panel_axis[:, 0]])  # of each panel, inertial axes
        self.shape = -np.einsum("m,px->pmx", (plant.translation / plant.omega2)[0, bent], across)
        self.inverse, self.every = plant.inverse[0, bent], round(self.hold / self.period)

    def reset(self, params, simulator, seed):
        self.rigid, self.tick = make_policy("none", params), 0

    def __call__(self, obs):
        action, acceleration = self.rigid(obs), self.see(obs, "reference_acceleration")
        if self.tick % self.every == 0:
            tips, rates = (self.see(obs, name).reshape(-1, 3) for name in ("elastic", "elastic_rate"))
            self.volts = np.zeros_like(tips)
            for i, shape in enumerate(self.shape @ acceleration):  # what the path alone bends the panels to
                now = np.append(self.inverse @ tips[i] - shape, self.inverse @ rates[i])
                self.volts[i, 1:] = lsq_linear(self.forced, -self.free @ now, (-self.most, self.most)).x[:2]
        self.tick += 1
        action[: self.volts.size] = self.volts.ravel() / self.limit[: self.volts.size]
        return action


if __name__ == "__main__":
    swing = {"duration": 15.0, "panel_modes": [{"mode": 1, "amplitude": [0.15, 0.2]}]}
    found = evaluate([f"{__file__}:MPC", "ahsc"], {"name": "swing", "description": "15 s", **swing}, episodes=1)
    for name, row in found.table.items():
        print(f"{name:5} vibration {1e3 * row['vibration']:7.3f} mJ, effort {row['piezo_effort']:7.3f} V2 s")
    assert abs(found.first["MPC"].applied[:, :6]).max() <= 2.0
    assert found.table["MPC"]["vibration"] < found.table["ahsc"]["vibration"]
