"""Pictures of the robot at work, without a display or in a window. Its modules are imported by their names.

``environment``: pictures of an environment while it runs; ``renderer``: the picture of a moment, with ``robot`` (base,
arms, panels, object), ``plots`` (the last seconds), ``geometry`` (where things are) and ``canvas`` (pixels); ``trace``:
what is kept of the last seconds; ``window``: the screen. The extra ``render`` brings what they need.
"""
