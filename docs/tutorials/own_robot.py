"""Your own robot from a published one: two UR5 arms on a base of 400 kg, with the case study's panels.

Numbers of base and arms: SpaceRobotEnv (github.com/Tsinghua-Space-Robot-Learning-Group/SpaceRobotEnv), model
spacerobot_dualarm.xml; its wrists of 1.219, 1.219 and 0.1879 kg are one link here. The object is an assumption. Nobody
has to find joint angles: ``reach: auto`` does.
"""

import yaml

from sffr_gym import Simulator
from sffr_gym.envs.arguments import resolve_params
from sffr_workbench import evaluate

ARM = """
    links:
      - {mass: 8.393, length: 0.425, inertia: 0.3553, com: 0.2125}
      - {mass: 2.275, length: 0.39225, inertia: 0.0546, com: 0.27232}
      - {mass: 2.6259, length: 0.177, inertia: 0.008, com: 0.08}
"""
ROBOT = yaml.safe_load(f"""
base: {{mass: 400.0, inertia: 59.56, side: 0.9452}}
arms:
  - name: left
    mount: [0.3, 0.5526]
    mount_angle: 0.0{ARM}
  - name: right
    mount: [0.3, -0.5526]
    mount_angle: 0.0{ARM}
panel:
  mounts:
    - {{name: left, root: [-0.2729, 0.4726], angle: 1.5707963267948966}}
    - {{name: right, root: [-0.2729, -0.4726], angle: -1.5707963267948966}}
object:
  mass: 20.0
  inertia: 3.0
  grasps:
    - {{arm: left, point: [0.0, 0.4]}}
    - {{arm: right, point: [0.0, -0.4]}}
actuators: {{joint_torque: 50.0}}
initial: {{q: [0.0, 0.0, 0.0], qd: null, reach: auto}}
""")

if __name__ == "__main__":
    params = resolve_params(ROBOT)
    plant = Simulator(params)
    state = plant.initial_state()
    print("joint angles", state.q[3:].round(3), "object at", state.obj.round(3))
    print("frequencies [rad/s]", plant.frequencies(plant.rest_state()).round(3))
    print("as matrices", plant.linearize().A.shape)
    short = {"name": "short", "description": "a few seconds", "duration": 5.0}
    found = evaluate(["none", "hsc", "ahsc"], short, params=params)
    for name, row in found.table.items():
        print(f"{name:5} vibration {1e3 * row['vibration']:7.3f} mJ, tracking {1e6 * row['track_rmse']:7.3f} um")
        assert row["failed"] == 0.0
