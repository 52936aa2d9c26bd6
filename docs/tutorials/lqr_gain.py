"""A gain by LQR from the linear model: one law for base, arms, object and panels, from matrices alone.

The model at rest holds all around the circle, since the robot keeps its formation and its heading. Its states are what
the observation gives, errors with the opposite sign; what the path's acceleration takes is fed forward.
"""

import numpy as np
from scipy.linalg import solve_discrete_are

from sffr_baselines import ControlLaw
from sffr_workbench import evaluate

ERRORS = ("base_error", "yaw_error", "hold_error", "object_error", "object_angle_error")


class LQR(ControlLaw):
    """Full state feedback, sampled as the loop is."""

    def __init__(self, position=1e8, effort=3.0):
        self.position, self.effort = position, effort  # weights

    def design(self, params, simulator):
        model, n_modes = simulator.linearize().discrete(), simulator.model.omega2.size
        half = len(model.states) // 2
        names = [label.name for label in model.states[:half]]
        self.modes = [k for k, name in enumerate(names) if "_mode" in name]
        self.errors = [k for k in range(half) if k not in self.modes]
        energy = np.concatenate([simulator.model.omega2.ravel(), np.ones(n_modes)])  # of the panels
        weights = np.repeat([self.position, 1e-2 * self.position], half)
        weights[[*self.modes, *(half + k for k in self.modes)]] = energy
        R = self.effort * np.diag(1.0 / self.limit**2)
        P = solve_discrete_are(model.A, model.B, np.diag(weights), R)
        self.gain = np.linalg.solve(R + model.B.T @ P @ model.B, model.B.T @ P @ model.A)
        rigid = simulator.linearize().B[half:][self.errors]  # accelerations for a command
        along = np.array([[float(names[k].endswith(f"_{axis}")) for axis in "xy"] for k in self.errors])
        self.forward = np.linalg.pinv(rigid) @ along  # command that accelerates all of it
        plant, bent = simulator.model, np.arange(n_modes // len(simulator.model.panel_root)) >= simulator.model.n_axial
        across = np.column_stack([-plant.panel_axis[:, 1], plant.panel_axis[:, 0]])  # of each panel, inertial axes
        self.shape = -np.einsum("pm,px->pmx", bent * plant.translation / plant.omega2, across).reshape(-1, 2)
        self.inverse, self.half = plant.inverse, half

    def __call__(self, obs):
        errors = [self.see(obs, name) for name in ERRORS]
        rates = [self.see(obs, f"{name}_rate") for name in ERRORS if name != "hold_error"]
        rates.insert(2, -self.see(obs, "joint_rate")[-len(errors[2]) :])  # the held joints are the last ones
        tips = np.stack([self.see(obs, name).reshape(-1, 3) for name in ("elastic", "elastic_rate")])
        x, acceleration = np.zeros((2, self.half)), self.see(obs, "reference_acceleration")
        x[:, self.errors] = -np.concatenate(errors), -np.concatenate(rates)
        x[:, self.modes] = np.einsum("pmf,kpf->kpm", self.inverse, tips).reshape(2, -1)
        x[0, self.modes] -= self.shape @ acceleration  # what the path alone bends the panels to is no vibration
        return (self.forward @ acceleration - self.gain @ x.ravel()) / self.limit


if __name__ == "__main__":
    found = evaluate([f"{__file__}:LQR", "ahsc"], "nominal")
    for name, row in found.table.items():
        errors = f"vibration {1e3 * row['vibration']:.3f} mJ, tracking {1e6 * row['track_rmse']:.2f} um"
        print(f"{name:5} {errors}, effort {row['piezo_effort']:.1f} V2 s, cost {row['cost']:.2f}")
    assert all(found.table["LQR"][name] < found.table["ahsc"][name] for name in ("vibration", "track_rmse"))
