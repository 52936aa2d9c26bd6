"""A scenario with limits that bind: piezos of a thousandth of their force, and thrusters that give less than is asked.

The controllers know the robot of ``robot``; what ``plant`` draws they do not. The table's last columns say how much of
the time actuators were at their limits, and whether an episode failed.
"""

from sffr_workbench import evaluate

SCENARIO = {
    "name": "tight",
    "description": "weak piezos and thrusters, panels that swing",
    "duration": 30.0,
    "panel_modes": [{"mode": 1, "amplitude": [0.1, 0.25]}],
    "robot": ["actuators.piezo.force=0.04", "actuators.piezo.moment=0.04", "actuators.thruster_force=6"],
    "plant": {"thruster": [0.7, 1.0]},  # of what the controllers believe, drawn for each episode
    "offset_position": 0.03,
}

if __name__ == "__main__":
    found = evaluate(["none", "hsc", "ahsc", "lqr"], SCENARIO, episodes=3)
    for name, row in found.table.items():
        busy = 100 * row["piezo_saturation"], 100 * row["thruster_saturation"]
        print(f"{name:12} vibration {1e3 * row['vibration']:7.2f} mJ, cost {row['cost']:5.2f}", end="; ")
        print(f"at the limit: piezos {busy[0]:4.1f} %, thrusters {busy[1]:4.1f} %; failed {row['failed']:.0%}")
    assert found.table["hsc"]["piezo_saturation"] > 0.0 and found.table["hsc"]["thruster_saturation"] > 0.0
