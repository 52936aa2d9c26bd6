"""The plant: parameters become arrays, states advance under the actuators' forces.

``simulator``: states in, states out, for programs. ``model``: the robot as arrays, its coordinates, frames and signs;
``beam``, ``piezo``, ``kinematics``, ``initial``: what is computed once, in plain NumPy; ``monolithic``: the paper's
equations as one readable system. ``dynamics`` with ``arms``, ``panel`` and ``grasp``, ``integrator`` and ``actuators``:
the compiled equations of motion; ``staggered``: the step that the paper's coupling allows.
"""

from sffr_gym.physics.model import Model, pack
from sffr_gym.physics.simulator import Applied, Simulator, State

__all__ = ["Applied", "Model", "Simulator", "State", "pack"]
