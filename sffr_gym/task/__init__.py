"""The task: what is desired, drawn, observed, measured and scored. Its modules are imported by their names.

``scenario``: named distributions of episodes; ``episode``: one draw; ``reference``: the desired motion;
``quasi_static``: the panels' shape under it; ``control_period``: one compiled period with ``observation``, signals,
reward and ends; ``disturbances``: noise, delay and impulses; ``metrics``, ``score``, ``statistics``: measures of an
episode, the cost of a policy, and how sure it is.
"""
