"""Learning: training of damping schedules, their checkpoints, logs, export and tuning. Needs the extra `agents`."""
