"""Speed of the simulator and of its environments, measured side by side with others in one run; see ``docs/speed.md``.

The comparisons need the extra ``bench``.
"""
