"""A control law of your own, to run beside AHSC.

    sffr evaluate mine.py:MyLaw ahsc --scenario excited
    sffr evaluate mine.py:MyLaw,damping=3.0 ahsc --scenario excited
    sffr benchmark mine.py:MyLaw ahsc

This start leaves base, arms and object to the paper's impedance control and damps the panels: replace what you like.
"""

import numpy as np

from sffr_baselines import ControlLaw, UnfitError, make_policy


class MyLaw(ControlLaw):
    """Virtual damping of the panels' tips."""

    def __init__(self, damping=1.5):
        self.damping = float(damping)  # N s/m; what is given behind the name, damping=3.0, arrives here

    def design(self, params, simulator):
        """Prepare what all episodes share: gains, models.

        ``simulator.linearize()`` has the robot as matrices, ``simulator.frequencies(state)`` its frequencies. An
        episode's plant may be another one than ``params`` says.
        """
        if not params.panel.mounts:
            raise UnfitError("damps panels, and this robot has none")  # it is skipped, the others run
        self.allocation = simulator.actuators.allocation  # (panels, channels, 3): volts for a force on a tip

    def reset(self, params, simulator, seed):
        """Begin an episode, which has a law of its own: what an episode changes is made here."""
        self.rigid = make_policy("none", params)

    def __call__(self, obs):
        """Return an action in [-1, 1] for what is seen in a control period; ``self.fields`` says what is where."""
        action = self.rigid(obs)
        rates = self.see(obs, "elastic_rate").reshape(-1, 3)  # each panel's tip: axial, transverse, slope
        forces = np.zeros_like(rates)
        forces[:, 1] = -self.damping * rates[:, 1]
        volts = np.einsum("pcf,pf->pc", self.allocation, forces).ravel()
        action[: volts.size] = volts / self.limit[: volts.size]
        return action
