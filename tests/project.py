"""Where the project and its packages lie."""

from pathlib import Path

ROOT = Path(__file__).parents[1]
PACKAGES = {  # and their folders
    "sffr_gym": ".",
    "sffr_baselines": "baselines",
    "sffr_agents": "agents",
    "sffr_workbench": "workbench",
}
