"""Configuration: what describes robot, task and controllers, and how files are read and written.

``reading``: the way in for files of others, within bounds; ``yaml_text``: texts in YAML, bounded; ``strict_yaml``:
files and overrides become validated models; ``sections``, ``params``: the models of the robot, its task and its
controllers; ``suggestion``: the nearest valid name; ``template``: the form of what reaches compiled code; ``files``:
what is written, and hashes of values; ``run_folder``: who may write where; ``provenance``: where a result comes from;
``errors``: what all of them raise.
"""

from sffr_gym.config.params import Params, load_params
from sffr_gym.config.strict_yaml import ConfigError

__all__ = ["ConfigError", "Params", "load_params"]
