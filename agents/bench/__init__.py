"""Speed of the simulator and of its environments, measured side by side with others in one run; see ``docs/speed.md``.

The comparisons need the extra ``bench``.
"""

from pathlib import Path

from sffr_gym._jit import cache_sources

cache_sources(Path(__file__).parents[1])
