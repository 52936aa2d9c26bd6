"""The case study as plain data, variants of it, and random states of them."""

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray
from oracle import Oracle
from plain_params import shipped_tree

Array = NDArray[np.float64]

CONFIG = shipped_tree()

FREQUENCIES = [  # rad/s of the free robot by elements per panel; the last pair of one element is the axial one
    (1, [0.70764, 1.68516, 6.61034, 7.46022, 2828.4, 3199.9]),
    (2, [0.70529, 1.67717, 4.24163, 4.94758]),
    (4, [0.70498, 1.67497, 4.21426, 4.92956]),
    (8, [0.70496, 1.67479, 4.20972, 4.92420]),
]
VARIANTS = ["paper", "three elements", "other robot"]


def make_config(variant: str = "paper") -> dict[str, Any]:
    """Return the case study, the same with finer panels, or a robot of another structure."""
    config = copy.deepcopy(CONFIG)
    if variant == "three elements":
        config["panel"]["elements"] = 3
    elif variant == "other robot":
        config["panel"].update(elements=2, mounts=[{"name": "only", "root": [0.3, -0.7], "angle": 2.1}])
        links = [{"mass": 1.0 + k, "length": 0.8, "inertia": 0.2 + 0.1 * k, "com": 0.3} for k in range(3)]
        config["arms"] = [{"name": "long", "mount": [0.2, 0.4], "mount_angle": 0.7, "links": links}, config["arms"][2]]
        config["object"] = {"mass": 2.0, "inertia": 0.3, "grasps": [{"arm": "long", "point": [0.2, -0.1]}]}
    return config


def random_state(oracle: Oracle, seed: int, with_object: bool = False) -> tuple[Array, Array, Array]:
    """Return z, zd and a force Q; small axial strains, since the axial stiffness is 1e6 times that of bending."""
    rng = np.random.default_rng(seed)
    z, zd, Q = rng.uniform(-1.0, 1.0, (3, oracle.N))
    if with_object:
        z[: oracle.n_rigid] = CONFIG["initial"]["q"]
    z[oracle.n_rigid :: 3] *= 1.0e-6
    zd[oracle.n_rigid :: 3] *= 1.0e-3
    for elastic in (z, zd):
        elastic[oracle.n_rigid :] *= 0.3
    return z, zd, Q
